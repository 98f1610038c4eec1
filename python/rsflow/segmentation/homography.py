"""The motion of the camera in the picture: the simplest model that explains a flow field, fitted robustly.

Translation, similarity, affine map or homography, chosen by Bayes' information criterion with a bounded loss, so that
things which move on their own neither bend the model nor buy it more parameters.

docs/algorithms.md, section "What moves: MotionSegmenter".
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    F64 = NDArray[np.float64]

# Tukey's biweight: 95 % efficiency for normal errors.
_TUKEY = 4.685
# Beyond this many sigma (99.9 % of two normal components) a vector no longer adds to the evidence.
_BOUND = 3.7**2
_ITERATIONS = 8
# Flow is not better than this, whatever the residuals say: interpolation and quantisation, in pixels.
_LEAST_SIGMA_PX = 0.02
_FEWEST = 12
# The frame is divided into so many tiles along each side, and each gives at most so many vectors.
_TILES = 8
_VECTORS_A_TILE = 8


@dataclasses.dataclass(frozen=True)
class CameraMotion:
    """The fitted model.

    Attributes
    ----------
    homography : (3, 3) float64
        Maps a pixel of the previous picture to where the camera's motion takes it.
    model : str
        ``"translation"``, ``"similarity"``, ``"affine"`` or ``"homography"``; ``"none"`` where nothing could be
        fitted, and then the homography is the identity.
    sigma_px : float
        Robust standard deviation of a component of the vectors that follow the model.
    explained : float
        Share of the vectors that follow the model, 0 to 1.
    """

    homography: F64
    model: str
    sigma_px: float
    explained: float


def _translation(p: F64, q: F64, w: F64) -> F64:
    out = np.eye(3)
    out[:2, 2] = (w[:, None] * (q - p)).sum(axis=0) / w.sum()
    return out


def _similarity(p: F64, q: F64, w: F64) -> F64:
    # q = [a -b; b a] p + t
    rows = np.zeros((len(p), 2, 4))
    rows[:, 0] = np.column_stack([p[:, 0], -p[:, 1], np.ones(len(p)), np.zeros(len(p))])
    rows[:, 1] = np.column_stack([p[:, 1], p[:, 0], np.zeros(len(p)), np.ones(len(p))])
    a, b, tx, ty = _solve(rows, q, w)
    return np.array([[a, -b, tx], [b, a, ty], [0, 0, 1]])


def _affine(p: F64, q: F64, w: F64) -> F64:
    one = np.column_stack([p, np.ones(len(p))])
    rows = np.zeros((len(p), 2, 6))
    rows[:, 0, :3] = one
    rows[:, 1, 3:] = one
    return np.vstack([_solve(rows, q, w).reshape(2, 3), [0, 0, 1]])


def _homography(p: F64, q: F64, w: F64) -> F64:
    one = np.column_stack([p, np.ones(len(p))])
    rows = np.zeros((len(p), 2, 8))
    rows[:, 0, :3] = one
    rows[:, 1, 3:6] = one
    rows[:, :, 6:] = -q[:, :, None] * p[:, None, :]
    return np.append(_solve(rows, q, w), 1.0).reshape(3, 3)


def _solve(rows: F64, q: F64, w: F64) -> F64:
    """Weighted least squares of rows (n, 2, k) against q (n, 2)."""
    weighted = rows * w[:, None, None]
    normal = np.einsum("nij,nik->jk", weighted, rows)
    right = np.einsum("nij,ni->j", weighted, q)
    # A touch of damping: where the points do not tell a parameter it stays at zero instead of running away.
    damping = 1e-12 * np.trace(normal)
    return np.asarray(np.linalg.solve(normal + damping * np.eye(len(normal)), right))


_MODELS: tuple[tuple[str, int, Callable[[F64, F64, F64], F64]], ...] = (
    ("translation", 2, _translation),
    ("similarity", 4, _similarity),
    ("affine", 6, _affine),
    ("homography", 8, _homography),
)


def apply(homography: F64, points: F64) -> F64:
    """Map (n, 2) points by a homography."""
    x, y = points[:, 0], points[:, 1]
    rows = [h[0] * x + h[1] * y + h[2] for h in homography]
    return np.column_stack([rows[0] / rows[2], rows[1] / rows[2]])


def fit(points: F64, vectors: F64) -> CameraMotion:
    """Fit the simplest model to motion vectors, most of which are the camera's.

    Parameters
    ----------
    points, vectors : (n, 2) float64
        Where the vectors stand and the motion in pixels, finite; far enough from each other for independent errors.

    Returns
    -------
    CameraMotion
        With the model ``"none"`` for fewer than 12 vectors.
    """
    if len(points) < _FEWEST:
        return CameraMotion(np.eye(3), "none", math.inf, 0.0)
    # Coordinates of about unit size keep the normal equations well conditioned.
    centre, size = points.mean(axis=0), max(float(points.std(axis=0).max()), 1.0)
    p, q = (points - centre) / size, (points + vectors - centre) / size
    start = np.eye(3)
    start[:2, 2] = np.median(q - p, axis=0)
    fits = []
    for name, parameters, solve in _MODELS:
        model = _robust(p, q, start, solve, size)
        fits.append((name, parameters, model, np.hypot(*(apply(model, p) - q).T) * size))
        start = model
    # The noise is what the richest model leaves.
    sigma = _sigma(min((residual for *_, residual in fits), key=lambda residual: float(np.median(residual))))
    evidence = [
        np.minimum((residual / sigma) ** 2, _BOUND).sum() + parameters * math.log(2 * len(p))
        for _, parameters, _, residual in fits
    ]
    best = fits[int(np.argmin(evidence))]
    # Errors of neighbouring vectors are alike: what a richer model explains by less than flow can tell is no motion.
    name, _, model, residual = next(
        simple
        for simple in fits
        if simple is best or np.sqrt(np.mean((apply(simple[2], p) - apply(best[2], p)) ** 2)) * size < _LEAST_SIGMA_PX
    )
    to_unit = np.array([[1 / size, 0, -centre[0] / size], [0, 1 / size, -centre[1] / size], [0, 0, 1]])
    homography = np.linalg.inv(to_unit) @ model @ to_unit
    homography /= homography[2, 2]
    sigma = _sigma(residual)
    follows = (residual / sigma) ** 2 < _BOUND
    return CameraMotion(homography, name, sigma, float(np.mean(follows)))


def _robust(p: F64, q: F64, start: F64, solve: Callable[[F64, F64, F64], F64], size: float) -> F64:
    """Reweighted least squares from a simpler model's solution, with Tukey's weight and a scale that is fitted too."""
    model = start
    for _ in range(_ITERATIONS):
        residual = np.hypot(*(apply(model, p) - q).T) * size
        w = np.clip(1 - (residual / (_TUKEY * _sigma(residual))) ** 2, 0, None) ** 2
        model = solve(p, q, w)
    return model


def _sigma(residual: F64) -> float:
    """Estimate the deviation of one component from lengths: a Rayleigh distribution's median is 1.1774 sigma."""
    return max(float(np.median(residual)) / 1.1774, _LEAST_SIGMA_PX)


def spread_evenly(rows: NDArray[np.intp], columns: NDArray[np.intp], shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Choose a few vectors of each tile, so that the camera's motion is not that of what has texture."""
    tile = (rows * _TILES // shape[0]) * _TILES + columns * _TILES // shape[1]
    chosen = []
    for number in np.unique(tile):
        inside = np.nonzero(tile == number)[0]
        chosen.append(inside[:: -(-len(inside) // _VECTORS_A_TILE)])
    return np.concatenate(chosen) if chosen else np.zeros(0, np.intp)
