"""What a user's instruments say of a flight: a gyro, a range finder and a clock, each with its faults."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import fields
from ..errors import OptionError
from ..io.atomic import writing
from .flights import Flight

__all__ = ["Clock", "Gyro", "GyroLog", "RangeFinder", "RangeLog"]

F64 = NDArray[np.float64]

Along = Literal["axis", "down"]


@dataclass(frozen=True, eq=False)
class GyroLog:
    """Readings of a gyro.

    Attributes
    ----------
    t_s : (M,) float64
        Time stamp of each reading.
    rate_rad_s : (M, 3) float64
        Angular rate, right-handed, in the body's axes.
    means : bool
        Whether a reading is the mean rate since the one before, or the rate of a moment.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=3, rate_rad_s=(0.0, 0.0, 0.5), seed=1)
    >>> synthetic.Gyro(rate_hz=200.0).log(flight).between(flight.t_s).round(6).tolist()
    [[nan, nan, nan], [0.0, 0.0, 0.5], [0.0, 0.0, 0.5]]
    """

    t_s: F64
    rate_rad_s: F64
    means: bool = False

    __repr__ = fields

    def between(self, times_s: ArrayLike) -> F64:
        """Mean rate in each interval between times, as `rsflow.VelocityEstimator.update` takes it.

        Readings of moments are joined by lines, means are held over their interval.

        Parameters
        ----------
        times_s : (N,) array_like
            Increasing, as of the frames.

        Returns
        -------
        (N, 3) float64
            Row k is the mean since time k - 1; row 0, and rows for which there are no readings, are NaN.
        """
        times = _times(times_s)
        if self.means:
            angle = np.vstack([np.zeros(3), np.cumsum(self.rate_rad_s[1:] * np.diff(self.t_s)[:, None], axis=0)])
            at = np.column_stack([np.interp(times, self.t_s, angle[:, k], np.nan, np.nan) for k in range(3)])
        else:
            every = np.union1d(self.t_s, np.clip(times, self.t_s[0], self.t_s[-1]))
            rate = np.column_stack([np.interp(every, self.t_s, self.rate_rad_s[:, k]) for k in range(3)])
            steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(every)[:, None]
            angle = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
            at = np.column_stack([np.interp(times, every, angle[:, k], np.nan, np.nan) for k in range(3)])
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.diff(at, axis=0) / np.diff(times)[:, None]
        return np.vstack([np.full((1, 3), np.nan), mean])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as a CSV file that ``rsflow velocity --rates`` reads.

        Parameters
        ----------
        path : path

        Examples
        --------
        >>> GyroLog(np.array([0.0, 0.01]), np.zeros((2, 3))).save("gyro.csv")
        >>> from pathlib import Path
        >>> Path("gyro.csv").read_text().split()[0]
        't_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s'
        """
        _write(path, ("t_s", "rate_x_rad_s", "rate_y_rad_s", "rate_z_rad_s"), self.t_s, self.rate_rad_s)


@dataclass(frozen=True)
class Gyro:
    """A gyro fixed to the camera: what it says of a flight.

    Attributes
    ----------
    rate_hz : float
        Readings per second, on a clock of its own.
    delay_s : float
        How far it lags: the reading stamped t is of the motion at t - delay_s. Negative: its stamps are late.
    bias_rad_s : (3,) float
        What it shows at rest, in the body's axes.
    noise_rad_s : float
        Standard deviation of each axis of a reading.
    scale : float
        What it shows of a rate of 1.
    means : bool
        Whether a reading is the mean rate since the one before, or the rate of a moment.
    R_body_from_camera : (3, 3) float, optional
        Rotation from the camera's axes to the body's, in which it measures; another one than the estimator is told is
        a mounting error, one of determinant -1 a wrong sign.
    seed : int
        Of the noise, and of how its clock falls between the frames.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=30, rate_rad_s=(0.1, 0.0, 0.0), velocity_m_s=(0.02, 0, 0), seed=1)
    >>> log = Gyro(rate_hz=200.0, bias_rad_s=(0.0, 0.03, 0.02), noise_rad_s=0.01, seed=1).log(flight)
    >>> log.rate_rad_s.mean(axis=0).round(2).tolist()
    [0.1, 0.03, 0.02]
    """

    rate_hz: float = 200.0
    delay_s: float = 0.0
    bias_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise_rad_s: float = 0.0
    scale: float = 1.0
    means: bool = False
    R_body_from_camera: ArrayLike | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        _number(self, "rate_hz", 1e-3, 1e6, "readings per second")
        _number(self, "delay_s", -10, 10, "seconds")
        _number(self, "noise_rad_s", 0, 1e6, "rad/s")
        _number(self, "scale", -1e6, 1e6)
        bias = _checks.vector("bias_rad_s", self.bias_rad_s, 3, "three finite rates in rad/s")
        object.__setattr__(self, "bias_rad_s", tuple(bias.tolist()))
        _checks.flag("means", self.means)
        if self.R_body_from_camera is not None:
            expected = "orthonormal rows, (3, 3)"
            turn = _checks.array("R_body_from_camera", self.R_body_from_camera, (3, 3), expected, finite=True)
            if np.abs(turn).max() > 2 or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
                raise OptionError(f"R_body_from_camera: got {turn.tolist()}, expected {expected}")
        object.__setattr__(self, "seed", _checks.integer("seed", self.seed, least=0))

    def log(self, flight: Flight) -> GyroLog:
        """Measure a flight, from a little before its first frame to a little after its last."""
        flight = _checks.instance("flight", flight, Flight, "a Flight")
        rng = np.random.default_rng([self.seed, 67_867_967])
        t = _clock(flight, self.rate_hz, rng)
        moved = t - self.delay_s
        path = flight.path
        rate = path.means(moved - 1.0 / self.rate_hz, moved)[1] if self.means else path.rate_at(moved)
        turn = np.eye(3) if self.R_body_from_camera is None else np.asarray(self.R_body_from_camera, dtype=np.float64)
        shown = self.scale * rate @ turn.T + self.bias_rad_s
        return GyroLog(t, shown + self.noise_rad_s * rng.standard_normal(shown.shape), self.means)


