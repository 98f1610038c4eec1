"""Height over the ground from a known speed: the picture tells speed over height, and the speed the rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import measured
from .._results.status import WordStatus
from ..errors import OptionError, ShapeError
from ..velocity import Velocity

__all__ = ["HeightFromSpeed", "HeightStatus", "height_from_speed"]

F64 = NDArray[np.float64]

# Deviations by which the flow must differ from none for a height to follow from it.
_LEAST_SURE = 3.0
# Deviations between the known velocity's direction and the measured one's above which they do not belong together.
_MOST_APART = 5.0
_MOST = 1e6


class HeightStatus(WordStatus):
    """What became of a height from a known speed.

    Examples
    --------
    >>> import rsflow
    >>> print(rsflow.HeightStatus.NOT_MOVING, rsflow.HeightStatus.OK.valid)
    not_moving True
    """

    OK = "ok", "Measured."
    NOT_MEASURED = "not_measured", "No velocity could be measured."
    NOT_MOVING = "not_moving", "The motion is too slow for its noise: any height is possible."
    APART = "apart", "The measured velocity has another direction than the known one."


@dataclass(frozen=True)
class HeightFromSpeed:
    """A height over the ground.

    Attributes
    ----------
    height_m : float
        Perpendicular distance from the ground, half-way through the interval; NaN where unknown.
    std_m : float
        Standard deviation; infinite where unknown.
    low_m, high_m : float
        The 95 % interval, which is longer upwards: of one over the height; infinite where nothing bounds it.
    status : HeightStatus
    n : int
        Velocities that it is from.

    Examples
    --------
    >>> from rsflow.scale import HeightFromSpeed, HeightStatus
    >>> HeightFromSpeed(0.5, 0.01, 0.481, 0.5205, HeightStatus.OK, 1)
    HeightFromSpeed(0.500 +- 0.010 m, 1 velocity)
    """

    height_m: float
    std_m: float
    low_m: float
    high_m: float
    status: HeightStatus
    n: int

    def __repr__(self) -> str:
        if not self.valid:
            return f"HeightFromSpeed({self.status.name}: {self.status.explanation})"
        count = "1 velocity" if self.n == 1 else f"{self.n} velocities"
        return f"HeightFromSpeed({measured(self.height_m, self.std_m)} m, {count})"

    @property
    def valid(self) -> bool:
        """Whether there is a height."""
        return self.status.valid


def height_from_speed(
    velocity: Velocity | Iterable[Velocity],
    speed_m_s: ArrayLike,
    *,
    speed_std_m_s: float,
    measured_at_m: float = 1.0,
) -> HeightFromSpeed:
    """Find the height over the ground at which a measured velocity is the known one.

    A camera alone tells the velocity in heights a second. Measure it with ``VelocityEstimator(camera, height_m=1.0)``:
    the height is then the known speed over the measured one. The opposite of the velocity from a known height.

    Parameters
    ----------
    velocity : Velocity, or several
        As measured with the height `measured_at_m`. Of several, one height that does not change is found; for a
        height of each frame, call this for each.
    speed_m_s : float, (2,) or (3,), or one of these for each velocity
        Known speed over the ground, or the known velocity in the axes of the measured one, whose direction is then
        checked and which needs no correction for noise. Its third component, up and down, is not used. For several
        velocities a row each, (N,), (N, 2) or (N, 3), or the same for all: (2,) and (3,) are one velocity unless there
        are two or three of `velocity`, which want a row each.
    speed_std_m_s : float
        Standard deviation of the known speed, or of each component of the known velocity: an error that all frames
        share, as of an air speed in wind.
    measured_at_m : float, optional
        The height that the velocity was measured with.

    Returns
    -------
    HeightFromSpeed
        The deviation holds that of the flow, of the camera where its parameters have deviations, of the rates, and of
        the known speed. The noise of frames is averaged over, what they share is not.

    Raises
    ------
    OptionError, ShapeError, DTypeError
        If an argument does not fit; the message says which and how.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=5, height_m=0.5, velocity_m_s=(0.06, -0.03, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=1.0, rate_std_rad_s=0.0)
    >>> velocities = [estimator.update(frame.image, frame.t_s) for frame in flight][1:]
    >>> height = rsflow.height_from_speed(velocities, (0.06, -0.03), speed_std_m_s=0.0005)
    >>> round(height.height_m, 2), 0.002 < height.std_m < 0.02
    (0.5, True)
    """
    several = not isinstance(velocity, Velocity)
    given = _checks.iterable("velocity", velocity, "a Velocity, or several") if several else [velocity]
    rows: list[Velocity] = [_checks.instance("velocity", row, Velocity, "a Velocity, or several") for row in given]
    if not rows:
        raise OptionError("velocity: got none, expected at least one")
    known = _known(speed_m_s, len(rows), several)
    std = _checks.number("speed_std_m_s", speed_std_m_s, least=0, most=_MOST, of="metres a second")
    at = _checks.number("measured_at_m", measured_at_m, least=1e-6, most=1e9, of="metres")
    good = [k for k, row in enumerate(rows) if row.valid]
    if not good:
        return _unknown(HeightStatus.NOT_MEASURED, 0)
    flow = np.array([[rows[k].vx_m_s, rows[k].vy_m_s] for k in good]) / at
    own = np.array([_independent(rows[k]) for k in good]) / at**2
    shared = np.array([rows[k].covariance[:2, :2] for k in good]) / at**2 - own
    return _height(flow, own, shared, known[good], std)


def _known(speed: Any, count: int, several: bool) -> F64:
    """Known speeds (N,) or velocities (N, 2), one for each measured velocity."""
    expected = "a speed, or a velocity (2,) or (3,), or one for each velocity"
    value = _checks.array("speed_m_s", speed, ..., expected, finite=True).astype(np.float64)
    if value.size and np.abs(value).max() > _MOST:
        raise OptionError(f"speed_m_s: got {np.abs(value).max():g}, expected numbers up to {_MOST:g}")
    each = several and value.ndim >= 1 and len(value) == count
    if value.ndim == 0:
        value, fits = np.repeat(value, count), True
    elif value.ndim == 1 and not each and len(value) in (2, 3):
        value, fits = np.tile(value[:2], (count, 1)), True
    else:
        fits = each and (value.ndim == 1 or (value.ndim == 2 and value.shape[1] in (2, 3)))
    if not fits:
        raise ShapeError(f"speed_m_s: got shape {value.shape}, expected {expected}")
    if value.ndim == 1:
        if (value < 0).any():
            raise OptionError(f"speed_m_s: got {value.min():g}, expected speeds of at least 0")
        return value
    return value[:, :2]


def _independent(velocity: Velocity) -> F64:
    """Give the part of the covariance that is another in each frame."""
    return np.asarray(velocity.parts.get("displacement", velocity.covariance))[:2, :2]


def _unknown(status: HeightStatus, count: int, low: float = 0.0) -> HeightFromSpeed:
    return HeightFromSpeed(np.nan, np.inf, low, np.inf, status, count)


def _height(flow: F64, own: F64, shared: F64, known: F64, std: float) -> HeightFromSpeed:
    """Fit one over the height: flow = known velocity / height."""
    count = len(flow)
    if known.ndim == 1:
        # The direction is the measured one; noise across it makes the length seem longer.
        length = np.linalg.norm(flow, axis=1)
        along = flow / np.maximum(length, 1e-300)[:, None]
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        turned = np.einsum("ki,kij,kj->k", across, own, across)
        length = np.sqrt(np.maximum(length**2 - turned, 0))
        noise, common = (np.einsum("ki,kij,kj->k", along, part, along) for part in (own, shared))
        a, b, weight, together = known, length, 1 / np.maximum(noise, 1e-300), common
        information = float((weight * a * a).sum())
        inverse = float((weight * a * b).sum()) / max(information, 1e-300)
        apart, off = 0.0, 0.0
    else:
        weights = np.linalg.inv(own + 1e-300 * np.eye(2))
        information = float(np.einsum("ki,kij,kj->", known, weights, known))
        inverse = float(np.einsum("ki,kij,kj->", known, weights, flow)) / max(information, 1e-300)
        size = np.linalg.norm(known, axis=1)
        along = known / np.maximum(size, 1e-300)[:, None]
        together = np.einsum("ki,kij,kj->k", along, shared, along)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        off = float(np.einsum("ki,ki->", across, flow)) / count
        noise_off = np.einsum("ki,kij,kj->", across, own, across) / count**2
        common_off = np.einsum("ki,kij,kj->k", across, shared, across).mean() + (inverse * std) ** 2
        apart = abs(off) / max(float(np.sqrt(noise_off + common_off)), 1e-300)
    speed = float(np.sqrt((known**2).sum() / count))
    variance = 1 / max(information, 1e-300)
    if speed > 0:
        variance += float(together.mean()) / speed**2 + (inverse * std / speed) ** 2
    sigma = float(np.sqrt(variance))
    if speed == 0 or not inverse > _LEAST_SURE * sigma:
        turned_round = known.ndim == 2 and inverse < -_LEAST_SURE * sigma
        low = 1 / (inverse + 1.96 * sigma) if speed > 0 and inverse + 1.96 * sigma > 0 else 0.0
        return _unknown(HeightStatus.APART if turned_round else HeightStatus.NOT_MOVING, count, low)
    # An angle of the mounting of a few degrees is no reason to refuse a height.
    if apart > _MOST_APART and abs(off) > 0.1 * inverse * speed:
        return _unknown(HeightStatus.APART, count)
    height = 1 / inverse
    high = 1 / (inverse - 1.96 * sigma)
    return HeightFromSpeed(height, sigma * height**2, 1 / (inverse + 1.96 * sigma), high, HeightStatus.OK, count)
