"""Bridges to other libraries and protocols."""

from __future__ import annotations

import importlib
from typing import Any

# Modules that are reached as attributes, loaded when they are.
_MODULES = ("flow_sensor", "mavlink", "opencv", "ros")


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
