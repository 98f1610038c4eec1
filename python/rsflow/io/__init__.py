"""Flow files, and what reading and writing of any file shares: limits on sizes, files that are whole or not there."""

from __future__ import annotations

from .flow_files import FLOW_SUFFIXES, FlowLike, read_flow, read_flow_times, write_flow

__all__ = ["FLOW_SUFFIXES", "FlowLike", "read_flow", "read_flow_times", "write_flow"]
