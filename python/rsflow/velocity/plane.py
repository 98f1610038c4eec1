"""Velocity of a camera over a plane from the motion of points: the exact model and its robust least squares.

Between two frames the camera turns by R and moves by V dt. Seen in axes half-way between the two attitudes, a point of
the plane goes from normalised coordinates a to b. With Z its depth at the second frame,

    b - a = (a_x Vz - Vx, a_y Vz - Vy) dt / Z,        Z = h / (d . (b_x, b_y, 1)),

holds exactly, not only for small motion: h is the perpendicular distance from the plane at the second frame and d the
unit vector straight down. It is the report's equation 2.10 with the y row mended, and the translational part of the
interaction matrix of visual servoing (Chaumette and Hutchinson 2006, equation 11).
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


def _design(a: F64, b: F64, interval: Interval, terms: tuple[str, ...]) -> tuple[F64, F64]:
    """Jacobian (N, 2, P) of b - a in the parameters of `terms`, and the depth over dt (N,)."""
    depth = interval.height_m / (b @ interval_down(interval)[:2] + interval_down(interval)[2])
    per_metre = interval.dt_s / depth
    columns = [np.stack([-per_metre, 0 * per_metre], axis=1), np.stack([0 * per_metre, -per_metre], axis=1)]
    if "vz" in terms:
        columns.append(a * per_metre[:, None])
    if "yaw" in terms:
        x, y = (0.5 * (a + b)).T
        wx, wy, wz = interval_down(interval)
        columns.append(
            np.stack([x * y * wx - (1 + x * x) * wy + y * wz, (1 + y * y) * wx - x * y * wy - x * wz], axis=1)
        )
    return np.stack(columns, axis=2), depth


def interval_down(interval: Interval) -> F64:
    """Straight down in the axes half-way through the interval."""
    return np.asarray(rotation_matrix(0.5 * interval.turn) @ interval.down, dtype=np.float64)


def halfway(prev: F64, after: F64, interval: Interval, yaw_rad: float = 0.0) -> tuple[F64, F64]:
    """Rays of both frames in the axes half-way, with a further turn about `down` taken off."""
    half = 0.5 * interval.turn
    axis = interval_down(interval)
    a = turned(prev, rotation_matrix(-0.5 * yaw_rad * axis) @ rotation_matrix(-half))
    b = turned(after, rotation_matrix(0.5 * yaw_rad * axis) @ rotation_matrix(half))
    return a, b


def in_view(after: F64, interval: Interval) -> NDArray[np.bool_]:
    """Whether the rays (N, 2) of the second frame meet the plane, less than 80 degrees from straight down."""
    length = np.sqrt(1.0 + np.sum(after * after, axis=1))
    with np.errstate(invalid="ignore"):
        return np.asarray((after @ interval.down[:2] + interval.down[2]) / length > 0.17)


def _whiteners(covariance: F64) -> F64:
    """Matrices L (N, 2, 2) with L' L the inverse of each covariance."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)


def fit(
    prev: F64,
    after: F64,
    covariance: F64,
    interval: Interval,
    *,
    overlap: F64 | None = None,
) -> PlaneFit | None:
    """Fit a velocity to the motion of points of the plane.

    Parameters
    ----------
    prev, after : (N, 2) float64
        Undistorted normalised coordinates in the first and in the second frame, in each frame's own axes.
    covariance : (N, 2, 2) float64
        Of the displacement, in normalised coordinates.
    interval : Interval
    overlap : (N, N) float64, optional
        Correlation of the errors of points whose windows share pixels; by default the points are independent.

    Returns
    -------
    PlaneFit or None
        None where the points do not determine a velocity.
    """
    count = len(prev)
    full: tuple[str, ...] = ("vx", "vy")
    # Two more points than parameters need, so that the residuals can judge.
    if count >= 5:
        full += ("vz",)
    if count >= 6 and interval.yaw_free:
        full += ("yaw",)
    if count < 3:
        return None
    white = _whiteners(covariance)
    scale, weights, full_fit = _robust(prev, after, white, interval, full)
    if full_fit is None and len(full) > 2:
        full = ("vx", "vy")
        scale, weights, full_fit = _robust(prev, after, white, interval, full)
    if full_fit is None:
        return None
    values, yaw, inverse, design = full_fit
    full_covariance = _covariance(design, weights, inverse, scale, overlap)
    deviations = np.sqrt(np.diag(full_covariance))
    estimate = {**dict(zip(full, values, strict=True)), "yaw": yaw}
    demanded = tuple(
        name
        for name, deviation in zip(full, deviations, strict=True)
        if name in ("vx", "vy") or abs(estimate[name]) > _DEMANDED * deviation
    )
    kept, kept_covariance, kept_yaw = values, full_covariance, yaw
    if demanded != full:
        reduced = _solve(prev, after, white, interval, demanded, weights, yaw if "yaw" in demanded else 0.0)
        if reduced is None:
            return None
        kept, kept_yaw, inverse, design = reduced
        kept_covariance = _covariance(design, weights, inverse, scale, overlap)
    velocity = np.full(3, np.nan)
    result = np.diag(np.full(3, np.inf))
    axes = [k for k, name in enumerate(demanded) if name != "yaw"]
    velocity[: len(axes)] = kept[axes]
    result[: len(axes), : len(axes)] = kept_covariance[np.ix_(axes, axes)]
    if "vz" in full and "vz" not in demanded:
        velocity[2] = values[full.index("vz")]
        result[2, :2] = result[:2, 2] = 0.0
        result[2, 2] = full_covariance[full.index("vz"), full.index("vz")]
    return PlaneFit(velocity, result, weights > 0.0, scale, kept_yaw, demanded, weights)