@dataclass(frozen=True, eq=False)
class RangeLog:
    """Readings of a range finder or an altimeter.

    Attributes
    ----------
    t_s : (M,) float64
        Time stamp of each reading.
    range_m : (M,) float64
        NaN where it saw nothing.
    along : {"axis", "down"}
        Whether it is measured along the optical axis, or straight down: a height.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=5, rate_hz=60.0, height_m=0.2, seed=1)
    >>> log = synthetic.RangeFinder(rate_hz=20.0).log(flight)
    >>> log.at(flight.t_s, hold=True).round(6).tolist()
    [0.2, 0.2, 0.2, 0.2, 0.2]
    """

    t_s: F64
    range_m: F64
    along: Along = "axis"

    __repr__ = fields

    def at(self, times_s: ArrayLike, *, hold: bool = False) -> F64:
        """Give the newest reading at each time, as a program has it that takes what has come since the last frame.

        Parameters
        ----------
        times_s : (N,) array_like
            Increasing, as of the frames.
        hold : bool
            Whether an old reading is given again where there is no new one; else NaN.

        Returns
        -------
        (N,) float64
            NaN where there is no reading.
        """
        times, hold = _times(times_s), _checks.flag("hold", hold)
        newest = np.searchsorted(self.t_s, times, side="right") - 1
        values = np.where(newest >= 0, self.range_m[np.clip(newest, 0, None)], np.nan)
        old = np.concatenate([[False], newest[1:] == newest[:-1]])
        return values if hold else np.where(old, np.nan, values)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as a CSV file that ``rsflow velocity`` reads, as ``--range-csv`` or ``--height-csv``.

        Readings that saw nothing are left out, as a logger does that has nothing to write.

        Parameters
        ----------
        path : path

        Examples
        --------
        >>> RangeLog(np.array([0.0, 0.05]), np.array([0.6, np.nan]), along="down").save("heights.csv")
        >>> from pathlib import Path
        >>> Path("heights.csv").read_text().split()
        ['t_s,height_m', '0.0,0.6']
        """
        seen = np.isfinite(self.range_m)
        _write(path, ("t_s", "range_m" if self.along == "axis" else "height_m"), self.t_s[seen], self.range_m[seen])


@dataclass(frozen=True)
class RangeFinder:
    """A range finder beside the camera, or an altimeter: what it says of a flight.

    Attributes
    ----------
    rate_hz : float
        Readings per second, on a clock of its own.
    delay_s : float
        How far it lags: the reading stamped t is of the place at t - delay_s.
    noise_m : float
        Standard deviation of a reading.
    noise_share : float
        The same as a share of the distance; both count.
    bias_m : float
        How much too long it measures.
    along : {"axis", "down"}
        Whether it measures along the optical axis (`range_m` of `rsflow.VelocityEstimator.update`), or straight down
        (`height_m`).
    holes_s : sequence of (float, float)
        From when until when it sees nothing.
    seed : int
        Of the noise, and of how its clock falls between the frames.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=61, rate_hz=60.0, velocity_m_s=(0.02, 0.0, 0.05), seed=1)
    >>> log = RangeFinder(rate_hz=20.0, noise_m=0.001, holes_s=[(0.3, 0.7)], seed=1).log(flight)
    >>> readings = log.range_m[(log.t_s > 0.0) & (log.t_s < 1.0)]
    >>> int(np.isnan(readings).sum()), len(readings)
    (8, 20)
    """

    rate_hz: float = 20.0
    delay_s: float = 0.0
    noise_m: float = 0.0
    noise_share: float = 0.0
    bias_m: float = 0.0
    along: Along = "axis"
    holes_s: Sequence[tuple[float, float]] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        _number(self, "rate_hz", 1e-3, 1e6, "readings per second")
        _number(self, "delay_s", -10, 10, "seconds")
        _number(self, "noise_m", 0, 1e6, "metres")
        _number(self, "noise_share", 0, 1e6)
        _number(self, "bias_m", -1e6, 1e6, "metres")
        _checks.choice("along", self.along, get_args(Along))
        holes = _checks.iterable("holes_s", self.holes_s, "pairs of times in seconds")
        pairs = [tuple(_checks.vector("holes_s", hole, 2, "pairs of times in seconds").tolist()) for hole in holes]
        object.__setattr__(self, "holes_s", tuple(pairs))
        object.__setattr__(self, "seed", _checks.integer("seed", self.seed, least=0))

    def log(self, flight: Flight) -> RangeLog:
        """Measure a flight, from a little before its first frame to a little after its last."""
        flight = _checks.instance("flight", flight, Flight, "a Flight")
        rng = np.random.default_rng([self.seed, 86_028_121])
        t = _clock(flight, self.rate_hz, rng)
        position, rotation = flight.path.at(t - self.delay_s)
        distance = -position[:, 2]
        if self.along == "axis":
            cosine = rotation[:, 2, 2]
            # A ray that runs along the ground or above the horizon meets nothing.
            distance = np.where(cosine > 1e-6, distance / np.where(cosine > 1e-6, cosine, 1.0), np.nan)
        spread = np.hypot(self.noise_m, self.noise_share * distance)
        shown = distance + self.bias_m + spread * rng.standard_normal(len(t))
        for start, stop in self.holes_s:
            shown[(t >= start) & (t < stop)] = np.nan
        return RangeLog(t, np.where(shown > 0, shown, np.nan), self.along)


@dataclass(frozen=True)
class Clock:
    """The clock that stamps the frames: times as told, in place of those at which they were taken.

    Attributes
    ----------
    jitter_s : float
        Standard deviation of each stamp, by itself.
    offset_s : float
        How late all stamps are.
    rate : float
        Seconds told for a true one: 1.001 runs a tenth of a percent too fast.
    tick_s : float
        Stamps are rounded down to multiples of it; 0 does not round.
    seed : int
        Of the jitter.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=4, rate_hz=30.0, seed=1)
    >>> [round(t, 3) for t in Clock(tick_s=0.01).read(flight.t_s).tolist()]
    [0.0, 0.03, 0.06, 0.1]
    """

    jitter_s: float = 0.0
    offset_s: float = 0.0
    rate: float = 1.0
    tick_s: float = 0.0
    seed: int = field(default=0)

    def __post_init__(self) -> None:
        _number(self, "jitter_s", 0, 1e6, "seconds")
        _number(self, "offset_s", -1e9, 1e9, "seconds")
        _number(self, "rate", 1e-3, 1e3)
        _number(self, "tick_s", 0, 1e6, "seconds")
        object.__setattr__(self, "seed", _checks.integer("seed", self.seed, least=0))

    def read(self, times_s: ArrayLike) -> F64:
        """Give the times that are told, (N,); with much jitter one may be earlier than the one before."""
        times = _times(times_s)
        jitter = np.random.default_rng([self.seed, 104_395_301]).standard_normal(len(times))
        told = self.rate * times + self.offset_s + self.jitter_s * jitter
        # What stands on a tick already must not fall by rounding.
        return np.asarray(np.floor(told / self.tick_s + 1e-9) * self.tick_s if self.tick_s else told, dtype=np.float64)


def _clock(flight: Flight, rate_hz: float, rng: np.random.Generator) -> F64:
    """Give times of readings from before the first frame to after the last, at a phase of their own."""
    spare = max(0.1, 2.0 / rate_hz)
    start, stop = float(flight.t_s[0]) - spare, float(flight.t_s[-1]) + spare
    count = (stop - start) * rate_hz
    if count > 10_000_000:
        raise OptionError(f"rate_hz: got {rate_hz:g} for {stop - start:g} s, expected at most 10000000 readings")
    return np.asarray(start + (rng.uniform() + np.arange(int(count))) / rate_hz, dtype=np.float64)


def _write(path: str | os.PathLike[str], names: Sequence[str], *columns: F64) -> None:
    rows = np.column_stack(columns).tolist()
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows)]
    with writing(_checks.path("path", path)) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _times(times_s: ArrayLike) -> F64:
    return _checks.array("times_s", times_s, ("N",), "finite times in seconds", finite=True).astype(np.float64)


def _number(of: object, name: str, least: float, most: float, unit: str = "") -> None:
    """Check a number of a frozen dataclass and keep it as float."""
    object.__setattr__(of, name, _checks.number(name, getattr(of, name), least=least, most=most, of=unit))
