"""What the filter is given with a velocity, held to what it may be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from ..errors import OptionError
from .result import Velocity

__all__ = ["height_of", "names_of", "rate_of", "residual_of", "straight_of"]

F64 = NDArray[np.float64]

_MOST = 1e6


def names_of(argument: str, given: Sequence[str]) -> tuple[str, ...]:
    """Take names of parts of a covariance."""
    expected = "a list of names of parts, as ('height', 'focal length')"
    if isinstance(given, str):
        raise _checks.refused(argument, given, expected)
    names = tuple(_checks.text(argument, name) for name in _checks.iterable(argument, given, expected))
    if "displacement" in names:
        raise OptionError(f"{argument}: got 'displacement', whose error is another in every frame, expected others")
    return names


def _vector(name: str, value: ArrayLike, expected: str) -> F64:
    return np.asarray(_checks.array(name, value, (3,), expected), dtype=np.float64)


def straight_of(down: ArrayLike | None) -> F64 | None:
    """Give a unit vector; None where it is not known."""
    if down is None:
        return np.array([0.0, 0.0, 1.0])
    vector = _vector("down", down, "three numbers, NaN where not known")
    if not np.isfinite(vector).all():
        return None
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise OptionError("down: got (0, 0, 0), expected a direction")
    return np.asarray(vector / length, dtype=np.float64)


def rate_of(velocity: Velocity, rate_rad_s: ArrayLike | None) -> F64 | None:
    """Give the rate that was told, else the one that the velocity came with; None where none is known."""
    if rate_rad_s is not None:
        rate = _vector("rate_rad_s", rate_rad_s, "three numbers")
        return rate if np.isfinite(rate).all() else None
    return velocity.rate_rad_s if np.isfinite(velocity.rate_rad_s).all() else None


def residual_of(rate: ArrayLike | None, covariance: ArrayLike | None, estimates: bool) -> tuple[F64, F64] | None:
    """Take a residual rate and its covariance, for a filter that estimates something from it."""
    if (rate is None) != (covariance is None):
        raise OptionError("residual_rate_rad_s, residual_rate_covariance: got one of them, expected both or none")
    if rate is None or covariance is None:
        return None
    if not estimates:
        raise OptionError(
            "residual_rate_rad_s: got one, expected a filter with gyro_bias_std_rad_s or rate_delay_std_s above 0"
        )
    measured = _vector("residual_rate_rad_s", rate, "three numbers, NaN where not measured")
    expected = "a covariance, (3, 3)"
    noise = _checks.array("residual_rate_covariance", covariance, (3, 3), expected).astype(np.float64)
    known = np.isfinite(measured) & np.isfinite(np.diag(noise))
    part = noise[np.ix_(known, known)]
    if not (np.isfinite(part).all() and np.allclose(part, part.T) and (np.linalg.eigvalsh(part) > 0).all()):
        raise OptionError(f"residual_rate_covariance: got {noise.tolist()}, expected {expected}, positive definite")
    return measured, noise


def height_of(velocity: Velocity, height_m: float | None, estimates: bool) -> float:
    """Give the height; where a gyro's errors are estimated, a velocity needs one."""
    if height_m is not None:
        return _checks.number("height_m", height_m, least=0, most=_MOST, of="metres", or_nan=True)
    own = velocity.height_m
    if velocity.valid and estimates and not math.isfinite(own):
        raise OptionError("height_m: got None, expected the height: a gyro's errors move the velocity by it")
    return own
