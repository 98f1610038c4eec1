"""A camera, the poses of a board and the board's own shape, fitted together to the corners of all views.

Least squares over all parameters by Levenberg and Marquardt, with the poses eliminated. A printed board is never quite
plane and square: how it is bent and stretched is estimated too, within what is usual, so that it neither bends the
camera nor is missing from its deviations.

docs/explanation/algorithms.md, section "Calibration: calibrate".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera import distortion

__all__ = ["SHAPE", "Fit", "Problem", "fit", "linearised", "priors", "residuals_of", "weighted"]

Array = NDArray[np.float64]

# Bend along x, across, along y (height at the board's edge to half its size), stretch of x, shear; and how large each
# usually is: half a millimetre, a tenth of a millimetre on a board of 20 cm.
SHAPE = ("bend xx", "bend xy", "bend yy", "stretch", "shear")
_USUAL = np.array([0.005, 0.005, 0.005, 0.001, 0.001])

# A corner farther off than so many deviations counts less: with the weight at which its pull stays there.
_HUBER = 3.0
# No corner is known better than this, in pixels: what is smaller is rounding.
_LEAST_PX = 1e-4
# Rounds of weights.
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Problem:
    """Corners of V views, padded to the same number n of each.

    `board` (V, n, 3) in metres, `seen` (V, n, 2) in pixels, `there` (V, n) where a corner is; `ids` (V, n).
    """

    model: str
    coefficients: int
    square_pixels: bool
    size: tuple[int, int]
    board: Array
    seen: Array
    there: NDArray[np.bool_]
    ids: NDArray[np.int64]
    centre: Array
    half: float

    @classmethod
    def of(
        cls,
        board: list[NDArray[np.float32]],
        corners: list[NDArray[np.float32]],
        ids: list[NDArray[np.int64]],
        *,
        size: tuple[int, int],
        model: str,
        coefficients: int,
        square_pixels: bool,
    ) -> Problem:
        """Put the views side by side."""
        views, most = len(board), max(len(points) for points in board)
        points, seen = np.zeros((views, most, 3)), np.zeros((views, most, 2))
        there, numbers = np.zeros((views, most), bool), np.full((views, most), -1, np.int64)
        for i, (flat, found, own) in enumerate(zip(board, corners, ids, strict=True)):
            count = len(flat)
            points[i, :count], seen[i, :count] = flat.reshape(-1, 3), found.reshape(-1, 2)
            there[i, :count], numbers[i, :count] = True, own
            # Padding repeats a corner: it must be in front of the camera.
            points[i, count:] = points[i, 0]
        used = points[there]
        low, high = used.min(axis=0), used.max(axis=0)
        half = float((high - low).max()) / 2
        return cls(model, coefficients, square_pixels, size, points, seen, there, numbers, (low + high) / 2, half)

    @property
    def inner(self) -> int:
        """Number of the camera's parameters."""
        return 4 + self.coefficients - self.square_pixels


@dataclass(frozen=True, eq=False)
class Fit:
    """What a fit gives, or begins with.

    `camera` fx, fy, cx, cy, distortion; `shape` of the board; `rotations` (V, 3, 3), `translations` (V, 3) of the
    middle of the board; `residuals` (V, n, 2) seen minus modelled; `weights` (V, n); `sigma` of a coordinate in pixels;
    `cost` the weighted sum of squares with the priors', in pixels squared.
    """

    camera: Array
    shape: Array
    rotations: Array
    translations: Array
    residuals: Array
    weights: Array
    sigma: float
    cost: float
    settled: bool


def priors(problem: Problem, state: Fit) -> Array:
    """Weights that hold what no view determines, for camera and shape: pixels a unit of each.

    The board's shape is as usual; each term of the lens moves what is at the edge by no more than its whole radius,
    which no view with a say in it notices.
    """
    lens = np.zeros(problem.inner)
    if problem.coefficients:
        off = (problem.seen - state.camera[2:4])[problem.there] / state.camera[:2]
        reach = float(np.linalg.norm(off, axis=1).max())
        powers = (2, 4, 6, 8) if problem.model == "fisheye" else (2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3)
        lens[-problem.coefficients :] = state.sigma * reach ** np.array(powers[: problem.coefficients], np.float64)
    return np.concatenate([lens, state.sigma / _USUAL])


def _shaped(problem: Problem, shape: Array) -> tuple[Array, Array]:
    """Points of the board about its middle, (V, n, 3), and their derivative by the shape, (V, n, 3, 5)."""
    points = problem.board - problem.centre
    x, y = points[..., 0], points[..., 1]
    u, v = x / problem.half, y / problem.half
    slope = np.zeros((*points.shape, len(SHAPE)))
    for k, bend in enumerate((u * u, u * v, v * v)):
        slope[..., 2, k] = problem.half * bend
    slope[..., 0, 3], slope[..., 0, 4] = x, y
    return points + slope @ shape, slope


