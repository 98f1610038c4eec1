"""What moves and what stands still in the pictures of one camera; the things that move, with numbers over time."""

from __future__ import annotations

from .result import MotionSegmentation, SegmentationStatus
from .segmenter import MotionSegmenter

__all__ = ["MotionSegmentation", "MotionSegmenter", "SegmentationStatus"]
