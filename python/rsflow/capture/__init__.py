"""Frames with their times, from a camera, a video, pictures, arrays or a URL."""

from __future__ import annotations

from .stream import Frame, Frames, FrameSource, Timestamps, frames

__all__ = ["Frame", "FrameSource", "Frames", "Timestamps", "frames"]
