"""Import of optional dependencies, with a message that says what to install."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import MissingExtraError


def require(module: str, *, extra: str, purpose: str) -> Any:
    """Import and return `module`; where it is missing, say which extra of rsflow brings it.

    Parameters
    ----------
    module : str
        Dotted name of the module.
    extra : str
        Name of the extra in ``pip install 'rsflow[extra]'``.
    purpose : str
        What needs it, as the start of a sentence ("drawing a plot").

    Raises
    ------
    MissingExtraError
        If the module is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != module.split(".")[0]:
            raise
        raise MissingExtraError(
            f"{purpose} needs the package {module.split('.')[0]!r}, which is not installed: "
            f"pip install 'rsflow[{extra}]'",
            name=error.name,
        ) from None
