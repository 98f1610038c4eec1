"""Flow fields in files: Middlebury ``.flo``, KITTI ``.png``, ``.npy``, ``.npz`` and ``.pfm``.

One reader and one writer, chosen by the suffix. In memory a flow is (height, width, 2) float32 in pixels,
``[..., 0]`` to the right and ``[..., 1]`` down, from the first picture to the second, NaN where it is unknown. What a
header claims is held against the length of the file before anything is allocated.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .. import _checks
from ..errors import DTypeError, FormatError, OptionError, ShapeError
from .atomic import writing
from .flow_formats import READERS, UNKNOWN_FROM, WRITERS, npz_times
from .limits import max_pixels_of, opened

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["FLOW_SUFFIXES", "FlowLike", "read_flow", "read_flow_times", "write_flow"]

FLOW_SUFFIXES = (".flo", ".png", ".npy", ".npz", ".pfm")


class FlowLike(Protocol):
    """What has a flow and says where it is known, as a `FlowField` does.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> from types import SimpleNamespace
    >>> field = SimpleNamespace(uv=np.ones((4, 6, 2), np.float32), valid=np.zeros((4, 6), bool))
    >>> rsflow.flow_to_color(field).any()  # black where nothing is known
    np.False_
    """

    @property
    def uv(self) -> NDArray[np.float32]:
        """Displacement in pixels, (height, width, 2)."""

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where it is known, (height, width)."""


