"""What a live run shows: entities and layout for the Rerun viewer, logged in a thread that nobody waits for."""

from __future__ import annotations

from .viewer import Viewer

__all__ = ["Viewer"]
