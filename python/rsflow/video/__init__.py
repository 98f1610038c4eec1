"""Videos written frame by frame."""

from __future__ import annotations

from .writer import VideoWriter, encoder, write_lossless

__all__ = ["VideoWriter", "encoder", "write_lossless"]
