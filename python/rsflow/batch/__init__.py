"""The whole job over many sources, on a pool of processes or any executor."""

from __future__ import annotations

from .run import BatchItem, BatchStatus, extract_many, folder_names

__all__ = ["BatchItem", "BatchStatus", "extract_many", "folder_names"]
