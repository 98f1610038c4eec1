"""The report page of an extraction: one HTML file that answers how fast, where, how many, how sure first."""

from __future__ import annotations

from .build import build
from .material import Material
from .page import page

__all__ = ["Material", "build", "page"]
