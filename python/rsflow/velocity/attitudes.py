"""Where straight down is, from a log of attitudes."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import fields
from .log_columns import ORIGINS, Columns, Log, read_log
from .timeline import Timeline, log_times

__all__ = ["Attitudes", "Earth"]

F64 = NDArray[np.float64]
Earth = Literal["ned", "enu"]

COLUMNS = (
    Columns(("down_x", "down_y", "down_z")),
    Columns(("qw", "qx", "qy", "qz")),
    Columns(("roll_rad", "pitch_rad")),
    Columns(("q[0]", "q[1]", "q[2]", "q[3]"), "PX4"),
    Columns(("Roll", "Pitch"), "ArduPilot"),
)

# A quaternion may be rounded to so much.
_ROUNDING = 0.02
# Two directions that are further apart than this have no direction between them that a log tells.
_OPPOSITE_RAD = 3.0


@dataclass(frozen=True, eq=False)
class Attitudes:
    """Directions of straight down in a body's axes by time, as a log of attitudes has them.

    Attributes
    ----------
    t_s : (N,) float64
        Increasing.
    directions : (N, 3) float64
        Straight down in the body's axes, unit vectors; NaN in a row without one.
    origin : {"", "PX4", "ArduPilot"}
        Whose log it is; of the last two the axes are forward, right, down.
    remarks : tuple of str
        What was found when the log was read.

    Examples
    --------
    >>> import numpy as np
    >>> attitudes = Attitudes(np.array([0.0, 0.1]), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]))
    >>> np.degrees(np.arcsin(attitudes.down(0.05)[0])).round(2), attitudes.down(0.3).tolist()
    (np.float64(22.5), [nan, nan, nan])
    """

    t_s: F64
    directions: F64
    origin: str = ""
    remarks: tuple[str, ...] = ()

    __repr__ = fields

    def __post_init__(self) -> None:
        times = log_times("t_s", self.t_s)
        expected = f"({len(times)}, 3) numbers, a row for each of t_s"
        down = _checks.array("directions", self.directions, (len(times), 3), expected).astype(np.float64)
        _checks.choice("origin", self.origin, ORIGINS)
        object.__setattr__(self, "t_s", times)
        object.__setattr__(self, "directions", _unit(down))

    @classmethod
    def read(cls, path: str | os.PathLike[str], *, earth: Earth = "ned") -> Attitudes:
        """Read a CSV with directions, quaternions, or roll and pitch, and a column of times.

        Times are in ``t_s``, ``t_ms``, ``t_us`` or ``t_ns``. The columns are one of: ``down_x,down_y,down_z``, straight
        down in the body's axes, of any length; ``qw,qx,qy,qz``, the rotation that takes vectors from the body's axes to
        the earth's; ``roll_rad,pitch_rad`` of a body with axes forward, right, down (right side down and nose up are
        positive). Of PX4's logs (``ulog2csv``) the table ``vehicle_attitude`` (``q[0]`` to ``q[3]``) is read with its
        own times, of ArduPilot's (``mavlogdump.py --format csv --types ATT``) ``Roll,Pitch``, in degrees.

        Parameters
        ----------
        path : path
            The file.
        earth : {"ned", "enu"}
            The earth's axes of ``qw,qx,qy,qz``: north, east, down as in PX4, or east, north, up as in ROS.

        Returns
        -------
        Attitudes

        Raises
        ------
        FormatError
            If a column is missing, a value is no number, no unit quaternion or no angle in rad, times do not increase,
            or there is no row; the message names file and line.
        OSError
            If the file cannot be read.
        """
        path = _checks.path("path", path)
        _checks.choice("earth", earth, ("ned", "enu"))
        log = read_log(path, "attitudes", COLUMNS)
        names = log.columns.names
        if names == ("Roll", "Pitch"):
            down = of_roll_pitch(*np.radians(log.values()).T)
        elif names == ("roll_rad", "pitch_rad"):
            down = of_roll_pitch(*_angles(log).T)
        elif len(names) == 4:
            down = _of_quaternions(log) * (-1.0 if earth == "enu" and not log.columns.origin else 1.0)
        else:
            down = log.values()
        return cls(log.t_s, down, log.columns.origin, log.notes)

    @property
    def span(self) -> str:
        """What the log covers, in words."""
        return f"times from {self.t_s[0]:g} to {self.t_s[-1]:g} s"

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know of the log, in sentences: its remarks, and where it has holes."""
        return tuple(text for text in (*self.remarks, self._known[0].told("attitudes")) if text)

    @cached_property
    def _known(self) -> tuple[Timeline, F64]:
        known = np.isfinite(self.directions[:, 0])
        return Timeline.of(self.t_s, known), self.directions[known]

    def down(self, t_s: float) -> F64:
        """Give straight down at a time: on the great circle between two rows, at the share of their time.

        Parameters
        ----------
        t_s : float
            In the clock of the attribute `t_s`.

        Returns
        -------
        (3,) float64
            A unit vector in the body's axes; NaN out of the log, and in a hole: a step of more than four usual ones.

        Raises
        ------
        OptionError
            If `t_s` is no number.
        """
        t_s = _checks.number("t_s", t_s, of="seconds", or_nan=True)
        line, known = self._known
        found = line.between(t_s)
        if found is None:
            return np.full(3, np.nan)
        row, share = found
        if share == 0.0:
            return np.array(known[row])
        before, after = known[row], known[row + 1]
        angle = float(np.arctan2(np.linalg.norm(np.cross(before, after)), before @ after))
        if angle > _OPPOSITE_RAD:
            return np.full(3, np.nan)
        if angle < 1e-6:
            mixed = (1.0 - share) * before + share * after
        else:
            mixed = (np.sin((1.0 - share) * angle) * before + np.sin(share * angle) * after) / np.sin(angle)
        return np.asarray(mixed / np.linalg.norm(mixed), dtype=np.float64)


def of_roll_pitch(roll_rad: F64, pitch_rad: F64) -> F64:
    """Straight down, (N, 3), in axes forward, right, down."""
    flat = np.cos(pitch_rad)
    return np.stack([-np.sin(pitch_rad), np.sin(roll_rad) * flat, np.cos(roll_rad) * flat], axis=1)


def _unit(down: F64) -> F64:
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(down, axis=1)
        known = np.isfinite(length) & (length > 0)
        return np.asarray(np.where(known[:, None], down / np.where(known, length, 1.0)[:, None], np.nan))


def _angles(log: Log) -> F64:
    angles = log.values()
    most = (2 * np.pi, np.pi / 2)
    wrong = (np.abs(np.where(np.isnan(angles), 0.0, angles)) > np.add(most, 1e-3)).any(axis=1)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise log.table.error(at, f"got {angles[at].tolist()}, expected roll and pitch in rad: are they degrees?")
    return angles


def _of_quaternions(log: Log) -> F64:
    """Give the earth's third axis in the body's axes: the third row of the rotation from body to earth."""
    q = log.values()
    length = np.linalg.norm(q, axis=1)
    wrong = np.isfinite(length) & (length > 0) & (np.abs(length - 1.0) > _ROUNDING)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise log.table.error(at, f"got {q[at].tolist()}, expected a quaternion of length 1")
    w, x, y, z = q.T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], axis=1)