def _by_coefficients(model: str, coefficients: Array, x: Array, y: Array) -> Array:
    """Give the derivatives of the distorted coordinates by the coefficients, (..., 2, count)."""
    count = len(coefficients)
    result = np.zeros((*x.shape, 2, count))
    if model == "fisheye":
        r = np.hypot(x, y)
        theta = np.arctan(r)
        share = np.where(r > 1e-9, 1.0 / np.maximum(r, 1e-9), 0.0)
        for k in range(count):
            bent = theta ** (2 * k + 3) * share
            result[..., 0, k], result[..., 1, k] = x * bent, y * bent
        return result
    full = np.concatenate([coefficients, np.zeros(12 - count)])
    r2 = x * x + y * y
    low = 1.0 + r2 * (full[5] + r2 * (full[6] + r2 * full[7]))
    radial = (1.0 + r2 * (full[0] + r2 * (full[1] + r2 * full[4]))) / low
    columns = [
        (x * r2 / low, y * r2 / low),
        (x * r2**2 / low, y * r2**2 / low),
        (2 * x * y, r2 + 2 * y * y),
        (r2 + 2 * x * x, 2 * x * y),
        (x * r2**3 / low, y * r2**3 / low),
        *((-factor * x * radial / low, -factor * y * radial / low) for factor in (r2, r2**2, r2**3)),
        (r2, 0 * r2),
        (r2**2, 0 * r2),
        (0 * r2, r2),
        (0 * r2, r2**2),
    ]
    for k in range(count):
        result[..., 0, k], result[..., 1, k] = columns[k]
    return result


def _project(problem: Problem, state: Fit, *, slopes: bool) -> tuple[Array, Array, Array]:
    """Residuals (V, n, 2), and derivatives of the projection by camera and shape (V, n, 2, q) and pose (V, n, 2, 6)."""
    points, by_shape = _shaped(problem, state.shape)
    turned = np.einsum("vij,vnj->vni", state.rotations, points)
    at = turned + state.translations[:, None, :]
    z = np.where(at[..., 2] > 1e-9, at[..., 2], np.nan)
    x, y = at[..., 0] / z, at[..., 1] / z
    focal, middle, lens = state.camera[:2], state.camera[2:4], state.camera[4:]
    flat = np.stack([x.ravel(), y.ravel()])
    mapped = [value.reshape(x.shape) for value in distortion.lens_map(problem.model, lens.tolist(), flat[0], flat[1])]
    distorted = np.stack(mapped[:2], axis=-1)
    residual = np.where(problem.there[..., None], problem.seen - (distorted * focal + middle), 0.0)
    if not slopes:
        return residual, residual, residual
    # By the ray, then by the point in the camera.
    by_ray = np.stack([np.stack(mapped[2:4], axis=-1), np.stack(mapped[4:6], axis=-1)], axis=-2) * focal[:, None]
    zero = np.zeros_like(x)
    ray_by_at = np.stack([np.stack([1 / z, zero, -x / z], axis=-1), np.stack([zero, 1 / z, -y / z], axis=-1)], axis=-2)
    by_at = by_ray @ ray_by_at
    # exp(w) R: the point moves by w x (R p).
    a, b, c = np.moveaxis(turned, -1, 0)
    cross = np.stack(
        [np.stack([zero, c, -b], axis=-1), np.stack([-c, zero, a], axis=-1), np.stack([b, -a, zero], axis=-1)], axis=-2
    )
    pose = np.concatenate([by_at @ cross, by_at], axis=-1)
    intrinsic = np.zeros((*x.shape, 2, 4))
    intrinsic[..., 0, 0], intrinsic[..., 1, 1] = distorted[..., 0], distorted[..., 1]
    intrinsic[..., 0, 2] = intrinsic[..., 1, 3] = 1.0
    if problem.square_pixels:
        intrinsic = np.concatenate([intrinsic[..., :1] + intrinsic[..., 1:2], intrinsic[..., 2:]], axis=-1)
    by_lens = _by_coefficients(problem.model, lens, x, y) * focal[:, None]
    shape = by_at @ (state.rotations[:, None] @ by_shape)
    inner = np.concatenate([intrinsic, by_lens, shape], axis=-1)
    inner[~problem.there], pose[~problem.there] = 0.0, 0.0
    return residual, inner, pose


def residuals_of(problem: Problem, state: Fit) -> Array:
    """Seen minus modelled corners, (V, n, 2) in pixels, zero where there is none."""
    return _project(problem, state, slopes=False)[0]


def linearised(problem: Problem, state: Fit) -> tuple[Array, Array, Array]:
    """Residuals and derivatives by camera and shape, and by the pose, at a fit."""
    return _project(problem, state, slopes=True)


def _moved(problem: Problem, state: Fit, inner: Array, pose: Array) -> Fit:
    step = inner[: problem.inner]
    camera = state.camera.copy()
    camera += np.concatenate([step[:1], step]) if problem.square_pixels else step
    turn = pose[:, :3]
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    safe = np.maximum(angle, 1e-12)
    zero = np.zeros(len(turn))
    wx, wy, wz = turn.T
    skew = np.stack([zero, -wz, wy, wz, zero, -wx, -wy, wx, zero], axis=1).reshape(-1, 3, 3)
    rotation = np.eye(3) + np.sin(angle) / safe * skew + (1 - np.cos(angle)) / safe**2 * (skew @ skew)
    return replace(
        state,
        camera=camera,
        shape=state.shape + inner[problem.inner :],
        rotations=rotation @ state.rotations,
        translations=state.translations + pose[:, 3:],
    )


