"""The main job: one source in; tables, videos and a report page out."""

from __future__ import annotations

from .job import extract
from .pipeline import Measured
from .result import Extraction, ExtractionInterrupted, PartialExtractionError
from .settings import ExtractSettings

__all__ = [
    "ExtractSettings",
    "Extraction",
    "ExtractionInterrupted",
    "Measured",
    "PartialExtractionError",
    "extract",
]
