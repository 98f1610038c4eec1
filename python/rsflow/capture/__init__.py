"""Frames with their times, from a camera, a video, pictures, arrays or a URL."""

from __future__ import annotations

from .opening import frames
from .reader import Timestamps
from .stream import Frame, Frames, FrameSource

__all__ = ["Frame", "FrameSource", "Frames", "Timestamps", "frames"]
