"""A Kalman filter for many things at once: place and velocity along each axis, over the ground.

The state of a thing lies in the picture of the frame at hand; from frame to frame the camera's motion carries it.

docs/explanation/algorithms.md, section "Things that move: ObjectTracker".
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F64 = NDArray[np.float64]

# A measurement that is off by more than so many deviations weighs as if it had just these.
_OUTLIER = 3.0
# Where the measurement is trusted it is the prediction that was off: the thing has turned. Its place is taken to be
# as unsure as that asks for, and its velocity by so much of it.
_TURNED = 0.3


def carried(place: F64, motion: F64) -> tuple[F64, F64]:
    """Where the camera's motion takes places (n, 2), and its derivative there (n, 2, 2).

    NaN for what it takes beyond the horizon.
    """
    x, y = place[:, 0], place[:, 1]
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in motion)
    w = np.where(w > 1e-6 * abs(motion[2, 2]), w, np.nan)
    moved = np.stack([u / w, v / w], axis=1)
    slope = (motion[None, :2, :2] - moved[:, :, None] * motion[None, 2:, :2]) / w[:, None, None]
    return moved, slope


def predict(place: F64, velocity: F64, variance: F64, steps: float, acceleration: F64) -> None:
    """Let things go on for some frames, in place.

    Parameters
    ----------
    place, velocity : (n, 2) float64
        Of each thing along x and y, in pixels and pixels per frame.
    variance : (n, 2, 3) float64
        Along each axis: of the place, of place with velocity, of the velocity.
    steps : float
        How many frames.
    acceleration : (n,) float64
        Deviation of the change of velocity in a frame, in pixels per frame.
    """
    q = (acceleration * acceleration)[:, None] * steps
    pp, pv, vv = variance[..., 0], variance[..., 1], variance[..., 2]
    place += steps * velocity
    pp += steps * (2 * pv + steps * vv) + q * (steps * steps / 3)
    pv += steps * vv + q * (steps / 2)
    vv += q


def correct_place(
    place: F64, velocity: F64, variance: F64, innovation: F64, noise: F64, trusted: NDArray[np.bool_]
) -> F64:
    """Take measured places, in place: `innovation` (n, 2) beyond those predicted, with `noise`, their variance.

    Where the noise is infinite nothing is taken. Those of `trusted` (n,) things are no outliers. Gives the squared
    innovations over their variances.
    """
    pp, pv, vv = variance[..., 0], variance[..., 1], variance[..., 2]
    off = trusted[:, None] & np.isfinite(noise)
    more = np.where(off, np.maximum((innovation / _OUTLIER) ** 2 - np.where(off, pp + noise, 0.0), 0.0), 0.0)
    pp += more
    pv += _TURNED * more
    vv += _TURNED * more
    s = _bounded(pp + noise, innovation)
    gain, follow = pp / s, pv / s
    taken = np.where(np.isfinite(s), innovation, 0.0)
    place += gain * taken
    velocity += follow * taken
    vv -= follow * pv
    pv *= 1 - gain
    pp *= 1 - gain
    return np.asarray(taken * taken / s)


def correct_velocity(place: F64, velocity: F64, variance: F64, innovation: F64, noise: F64) -> F64:
    """Take measured velocities, likewise."""
    pp, pv, vv = variance[..., 0], variance[..., 1], variance[..., 2]
    s = _bounded(vv + noise, innovation)
    gain, follow = vv / s, pv / s
    taken = np.where(np.isfinite(s), innovation, 0.0)
    velocity += gain * taken
    place += follow * taken
    pp -= follow * pv
    pv *= 1 - gain
    vv *= 1 - gain
    return np.asarray(taken * taken / s)


def _bounded(s: F64, innovation: F64) -> F64:
    """Raise variances of innovations so that none is an outlier."""
    return np.maximum(s, innovation * innovation / _OUTLIER**2)
