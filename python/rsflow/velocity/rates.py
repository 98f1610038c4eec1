"""Angular rates from a log of a gyro, and their exact mean over the time between two frames."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import fields
from .log_columns import ORIGINS, Columns, read_log
from .timeline import Timeline, log_times

__all__ = ["Rates"]

F64 = NDArray[np.float64]

COLUMNS = (
    Columns(("rate_x_rad_s", "rate_y_rad_s", "rate_z_rad_s")),
    Columns(("gyro_rad[0]", "gyro_rad[1]", "gyro_rad[2]"), "PX4"),
    Columns(("xyz[0]", "xyz[1]", "xyz[2]"), "PX4"),
    Columns(("GyrX", "GyrY", "GyrZ"), "ArduPilot"),
)

# Nothing that carries a camera turns so fast (2,300 degrees a second are 40 rad/s, the most that gyros measure).
MOST_RAD_S = 100.0


@dataclass(frozen=True, eq=False)
class Rates:
    """Angular rates of a body by time, as a gyro's log has them: straight lines between the rows.

    Attributes
    ----------
    t_s : (N,) float64
        Increasing.
    rate_rad_s : (N, 3) float64
        About the body's axes, right-handed; NaN in a row without a value.
    origin : {"", "PX4", "ArduPilot"}
        Whose log it is; of the last two the axes are forward, right, down.
    remarks : tuple of str
        What was found when the log was read: which of several sensors was taken.

    Examples
    --------
    >>> import numpy as np
    >>> rates = Rates(np.array([0.0, 0.1, 0.2]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    >>> rates.mean(0.05, 0.15).round(3).tolist(), rates.mean(0.5, 0.6).tolist()
    ([0.0, 0.0, 0.75], [nan, nan, nan])
    """

    t_s: F64
    rate_rad_s: F64
    origin: str = ""
    remarks: tuple[str, ...] = ()

    __repr__ = fields

    def __post_init__(self) -> None:
        times = log_times("t_s", self.t_s)
        expected = f"({len(times)}, 3) numbers, a row for each of t_s"
        rate = _checks.array("rate_rad_s", self.rate_rad_s, (len(times), 3), expected).astype(np.float64)
        rate[~np.isfinite(rate).all(axis=1)] = np.nan
        _checks.choice("origin", self.origin, ORIGINS)
        object.__setattr__(self, "t_s", times)
        object.__setattr__(self, "rate_rad_s", rate)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Rates:
        """Read a CSV with the columns ``rate_x_rad_s``, ``rate_y_rad_s``, ``rate_z_rad_s`` and one of times.

        Times are in ``t_s``, ``t_ms``, ``t_us`` or ``t_ns``. Of PX4's logs (``ulog2csv``) the tables
        ``sensor_combined`` (``gyro_rad[0]`` to ``[2]``) and ``vehicle_angular_velocity`` (``xyz[0]`` to ``[2]``) are
        read with their own times, of ArduPilot's (``mavlogdump.py --format csv --types IMU``) ``GyrX``, ``GyrY``,
        ``GyrZ``. An empty cell is a rate that is not known.

        Parameters
        ----------
        path : path
            The file.

        Returns
        -------
        Rates

        Raises
        ------
        FormatError
            If a column is missing, a value is no number or no rate in rad/s, times do not increase, or there is no row;
            the message names file and line.
        OSError
            If the file cannot be read.
        """
        path = _checks.path("path", path)
        log = read_log(path, "rates", COLUMNS)
        rate = log.values()
        too_fast = np.abs(np.where(np.isnan(rate), 0.0, rate)).max(axis=1) > MOST_RAD_S
        if too_fast.any():
            at = int(np.argmax(too_fast))
            raise log.table.error(at, f"got {rate[at].tolist()}, expected rates in rad/s: are they degrees per second?")
        times = log.t_s
        # What PX4 calls a rate there is its mean over the time before: it is that of the middle of it.
        span_us = log.optional("gyro_integral_dt") if log.columns.origin == "PX4" else None
        if span_us is not None and np.isfinite(span_us).all() and (span_us >= 0).all() and span_us.max() < 1e5:
            middle = times - 0.5e-6 * span_us
            times = middle if (np.diff(middle) > 0).all() else times
        return cls(times, rate, log.columns.origin, log.notes)

    @cached_property
    def _known(self) -> tuple[Timeline, F64]:
        known = np.isfinite(self.rate_rad_s[:, 0])
        return Timeline.of(self.t_s, known), self.rate_rad_s[known]

    @property
    def span(self) -> str:
        """What the log covers, in words."""
        return f"times from {self.t_s[0]:g} to {self.t_s[-1]:g} s"

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know of the log, in sentences: its remarks, and where it has holes."""
        return tuple(text for text in (*self.remarks, self._known[0].told("rates")) if text)

    def mean(self, begin_s: float, end_s: float, *, delay_s: float = 0.0) -> F64:
        """Give the mean rate over an interval: the exact integral of the straight lines, over its length.

        Parameters
        ----------
        begin_s, end_s : float
            The interval: times of two frames, in the clock of `t_s`.
        delay_s : float
            How much later than it happened a rate stands in the log: what was at t stands at t + delay.

        Returns
        -------
        (3,) float64
            In rad/s; NaN where the interval reaches out of the log, or into a hole: a step of more than four usual
            ones.

        Raises
        ------
        OptionError
            If an argument is no number.

        Examples
        --------
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> rates = Rates(t, np.outer(2.0 * t, [1.0, 0.0, 0.0]))
        >>> rates.mean(0.0, 0.5)[0].round(6), rates.mean(0.0, 0.5, delay_s=0.25)[0].round(6)
        (np.float64(0.5), np.float64(1.0))
        """
        begin_s = _checks.number("begin_s", begin_s, of="seconds", or_nan=True)
        end_s = _checks.number("end_s", end_s, of="seconds", or_nan=True)
        delay_s = _checks.number("delay_s", delay_s, of="seconds")
        line, rate = self._known
        begin, end = begin_s + delay_s, end_s + delay_s
        rows = line.inside(begin, end)
        if rows is None:
            return np.full(3, np.nan)
        knots = np.concatenate([[begin], line.t_s[rows], [end]])
        values = np.concatenate([_on_line(line.t_s, rate, begin), rate[rows], _on_line(line.t_s, rate, end)])
        steps = np.diff(knots)[:, None]
        return np.asarray((0.5 * steps * (values[1:] + values[:-1])).sum(axis=0) / (end - begin), dtype=np.float64)


def _on_line(t_s: F64, rate: F64, at_s: float) -> F64:
    """Give the rate at a time on the line between two rows, (1, 3); outside of all that of the nearest row."""
    row = min(max(int(np.searchsorted(t_s, at_s, side="right")) - 1, 0), len(t_s) - 1)
    after = min(row + 1, len(t_s) - 1)
    step = float(t_s[after] - t_s[row])
    share = min(max(float(at_s - t_s[row]) / step, 0.0), 1.0) if step > 0 else 0.0
    return (1.0 - share) * rate[row : row + 1] + share * rate[after : after + 1]
