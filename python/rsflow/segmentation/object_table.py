"""A thing that moves, and the table of all of them over the frames of a sequence."""

from __future__ import annotations

import csv
import dataclasses
import os
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from .. import _checks
from ..errors import RsflowError
from ..io.atomic import writing

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["OBJECT_COLUMNS", "ObjectTable", "TrackedObject"]

OBJECT_COLUMNS = (
    "frame",
    "t_s",
    "id",
    "age_frames",
    "x_px",
    "y_px",
    "left_px",
    "top_px",
    "width_px",
    "height_px",
    "area_px",
    "vx_px_per_frame",
    "vy_px_per_frame",
)


@dataclasses.dataclass(frozen=True)
class TrackedObject:
    """A thing that moves, in one frame.

    Attributes
    ----------
    id : int
        Stays the same over the frames, from 1, never used twice.
    x, y : float
        Centre of its pixels.
    box : (x, y, width, height) of int
        The smallest upright box around its pixels.
    area : int
        Its number of pixels.
    vx_px_per_frame, vy_px_per_frame : float
        Its motion against the still surroundings in pixels per frame: the median over its pixels, or where few of
        them have a known motion the way of its centre; NaN in its first frame then, and where it changed its shape.
    age_frames : int
        For how many frames it has been seen, this one included.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.objects import ObjectTracker
    >>> mask = np.zeros((60, 80), bool)
    >>> mask[20:40, 30:50] = True
    >>> (thing,) = ObjectTracker(min_area=50).update(mask)
    >>> thing.id, thing.x, thing.y, thing.box, thing.area
    (1, 39.5, 29.5, (30, 20, 20, 20), 400)
    """

    id: int
    x: float
    y: float
    box: tuple[int, int, int, int]
    area: int
    vx_px_per_frame: float
    vy_px_per_frame: float
    age_frames: int

    def to_dict(self) -> dict[str, Any]:
        """Give it as a row of ``objects.csv`` without frame and time, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to int or float

        Examples
        --------
        >>> row = TrackedObject(1, 19.5, 14.5, (16, 10, 8, 10), 80, 3.0, 0.0, 3).to_dict()
        >>> row["id"], row["left_px"], row["vx_px_per_frame"]
        (1, 16, 3.0)
        """
        left, top, width, height = (int(number) for number in self.box)
        return {
            "id": self.id,
            "age_frames": self.age_frames,
            "x_px": float(self.x),
            "y_px": float(self.y),
            "left_px": left,
            "top_px": top,
            "width_px": width,
            "height_px": height,
            "area_px": int(self.area),
            "vx_px_per_frame": float(self.vx_px_per_frame),
            "vy_px_per_frame": float(self.vy_px_per_frame),
        }


class ObjectTable:
    """Write ``objects.csv``: a row for each object in each frame, units in the names of the columns.

    Used as a context manager. The file is written beside its final name and renamed; it is kept as far as it is when
    the body is interrupted by Ctrl-C, and removed on any other exception.

    Parameters
    ----------
    path : path
        Where to write it.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "objects.csv")
    ...     with ObjectTable(path) as table:
    ...         table.write(7, 0.28, [TrackedObject(1, 19.5, 14.5, (16, 10, 8, 10), 80, 3.0, 0.0, 3)])
    ...     print(path.read_text().splitlines()[1])
    7,0.280000,1,3,19.50,14.50,16,10,8,10,80,3.000,0.000
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = _checks.path("path", path)
        self._writing = writing(self._path)
        self._file: TextIO | None = None
        self._rows: Any = None

    def __repr__(self) -> str:
        return f'ObjectTable("{self._path}"): {"closed" if self._file is None or self._file.closed else "open"}'

    def __enter__(self) -> ObjectTable:
        self._file = self._writing.__enter__().open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(OBJECT_COLUMNS)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if self._file is not None:
            self._file.close()
        if kind is None or kind is KeyboardInterrupt:
            self._writing.__exit__(None, None, None)
        else:
            self._writing.__exit__(kind, error, None)

    def write(self, frame: int, t_s: float, objects: Iterable[TrackedObject]) -> None:
        """Append the objects of a frame.

        Parameters
        ----------
        frame : int
            Its number in the source.
        t_s : float
            Its time in seconds.
        objects : iterable of TrackedObject
            What moves in it.
        """
        if self._rows is None:
            raise RsflowError(
                "ObjectTable: got a row before the file is open, expected `with ObjectTable(path) as table`"
            )
        frame = _checks.integer("frame", frame)
        t_s = _checks.number("t_s", t_s, of="seconds", or_nan=True)
        for thing in _checks.iterable("objects", objects, "TrackedObjects"):
            _checks.instance("objects", thing, TrackedObject, "TrackedObjects")
            self._rows.writerow(
                [
                    frame,
                    f"{t_s:.6f}" if np.isfinite(t_s) else "",
                    thing.id,
                    thing.age_frames,
                    f"{thing.x:.2f}",
                    f"{thing.y:.2f}",
                    *thing.box,
                    thing.area,
                    f"{thing.vx_px_per_frame:.3f}",
                    f"{thing.vy_px_per_frame:.3f}",
                ]
            )