_Solution = tuple[F64, float, F64, F64]


def _solve(
    prev: F64, after: F64, white: F64, interval: Interval, terms: tuple[str, ...], weights: F64, yaw: float = 0.0
) -> _Solution | None:
    """Weighted least squares: parameters, yaw, inverse normal matrix and the whitened Jacobian (N, 2, P).

    The model is linear but for the yaw, which is linearised about the value given and iterated.
    """
    for _ in range(6 if "yaw" in terms else 1):
        a, b = halfway(prev, after, interval, yaw)
        jacobian, _depth = _design(a, b, interval, terms)
        design = white @ jacobian
        target = np.einsum("nij,nj->ni", white, b - a)
        normal = np.einsum("n,nip,niq->pq", weights, design, design)
        right = np.einsum("n,nip,ni->p", weights, design, target)
        # Parameters differ in unit: the condition is judged after scaling each to a unit diagonal.
        size = np.sqrt(np.diag(normal))
        if not (np.isfinite(normal).all() and (size > 0).all()):
            return None
        scaled = normal / np.outer(size, size)
        if np.linalg.cond(scaled) > 1e9:
            return None
        inverse = np.linalg.inv(scaled) / np.outer(size, size)
        values = inverse @ right
        if "yaw" not in terms:
            break
        yaw += float(values[-1])
        if abs(values[-1]) < 1e-9:
            break
    return values, yaw, inverse, design


def residuals(
    prev: F64, after: F64, white: F64, interval: Interval, terms: tuple[str, ...], solution: _Solution
) -> F64:
    """Whitened residuals (N, 2) of a solution."""
    values, yaw, _, _ = solution
    a, b = halfway(prev, after, interval, yaw)
    jacobian, _depth = _design(a, b, interval, terms)
    values = np.array([0.0 if name == "yaw" else value for name, value in zip(terms, values, strict=True)])
    return np.asarray(np.einsum("nij,nj->ni", white, b - a - jacobian @ values), dtype=np.float64)


def _robust(
    prev: F64, after: F64, white: F64, interval: Interval, terms: tuple[str, ...]
) -> tuple[float, F64, _Solution | None]:
    """Solve by reweighted least squares: first for the sum of lengths, then with Tukey's biweight.

    Returns the scale of the whitened residuals (1 where the points' covariances are right), the weights and the
    solution.
    """
    count = len(prev)
    a, b = halfway(prev, after, interval)
    middle = np.median(b - a, axis=0)
    length = np.linalg.norm(np.einsum("nij,nj->ni", white, b - a - middle), axis=1)
    solution: _Solution | None = None
    for _ in range(12):
        weights = 1.0 / np.maximum(length, max(float(np.median(length)), 1e-9) * 0.1)
        found = _solve(prev, after, white, interval, terms, weights, solution[1] if solution else 0.0)
        if found is None:
            return 1.0, np.ones(count), None
        solution = found
        length = np.linalg.norm(residuals(prev, after, white, interval, terms, solution), axis=1)
    # The median length of two unit Gaussians is sqrt(2 ln 2); p parameters took p / 2 N of the scatter.
    dof = max(1.0 - len(terms) / (2.0 * count), 0.2)
    for _ in range(8):
        scale = max(float(np.median(length)) / 1.17741 / dof, 0.05)
        weights = np.where(length < _TUKEY * scale, (1.0 - (length / (_TUKEY * scale)) ** 2) ** 2, 0.0)
        found = _solve(prev, after, white, interval, terms, weights, solution[1] if solution else 0.0)
        if found is None:
            return scale, weights, None
        solution = found
        length = np.linalg.norm(residuals(prev, after, white, interval, terms, solution), axis=1)
    squares = float(np.sum(weights * length**2))
    freedom = max(2.0 * float(np.sum(weights)) - len(terms), 0.0)
    # The biweight trims the tails: under Gaussian noise the weighted squares come to 0.87 of the unweighted share.
    variance = (squares / 0.87 + _PRIOR_DOF) / (freedom + _PRIOR_DOF)
    return float(np.sqrt(variance)), weights, solution


def _covariance(design: F64, weights: F64, inverse: F64, scale: float, overlap: F64 | None) -> F64:
    """Covariance of the parameters where errors of points whose windows share pixels go together."""
    weighted = weights[:, None, None] * design
    if overlap is None:
        middle = np.einsum("nip,niq->pq", weighted, weighted)
    else:
        middle = np.zeros_like(inverse)
        for component in (weighted[:, 0, :], weighted[:, 1, :]):
            middle += component.T @ (overlap @ component)
    return np.asarray(scale**2 * inverse @ middle @ inverse, dtype=np.float64)


def speeds(
    prev: F64, after: F64, covariance: F64, interval: Interval, terms: tuple[str, ...], weights: F64
) -> F64 | None:
    """Velocity (3,) with weights and terms held, for the change under another camera; NaN for what is not in it."""
    solution = _solve(prev, after, _whiteners(covariance), interval, terms, weights)
    if solution is None:
        return None
    velocity = np.full(3, np.nan)
    for value, name in zip(solution[0], terms, strict=True):
        if name != "yaw":
            velocity[("vx", "vy", "vz").index(name)] = value
    return velocity
