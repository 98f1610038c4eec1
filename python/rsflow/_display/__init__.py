"""How results look where they are printed: a line or two of text, and a small picture in a notebook."""

from __future__ import annotations

from .picture import display_range, displayed, html
from .table import columns
from .text import fields, measured, options

__all__ = ["columns", "display_range", "displayed", "fields", "html", "measured", "options"]