def _cost(problem: Problem, state: Fit, prior: Array) -> tuple[float, Array]:
    with np.errstate(all="ignore"):
        residual = residuals_of(problem, state)
    if state.camera[0] <= 0 or state.camera[1] <= 0 or not np.isfinite(residual).all():
        return np.inf, residual
    held = prior * _values(problem, state)
    return float((state.weights * (residual**2).sum(axis=-1)).sum() + (held**2).sum()), residual


def _values(problem: Problem, state: Fit) -> Array:
    """Camera and shape as one vector, as the derivatives order them."""
    return np.concatenate([state.camera[problem.square_pixels :], state.shape])


def _descend(problem: Problem, state: Fit, prior: Array, steps: int, free: NDArray[np.bool_]) -> Fit:
    """Go down to the minimum with the weights held; only `free` parameters of camera and shape move."""
    damping = 1e-3
    cost, residual = _cost(problem, state, prior)
    settled = False
    for _ in range(steps):
        _, inner, pose = _project(problem, state, slopes=True)
        root = np.sqrt(state.weights)[..., None]
        views = len(residual)
        r = (root * residual).reshape(views, -1)
        J = (root[..., None] * inner).reshape(views, r.shape[1], -1)[:, :, free]
        P = (root[..., None] * pose).reshape(views, r.shape[1], 6)
        pp = np.einsum("vik,vil->vkl", P, P)
        ip = np.einsum("vik,vil->vkl", J, P)
        ii, gi = np.einsum("vik,vil->kl", J, J), np.einsum("vik,vi->k", J, r)
        gp = np.einsum("vik,vi->vk", P, r)
        held = (prior**2)[free]
        ii = ii + np.diag(held)
        gi = gi - held * _values(problem, state)[free]
        improved = False
        for _ in range(8):
            pp_damped = pp + damping * np.einsum("vii->vi", pp)[:, :, None] * np.eye(6)
            inverse = np.linalg.inv(pp_damped)
            reduced = ii + damping * np.diag(np.diag(ii)) - np.einsum("vik,vkl,vml->im", ip, inverse, ip)
            right = gi - np.einsum("vik,vkl,vl->i", ip, inverse, gp)
            scale = np.sqrt(np.maximum(np.diag(ii), 1e-300))
            try:
                step = np.linalg.solve(reduced / np.outer(scale, scale), right / scale) / scale
            except np.linalg.LinAlgError:
                damping *= 10
                continue
            turn = np.einsum("vkl,vl->vk", inverse, gp - np.einsum("vik,i->vk", ip, step))
            whole = np.zeros(len(free))
            whole[free] = step
            trial = _moved(problem, state, whole, turn)
            trial_cost, trial_residual = _cost(problem, trial, prior)
            if trial_cost <= cost:
                improved = True
                break
            damping *= 6
        if not improved:
            settled = True
            break
        gain, state, residual = cost - trial_cost, trial, trial_residual
        cost = trial_cost
        damping = max(damping / 10, 1e-12)
        if gain <= 1e-7 * cost:
            settled = True
            break
    return replace(state, residuals=residual, cost=cost, settled=settled)


def fit(
    problem: Problem,
    start: Fit,
    *,
    steps: int = 60,
    rounds: int = _ROUNDS,
    held: tuple[int, ...] = (),
    shaped: bool = True,
) -> Fit:
    """Fit from a start; weights and sigma are found again `rounds` times, or stay as they are.

    Parameters
    ----------
    held
        Parameters of the camera that do not move.
    shaped
        Whether the board's shape is estimated; else it stays.
    """
    free = np.ones(problem.inner + len(SHAPE), bool)
    free[list(held)] = False
    free[problem.inner :] = shaped
    state = start
    for number in range(max(rounds, 1)):
        state = _descend(problem, state, priors(problem, state), steps, free)
        if rounds:
            before = state.sigma
            state = weighted(problem, state)
            if number and abs(state.sigma / before - 1.0) < 1e-3:
                break
    return state


def weighted(problem: Problem, state: Fit) -> Fit:
    """Find the deviation of a coordinate with the right degrees of freedom, and how much each corner counts."""
    length = np.linalg.norm(state.residuals, axis=-1)
    inside = length[problem.there]
    count = 2 * len(inside)
    freedom = max(count - problem.inner - 6 * len(length), 1)
    # The median length of two unit Gaussians is sqrt(2 ln 2); the parameters took their share of the scatter.
    robust = max(float(np.median(inside)) / 1.17741 * np.sqrt(count / freedom), _LEAST_PX)
    weights = np.where(problem.there, np.minimum(1.0, _HUBER * robust / np.maximum(length, 1e-12)), 0.0)
    squares = float((np.minimum(length, _HUBER * robust) ** 2)[problem.there].sum())
    sigma = max(float(np.sqrt(squares / freedom)), _LEAST_PX)
    return replace(state, weights=weights, sigma=sigma)
