"""Import of optional dependencies, with a message that says what to install."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import MissingExtraError

# The name to install by: `rsflow` on the package index is another's program. The import and the command are `rsflow`.
DISTRIBUTION = "rsflow-motion"


def require(module: str, *, extra: str, purpose: str) -> Any:
    """Import and return `module`; where it is missing, say which extra of rsflow brings it.

    Parameters
    ----------
    module : str
        Dotted name of the module.
    extra : str
        Name of the extra in ``pip install 'rsflow-motion[extra]'``.
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
            f"pip install '{DISTRIBUTION}[{extra}]'",
            name=error.name,
        ) from None
