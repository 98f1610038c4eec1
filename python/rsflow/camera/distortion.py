"""Lens distortion in normalised coordinates: forward with its Jacobian, and its inverse.

Models and coefficient order are OpenCV's: "pinhole" after Brown, with the rational and thin-prism terms; "fisheye"
after Kannala and Brandt (2006), equidistant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
# Distorted x and y, then the Jacobian: dx by x, dx by y, dy by x, dy by y.
Mapped: TypeAlias = tuple[Array, Array, Array, Array, Array, Array]

NAMES: dict[str, tuple[str, ...]] = {
    "pinhole": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}

# Newton's steps double the digits near the solution; far out in a wide lens the first ones are short.
_ITERATIONS = 50

# Steps of the quick start, enough for nearly every point of a picture.
_QUICK_ITERATIONS = 4

# Error at which the iteration of a point ends, in normalised units: 1e-13 is 1e-10 pixels at a focal length of 1000.
_ENOUGH = 1e-13

# Largest remaining error accepted: 1e-7 pixels at a focal length of 1000.
_TOLERANCE = 1e-10


def forward(model: str, coefficients: Sequence[float], xy: Array) -> Array:
    """Distort normalised points, (N, 2)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack(lens_map(model, coefficients, xy[:, 0], xy[:, 1])[:2], axis=1)


def lens_map(model: str, coefficients: Sequence[float], x: Array, y: Array) -> Mapped:
    """Map undistorted to distorted coordinates, both on the plane at depth 1, with the map's slopes."""
    return _fisheye(coefficients, x, y) if model == "fisheye" else _brown(coefficients, x, y)


def _brown(coefficients: Sequence[float], x: Array, y: Array) -> Mapped:
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (*coefficients, *[0.0] * (12 - len(coefficients)))
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    # Derivative of the radial factor by r2.
    slope = k1 + r2 * (2 * k2 + r2 * (3 * k3))
    if k4 or k5 or k6:
        low = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = radial / low
        slope = (slope - radial * (k4 + r2 * (2 * k5 + r2 * (3 * k6)))) / low
    p1x, p1y, p2x, p2y = p1 * x, p1 * y, p2 * x, p2 * y
    x_slope, y_slope = 2 * x * slope, 2 * y * slope
    cross = x_slope * y + 2 * (p1x + p2y)
    mapped = (
        x * radial + 2 * p1y * x + p2 * r2 + 2 * p2x * x,
        y * radial + 2 * p2x * y + p1 * r2 + 2 * p1y * y,
        radial + x_slope * x + 2 * p1y + 6 * p2x,
        cross,
        cross,
        radial + y_slope * y + 6 * p1y + 2 * p2x,
    )
    if not (s1 or s2 or s3 or s4):
        return mapped
    prism_x, prism_y = 2 * (s1 + 2 * s2 * r2), 2 * (s3 + 2 * s4 * r2)
    return (
        mapped[0] + r2 * (s1 + s2 * r2),
        mapped[1] + r2 * (s3 + s4 * r2),
        mapped[2] + x * prism_x,
        mapped[3] + y * prism_x,
        mapped[4] + x * prism_y,
        mapped[5] + y * prism_y,
    )


def _fisheye(coefficients: Sequence[float], x: Array, y: Array) -> Mapped:
    k1, k2, k3, k4 = (*coefficients, *[0.0] * (4 - len(coefficients)))
    r = np.hypot(x, y)
    small = r < 1e-9
    safe = np.where(small, 1.0, r)
    theta = np.arctan(r)
    t2 = theta * theta
    bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    bent_slope = (1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * (9 * k4))))) / (1 + r * r)
    factor = np.where(small, 1.0, bent / safe)
    # Along the radius the derivative is that of the bent angle, across it the factor itself.
    across = np.where(small, 0.0, bent_slope - factor)
    ux, uy = x / safe, y / safe
    cross = across * ux * uy
    return x * factor, y * factor, factor + across * ux * ux, cross, cross, factor + across * uy * uy


def invert(model: str, coefficients: Sequence[float], xy: Array) -> Array:
    """Undistort normalised points; NaN where the model has no valid answer.

    Newton's method. A solution beyond the radius where the picture folds back over itself is not one: there the
    Jacobian's determinant is not positive.
    """
    with np.errstate(all="ignore"):
        result, open_points = _quick(model, coefficients, xy)
        if open_points.size:
            result[open_points] = _careful(model, coefficients, xy[open_points])
    return result


def _quick(model: str, coefficients: Sequence[float], xy: Array) -> tuple[Array, NDArray[np.intp]]:
    """Take a few full steps from the distorted points; also give which points that does not settle."""
    goal_x, goal_y = xy[:, 0], xy[:, 1]
    x, y = goal_x.copy(), goal_y.copy()
    unfolded = np.ones(len(x), bool)
    for iteration in range(_QUICK_ITERATIONS + 1):
        at_x, at_y, a, b, c, d = lens_map(model, coefficients, x, y)
        off_x, off_y, determinant = at_x - goal_x, at_y - goal_y, a * d - b * c
        unfolded &= determinant > 0
        settled = np.maximum(np.abs(off_x), np.abs(off_y)) < _ENOUGH
        if iteration == _QUICK_ITERATIONS or settled.all():
            break
        x = x - (d * off_x - b * off_y) / determinant
        y = y - (a * off_y - c * off_x) / determinant
    return np.stack([x, y], axis=1), np.flatnonzero(~(settled & unfolded))


def _careful(model: str, coefficients: Sequence[float], xy: Array) -> Array:
    """Start from the centre, which every model maps without folding, and shorten each step until the error falls."""
    guess = np.zeros_like(xy)
    value, jacobian = _value(model, coefficients, guess)
    error = np.linalg.norm(value - xy, axis=1)
    for _ in range(_ITERATIONS):
        active = np.flatnonzero(error > _ENOUGH)
        if not active.size:
            break
        off, (a, b, c, d) = (value - xy)[active], jacobian[:, active]
        step = (
            np.stack([d * off[:, 0] - b * off[:, 1], a * off[:, 1] - c * off[:, 0]], axis=1) / (a * d - b * c)[:, None]
        )
        length = np.ones(active.size)
        for _ in range(8):
            trial = guess[active] - length[:, None] * step
            trial_value, trial_jacobian = _value(model, coefficients, trial)
            trial_error = np.linalg.norm(trial_value - xy[active], axis=1)
            worse = ~((trial_error < error[active]) & (_determinant(trial_jacobian) > 0))
            if not worse.any():
                break
            length[worse] *= 0.5
        better = active[~worse]
        if not better.size:
            break
        guess[better], value[better] = trial[~worse], trial_value[~worse]
        jacobian[:, better], error[better] = trial_jacobian[:, ~worse], trial_error[~worse]
    right = (error <= _TOLERANCE * np.maximum(1.0, np.linalg.norm(xy, axis=1))) & (_determinant(jacobian) > 0)
    guess[~right] = np.nan
    return guess


def _value(model: str, coefficients: Sequence[float], xy: Array) -> tuple[Array, Array]:
    """Give the distorted points, (N, 2), and the Jacobian, (4, N)."""
    mapped = lens_map(model, coefficients, xy[:, 0], xy[:, 1])
    return np.stack(mapped[:2], axis=1), np.stack(mapped[2:])


def _determinant(jacobian: Array) -> Array:
    result: Array = jacobian[0] * jacobian[3] - jacobian[1] * jacobian[2]
    return result
