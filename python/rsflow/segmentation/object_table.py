"""A thing that moves, and the table of all of them over the frames of a sequence."""

from __future__ import annotations

import csv
import dataclasses
import math
import os
from typing import TYPE_CHECKING, Any, TextIO

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
    "state",
    "missed_frames",
    "x_std_px",
    "y_std_px",
    "vx_px_s",
    "vy_px_s",
    "vx_std_px_s",
    "vy_std_px_s",
    "speed_px_s",
    "speed_std_px_s",
    "direction_rad",
    "x_ground_px",
    "y_ground_px",
    "travelled_px",
    "vx_m_s",
    "vy_m_s",
    "vx_std_m_s",
    "vy_std_m_s",
    "speed_m_s",
    "speed_std_m_s",
    "travelled_m",
)


@dataclasses.dataclass(frozen=True)
class TrackedObject:
    """A thing that moves, in one frame.

    Attributes
    ----------
    id : int
        Stays the same over the frames, from 1, never used twice.
    x, y : float
        Centre of its pixels; where these are not seen alone, see `state`, its believed place.
    box : (x, y, width, height) of int
        The smallest upright box around its pixels; of a hidden thing where it is predicted.
    area : int
        Its number of pixels, 0 of a hidden thing.
    vx_px_per_frame, vy_px_per_frame : float
        Its motion against the still surroundings in pixels per frame, smoothed over the frames: from the motion of its
        pixels and from the way of its centre, each by its deviation. NaN as long as neither is known: in its first
        frame without motion, and where it changed its shape then.
    age_frames : int
        For how many frames it has been seen, this one included.
    state : {"seen", "merged", "hidden"}
        Whether it is seen by itself, in one region with others, or not at all: then it is predicted.
    missed_frames : int
        For how many frames it has been hidden.
    x_std_px, y_std_px : float
        Standard deviation of its believed place.
    vx_std_px_per_frame, vy_std_px_per_frame : float
        Standard deviation of its velocity; infinite where that is not known.
    interval_s : float
        Time of a frame in seconds; NaN where frames have no times.
    x_ground_px, y_ground_px : float
        Its place in the picture of the first frame: over the ground, where the camera moves. NaN where the camera's
        motion since then is not known.
    travelled_px : float
        Length of its path there.

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
    state: str = "seen"
    missed_frames: int = 0
    x_std_px: float = math.nan
    y_std_px: float = math.nan
    vx_std_px_per_frame: float = math.nan
    vy_std_px_per_frame: float = math.nan
    interval_s: float = math.nan
    x_ground_px: float = math.nan
    y_ground_px: float = math.nan
    travelled_px: float = math.nan

    def __repr__(self) -> str:
        what = f"TrackedObject(id={self.id}, {self.state}, x={self.x:.1f}, y={self.y:.1f}, box={self.box}"
        speed = f"vx_px_per_frame={self.vx_px_per_frame:.2f}, vy_px_per_frame={self.vy_px_per_frame:.2f}"
        return f"{what}, area={self.area}, {speed}, age_frames={self.age_frames})"

    @property
    def vx_px_s(self) -> float:
        """Its velocity to the right against the still surroundings, in pixels per second."""
        return self.vx_px_per_frame / self.interval_s

    @property
    def vy_px_s(self) -> float:
        """The same, downwards."""
        return self.vy_px_per_frame / self.interval_s

    @property
    def vx_std_px_s(self) -> float:
        """Standard deviation of `vx_px_s`."""
        return self.vx_std_px_per_frame / self.interval_s

    @property
    def vy_std_px_s(self) -> float:
        """Standard deviation of `vy_px_s`."""
        return self.vy_std_px_per_frame / self.interval_s

    @property
    def speed_px_s(self) -> float:
        """Length of its velocity, in pixels per second."""
        return math.hypot(self.vx_px_s, self.vy_px_s)

    @property
    def speed_std_px_s(self) -> float:
        """Standard deviation of `speed_px_s`: along the velocity, or of a component where that is less than it."""
        return speed_std(self.vx_px_s, self.vy_px_s, self.vx_std_px_s, self.vy_std_px_s)

    @property
    def direction_rad(self) -> float:
        """Where it goes: 0 to the right, growing clockwise as seen, -pi to pi; NaN where its speed is not known."""
        return math.atan2(self.vy_px_per_frame, self.vx_px_per_frame)

    def to_dict(self, scale_m_per_px: float = math.nan) -> dict[str, Any]:
        """Give it as a row of ``objects.csv`` without frame and time, for ``pandas.DataFrame`` a list of such.

        Parameters
        ----------
        scale_m_per_px : float
            Metres on the ground for each pixel where it is; without it the columns in metres are NaN.

        Returns
        -------
        dict of str to int, float or str

        Examples
        --------
        >>> row = TrackedObject(1, 19.5, 14.5, (16, 10, 8, 10), 80, 3.0, 0.0, 3, interval_s=0.5).to_dict(0.01)
        >>> row["id"], row["left_px"], row["vx_px_per_frame"], row["vx_px_s"], row["vx_m_s"]
        (1, 16, 3.0, 6.0, 0.06)
        """
        left, top, width, height = (int(number) for number in self.box)
        scale = _checks.number("scale_m_per_px", scale_m_per_px, or_nan=True)
        vx, vy, vx_std, vy_std = self.vx_px_s, self.vy_px_s, self.vx_std_px_s, self.vy_std_px_s
        speed, deviation = math.hypot(vx, vy), self.speed_std_px_s
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
            "state": self.state,
            "missed_frames": self.missed_frames,
            "x_std_px": float(self.x_std_px),
            "y_std_px": float(self.y_std_px),
            "vx_px_s": vx,
            "vy_px_s": vy,
            "vx_std_px_s": vx_std,
            "vy_std_px_s": vy_std,
            "speed_px_s": speed,
            "speed_std_px_s": deviation,
            "direction_rad": self.direction_rad,
            "x_ground_px": float(self.x_ground_px),
            "y_ground_px": float(self.y_ground_px),
            "travelled_px": float(self.travelled_px),
            "vx_m_s": vx * scale,
            "vy_m_s": vy * scale,
            "vx_std_m_s": vx_std * scale,
            "vy_std_m_s": vy_std * scale,
            "speed_m_s": speed * scale,
            "speed_std_m_s": deviation * scale,
            "travelled_m": float(self.travelled_px) * scale,
        }


def speed_std(vx: float, vy: float, vx_std: float, vy_std: float) -> float:
    """Give the standard deviation of the length of a velocity whose components are independent."""
    speed = math.hypot(vx, vy)
    if not (math.isfinite(vx_std) and math.isfinite(vy_std)):
        return vx_std + vy_std
    if speed <= max(vx_std, vy_std) or math.isnan(speed):
        return max(vx_std, vy_std)
    return math.hypot(vx * vx_std, vy * vy_std) / speed


class ObjectTable:
    """Write ``objects.csv``: a row for each object in each frame, units in the names of the columns.

    Used as a context manager. The file is written beside its final name and renamed; it is kept as far as it is when
    the body is interrupted by Ctrl-C, and removed on any other exception.

    Parameters
    ----------
    path : path
        Where to write it.
    scale_m_per_px : float, optional
        Metres on the ground for each pixel; without it the columns in metres are NaN.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "objects.csv")
    ...     with ObjectTable(path) as table:
    ...         table.write(7, 0.28, [TrackedObject(1, 19.5, 14.5, (16, 10, 8, 10), 80, 3.0, 0.0, 3)])
    ...     print(path.read_text().splitlines()[1][:48])
    7,0.280000,1,3,19.50,14.50,16,10,8,10,80,3.000,0
    """

    def __init__(self, path: str | os.PathLike[str], *, scale_m_per_px: float | None = None) -> None:
        self._path = _checks.path("path", path)
        scale = _checks.number_or_none("scale_m_per_px", scale_m_per_px, above=0, of="metres")
        self._scale = math.nan if scale is None else scale
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
            row = thing.to_dict(self._scale)
            time = f"{t_s:.6f}" if math.isfinite(t_s) else ""
            self._rows.writerow([frame, time, *(_text(name, row[name]) for name in OBJECT_COLUMNS[2:])])


# Decimals of places, and of other lengths, velocities and angles.
_PLACE, _OTHER = 2, 3
_EXACT = ("id", "age_frames", "left_px", "top_px", "width_px", "height_px", "area_px", "state", "missed_frames")


def _text(name: str, value: Any) -> Any:
    if name in _EXACT:
        return value
    if name.endswith("_m_s") or name.endswith("_m"):
        return f"{value:.6g}"
    return f"{value:.{_PLACE if name in ('x_px', 'y_px') else _OTHER}f}"
