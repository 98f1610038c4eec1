"""The whole job over many sources, on a pool of processes or any executor."""

from __future__ import annotations

from .items import BatchItem, BatchStatus, folder_names
from .run import extract_many

__all__ = ["BatchItem", "BatchStatus", "extract_many", "folder_names"]