def read_flow(path: str | os.PathLike[str], *, max_pixels: int | None = None) -> NDArray[np.float32]:
    """Read a flow field; the suffix says the format.

    Parameters
    ----------
    path : path
        ``.flo`` (Middlebury), ``.png`` (KITTI, 16 bits), ``.npy`` ((height, width, 2)), ``.npz`` (``flow`` and, if it
        is there, ``valid``) or ``.pfm`` (three channels, the third is not used, nor is the size of the scale).
    max_pixels : int, optional
        Pixels that a flow may have, 2**28 by default or what the environment variable ``RSFLOW_MAX_PIXELS`` says.

    Returns
    -------
    ndarray of float32, (height, width, 2)
        Displacement in pixels, x then y; NaN in both where it is unknown.

    Raises
    ------
    FormatError
        If the suffix is not one of these, the content is not what the format demands, the file is shorter or longer
        than its header says or no regular file, or the flow is beyond the limit.
    OSError
        If the file cannot be opened.

    Notes
    -----
    Formats: S. Baker et al., "A Database and Evaluation Methodology for Optical Flow", IJCV 92, 2011 (``.flo``);
    M. Menze and A. Geiger, "Object Scene Flow for Autonomous Vehicles", CVPR 2015 (``.png``); P. Debevec's portable
    float map (``.pfm``).

    Examples
    --------
    >>> import numpy as np, rsflow, tempfile, pathlib
    >>> flow = np.zeros((4, 6, 2), np.float32)
    >>> flow[..., 0] = 1.5
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     rsflow.write_flow(pathlib.Path(folder, "a.flo"), flow)
    ...     print(rsflow.read_flow(pathlib.Path(folder, "a.flo"))[2, 3])
    [1.5 0. ]
    """
    path = _checks.path("path", path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise FormatError(f"{path}: cannot tell the flow format of {path.suffix!r}; expected one of {_names()}")
    limit = max_pixels_of(max_pixels)
    with opened(path) as (file, size):
        uv = reader(path, file, size, limit)
    unknown = ~(np.abs(uv) <= UNKNOWN_FROM).all(axis=2)
    uv[unknown] = np.nan
    return uv


def read_flow_times(path: str | os.PathLike[str]) -> tuple[float, float] | None:
    """Read the times of the two pictures of a flow from a ``.npz``, in seconds.

    Parameters
    ----------
    path : path
        A flow file.

    Returns
    -------
    (t0_s, t1_s) or None
        None where the file has no times, as with every format but ``.npz``.

    Raises
    ------
    FormatError
        If the file is not a flow in a ``.npz``, or its times are not numbers.

    Examples
    --------
    >>> import numpy as np, pathlib, tempfile
    >>> from rsflow.io import read_flow_times, write_flow
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_flow(pathlib.Path(folder, "a.npz"), np.zeros((4, 6, 2)), t0_s=0.5, t1_s=0.54)
    ...     read_flow_times(pathlib.Path(folder, "a.npz"))
    (0.5, 0.54)
    """
    path = _checks.path("path", path)
    if path.suffix.lower() != ".npz":
        return None
    with opened(path) as (file, _):
        return npz_times(path, file)


def write_flow(
    path: str | os.PathLike[str],
    field: FlowLike | ArrayLike,
    *,
    t0_s: float | None = None,
    t1_s: float | None = None,
) -> None:
    """Write a flow field; the suffix says the format.

    The file is written beside its final name and renamed, so nothing partial stands under it.

    Parameters
    ----------
    path : path
        ``.flo``, ``.png`` (KITTI: steps of 1/64 px, from -512 to 511.98), ``.npy``, ``.npz`` or ``.pfm``. Folders that
        are missing are made.
    field : FlowField or array_like, (height, width, 2)
        Displacement in pixels, x then y. Where it is not finite or masked, or the field says not valid, it is unknown:
        1e10 in ``.flo``, all zero in a ``.png``, NaN elsewhere.
    t0_s, t1_s : float, optional
        Times of the two pictures in seconds, kept by ``.npz`` alone as ``t0`` and ``t1``.

    Raises
    ------
    ShapeError
        If the field is not (height, width, 2), has no pixel, or is valid in another shape.
    DTypeError
        If the field is not of numbers.
    OptionError
        If the suffix is not one of these, a ``.png`` cannot hold so large a displacement, or a time is not a finite
        number.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import numpy as np, pathlib, rsflow, tempfile
    >>> uv = np.full((4, 6, 2), 1.5, np.float32)
    >>> uv[0, 0] = np.nan
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "motion.flo")
    ...     rsflow.write_flow(path, uv)
    ...     again = rsflow.read_flow(path)
    >>> np.array_equal(again, uv, equal_nan=True)
    True
    """
    path = expect_flow_name(path)
    first = _checks.number_or_none("t0_s", t0_s, of="seconds")
    second = _checks.number_or_none("t1_s", t1_s, of="seconds")
    if (first is None) != (second is None):
        raise OptionError(f"t0_s, t1_s: got {first} and {second}, expected both or none")
    times = {} if first is None or second is None else {"t0": first, "t1": second}
    uv = known_flow(field)
    with writing(path) as partial:
        WRITERS[path.suffix.lower()](partial, uv, times)


def expect_flow_name(path: object) -> Path:
    """Take a path whose suffix says a format of flow to write."""
    return _checks.file_name("path", path, FLOW_SUFFIXES)


def known_flow(field: FlowLike | ArrayLike, name: str = "field") -> NDArray[np.float32]:
    """Displacements of a field or an array as a new float32 array, NaN in both components where unknown."""
    if field is None:
        raise DTypeError(f"{name}: got None, as DenseFlow gives for its first frame, expected an array or a FlowField")
    valid = getattr(field, "valid", None)
    given = getattr(field, "uv", field)
    plain = given.data if isinstance(given, np.ma.MaskedArray) else given
    array = _checks.array(name, plain, ("height", "width", 2), "a flow, (height, width, 2), of real numbers")
    if array.size == 0:
        raise ShapeError(f"{name}: got shape {array.shape}, expected at least one pixel")
    with np.errstate(over="ignore"):
        uv = np.array(array, np.float32)
    unknown = ~(np.abs(uv) <= UNKNOWN_FROM).all(axis=2)
    if isinstance(given, np.ma.MaskedArray):
        unknown |= np.ma.getmaskarray(given).any(axis=2)
    if valid is not None:
        unknown |= ~_checks.bools(f"{name}.valid", valid, unknown.shape, "the flow")
    uv[unknown] = np.nan
    return uv


def _names() -> str:
    return ", ".join(FLOW_SUFFIXES)
