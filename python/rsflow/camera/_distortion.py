"""Lens distortion in normalised coordinates: forward with its Jacobian, and its inverse.

Models and coefficient order are OpenCV's: "pinhole" after Brown, with the rational and thin-prism terms; "fisheye"
after Kannala and Brandt (2006), equidistant.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

NAMES: dict[str, tuple[str, ...]] = {
    "pinhole": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}

# Newton's steps double the digits near the solution; far out in a wide lens the first ones are short.
_ITERATIONS = 50

# Error at which the iteration of a point ends: a hundred times the rounding of float64.
_ENOUGH = 1e-14

# Largest remaining error accepted, in normalised units: 1e-10 is 1e-7 pixels at a focal length of 1000 pixels.
_TOLERANCE = 1e-10


def forward(
    model: str, coefficients: Sequence[float], xy: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distort normalised points; also give the Jacobian, (N, 2, 2)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return _fisheye(coefficients, xy) if model == "fisheye" else _brown(coefficients, xy)


def _brown(coefficients: Sequence[float], xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (*coefficients, *[0.0] * (12 - len(coefficients)))
    x, y = xy[:, 0], xy[:, 1]
    r2 = x * x + y * y
    top = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    low = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = top / low
    # Derivative of the radial factor by r2, and of r2 by x and y.
    slope = ((k1 + r2 * (2 * k2 + r2 * 3 * k3)) - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / low
    prism_x, prism_y = s1 + 2 * s2 * r2, s3 + 2 * s4 * r2
    out = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + s4 * r2),
        ],
        axis=1,
    )
    jacobian = np.empty((len(xy), 2, 2))
    jacobian[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x + 2 * x * prism_x
    jacobian[:, 0, 1] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y + 2 * y * prism_x
    jacobian[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y + 2 * x * prism_y
    jacobian[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x + 2 * y * prism_y
    return out, jacobian


def _fisheye(coefficients: Sequence[float], xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    k1, k2, k3, k4 = (*coefficients, *[0.0] * (4 - len(coefficients)))
    r = np.hypot(xy[:, 0], xy[:, 1])
    small = r < 1e-9
    safe = np.where(small, 1.0, r)
    theta = np.arctan(r)
    t2 = theta * theta
    bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    bent_slope = (1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))) / (1 + r * r)
    factor = np.where(small, 1.0, bent / safe)
    unit = xy / safe[:, None]
    # Along the radius the derivative is that of the bent angle, across it the factor itself.
    across = np.where(small, 0.0, bent_slope - factor)
    jacobian = across[:, None, None] * unit[:, :, None] * unit[:, None, :]
    jacobian += factor[:, None, None] * np.eye(2)
    return xy * factor[:, None], jacobian


def invert(model: str, coefficients: Sequence[float], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Undistort normalised points; NaN where the model has no valid answer.

    Newton's method from the centre, which every model maps without folding, each step shortened until the error falls
    on the same side of a fold. A solution beyond the radius
    where the picture folds back over itself is not one: there the Jacobian's determinant is not positive.
    """
    guess = np.zeros_like(xy)
    with np.errstate(all="ignore"):
        value, jacobian = forward(model, coefficients, guess)
        error = np.linalg.norm(value - xy, axis=1)
        for _ in range(_ITERATIONS):
            active = np.flatnonzero(error > _ENOUGH)
            if not active.size:
                break
            step = _solve(jacobian[active], (value - xy)[active])
            length = np.ones(active.size)
            for _ in range(8):
                trial = guess[active] - length[:, None] * step
                trial_value, trial_jacobian = forward(model, coefficients, trial)
                trial_error = np.linalg.norm(trial_value - xy[active], axis=1)
                worse = ~((trial_error < error[active]) & (_determinant(trial_jacobian) > 0))
                if not worse.any():
                    break
                length[worse] *= 0.5
            better = active[~worse]
            if not better.size:
                break
            guess[better], value[better] = trial[~worse], trial_value[~worse]
            jacobian[better], error[better] = trial_jacobian[~worse], trial_error[~worse]
        bad = ~((error <= _TOLERANCE * np.maximum(1.0, np.linalg.norm(xy, axis=1))) & (_determinant(jacobian) > 0))
    guess[bad] = np.nan
    return guess


def _determinant(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    result: NDArray[np.float64] = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
    return result


def _solve(jacobian: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    determinant = _determinant(jacobian)
    step = np.stack(
        [
            jacobian[:, 1, 1] * right[:, 0] - jacobian[:, 0, 1] * right[:, 1],
            jacobian[:, 0, 0] * right[:, 1] - jacobian[:, 1, 0] * right[:, 0],
        ],
        axis=1,
    )
    return step / determinant[:, None]
