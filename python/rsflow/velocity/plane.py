"""Velocity of a camera over a plane from the motion of points: the exact model and its robust least squares.

Between two frames the camera turns by R and moves by V dt. Seen in axes half-way between the two attitudes, a point of
the plane goes from normalised coordinates a to b. With Z its depth at the second frame,

    b - a = (a_x Vz - Vx, a_y Vz - Vy) dt / Z,        Z = h / (d . (b_x, b_y, 1)),

holds exactly, not only for small motion: h is the perpendicular distance from the plane at the second frame and d the
unit vector straight down. It is the report's equation 2.10 with the y row mended, and the translational part of the
interaction matrix of visual servoing (Chaumette and Hutchinson 2006, equation 11).

docs/algorithms.md, section "Velocity over a plane: VelocityEstimator".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._rotation import rotation_matrix

F64 = NDArray[np.float64]

# Tukey's biweight keeps 95 % of the efficiency of least squares under Gaussian noise with this constant.
_TUKEY = 4.685
# A free parameter stays in the model if it differs from zero by this many of its own standard deviations.
_DEMANDED = 3.0
# Turn in radians below which the model is linear in the yaw: what is left out is its square.
_TURN = 1e-6
# Weight, in degrees of freedom, of the points' own covariances against the residuals when both judge the noise.
_PRIOR_DOF = 10.0


def turned(rays: F64, by: F64) -> F64:
    """Normalised coordinates (N, 2) in axes turned by `by`; NaN for rays that then point backwards."""
    x = rays @ by[:, :2].T + by[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(x[:, 2] > 1e-9, x[:, 2], np.nan)
        return np.asarray(x[:, :2] / depth[:, None], dtype=np.float64)


@dataclass(frozen=True)
class Interval:
    """What is known about the camera between two frames.

    Attributes
    ----------
    turn : (3,) float64
        Its rotation vector in its own axes, in radians: mean rate times the interval.
    down : (3,) float64
        Unit vector straight down in its axes at the second frame.
    height_m : float
        Perpendicular distance from the plane at the second frame.
    dt_s : float
    yaw_free : bool
        Whether a turn about `down` may be estimated as well: nothing measured the rate.
    """

    turn: F64
    down: F64
    height_m: float
    dt_s: float
    yaw_free: bool


@dataclass(frozen=True)
class PlaneFit:
    """Velocity (3,) in the camera's axes half-way, its covariance from the points alone, and which points fit.

    `terms` says which parameters the data demanded: "vx vy", then "vz" and "yaw". Where Vz was not demanded it is
    still the estimate of the full model, but Vx and Vy are those of the model without it.
    """

    velocity: F64
    covariance: F64
    inliers: NDArray[np.bool_]
    scale: float
    yaw_rad: float
    terms: tuple[str, ...]
    weights: F64


def in_view(after: F64, interval: Interval) -> NDArray[np.bool_]:
    """Whether the rays (N, 2) of the second frame meet the plane, less than 80 degrees from straight down."""
    length = np.sqrt(1.0 + np.sum(after * after, axis=1))
    with np.errstate(invalid="ignore"):
        return np.asarray((after @ interval.down[:2] + interval.down[2]) / length > 0.17)


class Points:
    """Points followed between two frames, and the whitened linear system that a velocity solves.

    Parameters
    ----------
    prev, after : (N, 2) float64
        Undistorted normalised coordinates in the first and in the second frame, in each frame's own axes.
    covariance : (N, 2, 2) float64
        Of the displacement, in normalised coordinates.
    """

    def __init__(self, prev: F64, after: F64, covariance: F64) -> None:
        self.prev, self.after = prev, after
        # L with L' L the inverse of each covariance.
        self._white = np.linalg.inv(np.linalg.cholesky(covariance))

    def __len__(self) -> int:
        return len(self.prev)

    def system(self, interval: Interval, terms: tuple[str, ...], yaw_rad: float) -> tuple[F64, F64]:
        """Whitened Jacobian (N, 2, P) and displacement (N, 2) in the axes half-way, with a yaw already taken off."""
        half = 0.5 * interval.turn
        down = rotation_matrix(half) @ interval.down
        a = turned(self.prev, rotation_matrix(-0.5 * yaw_rad * down) @ rotation_matrix(-half))
        b = turned(self.after, rotation_matrix(0.5 * yaw_rad * down) @ rotation_matrix(half))
        per_metre = interval.dt_s * (b @ down[:2] + down[2]) / interval.height_m
        jacobian = np.zeros((len(a), 2, len(terms)))
        for column, name in enumerate(terms):
            if name == "vx":
                jacobian[:, 0, column] = -per_metre
            elif name == "vy":
                jacobian[:, 1, column] = -per_metre
            elif name == "vz":
                jacobian[:, :, column] = a * per_metre[:, None]
            else:
                x, y = (0.5 * (a + b)).T
                jacobian[:, 0, column] = x * y * down[0] - (1 + x * x) * down[1] + y * down[2]
                jacobian[:, 1, column] = (1 + y * y) * down[0] - x * y * down[1] - x * down[2]
        return self._white @ jacobian, (self._white @ (b - a)[:, :, None])[:, :, 0]


@dataclass(frozen=True)
class _Solution:
    """Parameters, the yaw among them in radians, and the inverse of the normal matrix."""

    values: F64
    yaw: float
    inverse: F64


def fit(points: Points, interval: Interval, *, overlap: F64 | None = None) -> PlaneFit | None:
    """Fit a velocity to the motion of points of the plane.

    Parameters
    ----------
    points : Points
    interval : Interval
    overlap : (N, N) float64, optional
        Correlation of the errors of points whose windows share pixels; by default the points are independent.

    Returns
    -------
    PlaneFit or None
        None where the points do not determine a velocity.
    """
    full: tuple[str, ...] = ("vx", "vy")
    # Two more points than parameters need, so that the residuals can judge.
    if len(points) >= 5:
        full += ("vz",)
    if len(points) >= 6 and interval.yaw_free:
        full += ("yaw",)
    found = _robust(points, interval, full) if len(points) >= 3 else None
    if found is None and len(points) >= 3:
        full = ("vx", "vy")
        found = _robust(points, interval, full)
    if found is None:
        return None
    scale, weights, everything = found
    covariance = _covariance(points, interval, full, everything, weights, scale, overlap)
    demanded = tuple(
        name
        for name, value, variance in zip(full, everything.values, np.diag(covariance), strict=True)
        if name in ("vx", "vy") or abs(value) > _DEMANDED * np.sqrt(variance)
    )
    kept, kept_covariance = everything, covariance
    if demanded != full:
        reduced = solve(points, interval, demanded, weights)
        if reduced is None:
            return None
        kept = reduced
        kept_covariance = _covariance(points, interval, demanded, kept, weights, scale, overlap)
    velocity = np.full(3, np.nan)
    result = np.diag(np.full(3, np.inf))
    axes = [k for k, name in enumerate(demanded) if name != "yaw"]
    velocity[: len(axes)] = kept.values[axes]
    result[: len(axes), : len(axes)] = kept_covariance[np.ix_(axes, axes)]
    if "vz" in full and "vz" not in demanded:
        velocity[2] = everything.values[2]
        result[2, :2] = result[:2, 2] = 0.0
        result[2, 2] = covariance[2, 2]
    return PlaneFit(velocity, result, weights > 0.0, scale, kept.yaw, demanded, weights)


def _normal(design: F64, target: F64, weights: F64) -> tuple[F64, F64] | None:
    """Solve weighted least squares: the parameters and the inverse of the normal matrix; None where singular."""
    rows = design.reshape(-1, design.shape[2])
    weighted = rows * np.repeat(weights, 2)[:, None]
    normal = weighted.T @ rows
    # Parameters differ in unit: the condition is judged after scaling each to a unit diagonal.
    size = np.sqrt(np.diag(normal))
    if not (np.isfinite(normal).all() and (size > 0).all()):
        return None
    eigenvalues, vectors = np.linalg.eigh(normal / np.outer(size, size))
    if eigenvalues[0] < 1e-9 * eigenvalues[-1]:
        return None
    inverse = (vectors / eigenvalues) @ vectors.T / np.outer(size, size)
    return inverse @ (weighted.T @ target.ravel()), inverse


def solve(points: Points, interval: Interval, terms: tuple[str, ...], weights: F64) -> _Solution | None:
    """Solve for the parameters with weights held; the model is linear but for the yaw, which is iterated."""
    yaw = 0.0
    for _ in range(8):
        solved = _normal(*points.system(interval, terms, yaw), weights)
        if solved is None:
            return None
        values, inverse = solved
        if "yaw" not in terms:
            break
        if abs(values[-1]) < _TURN:
            break
        yaw += float(values[-1])
    return _solution(values, inverse, terms, yaw)


def _solution(values: F64, inverse: F64, terms: tuple[str, ...], yaw: float) -> _Solution:
    values = values.copy()
    if "yaw" in terms:
        values[-1] += yaw
        yaw = float(values[-1])
    return _Solution(values, yaw, inverse)


def _robust(points: Points, interval: Interval, terms: tuple[str, ...]) -> tuple[float, F64, _Solution] | None:
    """Solve by reweighted least squares: first for the sum of lengths, then with Tukey's biweight.

    Returns the scale of the whitened residuals (1 where the points' covariances are right), the weights and the
    solution.
    """
    yaw = 0.0
    design, target = points.system(interval, terms, yaw)
    length = np.linalg.norm(target - np.median(target, axis=0), axis=1)
    # The median length of two unit Gaussians is sqrt(2 ln 2); p parameters took p / 2 N of the scatter.
    expected = 1.17741 * max(1.0 - len(terms) / (2.0 * len(points)), 0.2)
    scale, weights = 1.0, np.ones(len(points))
    for step in range(20):
        middle = float(np.median(length))
        if step < 10:
            weights = 1.0 / np.maximum(length, max(0.1 * middle, 1e-9))
        else:
            scale = max(middle / expected, 0.05)
            weights = np.where(length < _TUKEY * scale, (1.0 - (length / (_TUKEY * scale)) ** 2) ** 2, 0.0)
        solved = _normal(design, target, weights)
        if solved is None:
            return None
        values, inverse = solved
        before, length = length, np.linalg.norm(target - design @ values, axis=1)
        if "yaw" in terms and abs(values[-1]) > _TURN:
            yaw += float(values[-1])
            design, target = points.system(interval, terms, yaw)
        elif step >= 10 and np.abs(length - before).max() < 1e-3 * scale:
            break
    squares = float(np.sum(weights * length**2))
    freedom = max(2.0 * float(np.sum(weights)) - len(terms), 0.0)
    # The biweight trims the tails: under Gaussian noise the weighted squares come to 0.87 of the unweighted share.
    variance = (squares / 0.87 + _PRIOR_DOF) / (freedom + _PRIOR_DOF)
    return float(np.sqrt(variance)), weights, _solution(values, inverse, terms, yaw)


def _covariance(
    points: Points,
    interval: Interval,
    terms: tuple[str, ...],
    solution: _Solution,
    weights: F64,
    scale: float,
    overlap: F64 | None,
) -> F64:
    """Covariance of the parameters where errors of points whose windows share pixels go together."""
    design, _ = points.system(interval, terms, solution.yaw)
    weighted = weights[:, None, None] * design
    middle = np.zeros_like(solution.inverse)
    for component in (weighted[:, 0, :], weighted[:, 1, :]):
        middle += component.T @ (component if overlap is None else overlap @ component)
    return np.asarray(scale**2 * solution.inverse @ middle @ solution.inverse, dtype=np.float64)
