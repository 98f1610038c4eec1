"""The motion of the camera in the picture: the simplest model that explains a flow field, fitted robustly.

docs/algorithms.md, section "What moves: MotionSegmenter".
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from .. import _core

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F64 = NDArray[np.float64]

# Of flow that comes without a covariance: the standard deviation of a component, in pixels.
_STD_PX = 0.1
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


def apply(homography: F64, points: F64) -> F64:
    """Map (n, 2) points by a homography."""
    x, y = points[:, 0], points[:, 1]
    rows = [h[0] * x + h[1] * y + h[2] for h in homography]
    return np.column_stack([rows[0] / rows[2], rows[1] / rows[2]])


def rows(points: F64, vectors: F64, covariance: F64 | None = None) -> F64:
    """Put points, vectors and covariances, (n, 2), (n, 2) and (n, 2, 2), into the rows that `_core` takes."""
    if covariance is None:
        parts = np.tile([_STD_PX**2, 0.0, _STD_PX**2], (len(points), 1))
    else:
        parts = covariance.reshape(-1, 4)[:, [0, 1, 3]]
    return np.ascontiguousarray(np.column_stack([points, vectors, parts]), np.float64)


def picked(covariance: NDArray[np.float32] | None, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> F64 | None:
    """Pick the covariances of some pixels of a flow that has them, (H, W, 2, 2)."""
    return None if covariance is None else covariance[rows, columns].astype(np.float64)


def fit(points: F64, vectors: F64, covariance: F64 | None = None, before: F64 | None = None) -> CameraMotion:
    """Fit the simplest model to motion vectors, most of which are the camera's.

    Parameters
    ----------
    points, vectors : (n, 2) float64
        Where the vectors stand and the motion in pixels; far enough from each other for independent errors.
    covariance : (n, 2, 2) float64, optional
        Of the vectors, in squared pixels.
    before : (3, 3) float64, optional
        The homography of the frame before: of planes that explain alike much of the frame the one that goes on as
        before is taken.

    Returns
    -------
    CameraMotion
        With the model ``"none"`` for fewer than 12 vectors.
    """
    kept = None if before is None else before.tolist()
    homography, model, sigma, explained = _core.fit_camera(rows(points, vectors, covariance), kept)
    return CameraMotion(np.array(homography), model, sigma, explained)


def spread_evenly(rows: NDArray[np.intp], columns: NDArray[np.intp], shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Choose a few vectors of each tile, so that the camera's motion is not that of what has texture."""
    tile = (rows * _TILES // shape[0]) * _TILES + columns * _TILES // shape[1]
    chosen = []
    for number in np.unique(tile):
        inside = np.nonzero(tile == number)[0]
        chosen.append(inside[:: -(-len(inside) // _VECTORS_A_TILE)])
    return np.concatenate(chosen) if chosen else np.zeros(0, np.intp)
