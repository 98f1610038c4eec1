"""Frames of any source; `rsflow.capture` holds the code."""

from __future__ import annotations

from ..capture import Frame, Frames, FrameSource, Timestamps, frames

__all__ = ["Frame", "FrameSource", "Frames", "Timestamps", "frames"]
