"""Parallax: what a scene with depth does when the camera travels, told from things that move.

Against the motion of a plane, everything that stands still moves along lines through one point, the epipole (M. Irani
and P. Anandan, "A unified approach to moving object detection in 2D and 3D scenes", PAMI 1998). What moves along such a
line by itself cannot be told from depth.

docs/algorithms.md, section "What moves: MotionSegmenter".
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

# A camera whose picture moves less than this, in pixels, does not travel: then nothing is parallax.
_LEAST_TRAVEL_PX = 0.5
# Fewer vectors off the plane, as a number and as a share, are things that move. Flow is not valid within a few pixels
# of an edge of motion: of a thing 25 pixels across, a third has vectors. Beyond this many deviations and pixels a
# vector is off the plane, or off its line.
_FEWEST = 30
_LEAST_SHARE = 0.015
_SIGMAS = 3.7
_LEAST_PX = 0.25
# One thing that moves by itself also moves along lines through one point. Depth is in several places, or in much of the
# frame: so many separate groups of tiles of this many along each side, or this share of the tiles. A tile tells where
# this share of its vectors is off the plane and on its line.
_TILES = 8
_PLACES = 3
_LARGE_SHARE = 0.3
_SHARE_OF_TILE = 0.25
# This share of the vectors off the plane must keep to their lines: some are of things that move, and of edges, where
# flow is of neither side. Where the frame before had depth, less is enough.
_AGREEMENT = 0.6
_AGREEMENT_KEPT = 0.4
_TRIALS = 200


def epipole(points: F64, vectors: F64, by_plane: F64, sigma_px: float, *, before: bool) -> F64 | None:
    """Find the epipole in the next picture, homogeneous and of unit length; None where nothing is parallax.

    Parameters
    ----------
    points, vectors : (n, 2) float64
        Where the motion vectors stand, and they.
    by_plane : (n, 2) float64
        Where the plane's motion takes the points.
    sigma_px : float
        Standard deviation of a component of the vectors that follow the plane.
    before : bool
        Whether the frame before had parallax.
    """
    limit = max(_SIGMAS * sigma_px, _LEAST_PX)
    along = points + vectors - by_plane
    off = np.hypot(*along.T) > limit
    if np.count_nonzero(off) < max(_FEWEST, _LEAST_SHARE * len(points)):
        return None
    if np.median(np.hypot(*(by_plane - points).T)) < _LEAST_TRAVEL_PX:
        return None
    along, ends = along[off], (points + vectors)[off]
    # About unit size, for lines of like weight.
    centre, size = points.mean(axis=0), max(float(points.std(axis=0).max()), 1.0)
    places, along = (ends - centre) / size, along / size
    limit /= size
    lines = np.cross(np.column_stack([places, np.ones(len(places))]), np.column_stack([along, np.zeros(len(along))]))
    best, inside = None, np.zeros(len(lines), bool)
    # The same trials for the same input.
    for i, j in np.random.default_rng(0).integers(0, len(lines), (_TRIALS, 2)):
        point = np.cross(lines[i], lines[j])
        length = float(np.linalg.norm(point))
        if length < 1e-9:
            continue
        kept = np.hypot(*across(along, places, point / length).T) < limit
        if kept.sum() > inside.sum():
            best, inside = point / length, kept
    if best is None:
        return None
    # The point nearest to all lines that keep to it, each weighted by how far it moves.
    best = np.linalg.svd(lines[inside])[2][-1]
    inside = np.hypot(*across(along, places, best).T) < limit
    if np.mean(inside) < (_AGREEMENT_KEPT if before else _AGREEMENT) or not _spread_out(points[off][inside], points):
        return None
    to_pixels = np.array([[size, 0, centre[0]], [0, size, centre[1]], [0, 0, 1]])
    best = to_pixels @ best
    found: F64 = best / np.linalg.norm(best)
    return found


def across(motion: F64, places: F64, point: F64) -> F64:
    """Give the part of motions at places, (..., 2) each, that is across the lines to a homogeneous point."""
    toward = point[:2] - point[2] * places
    length = np.sqrt((toward * toward).sum(axis=-1, keepdims=True))
    toward = toward / np.maximum(length, 1e-12)
    out: F64 = motion - (motion * toward).sum(axis=-1, keepdims=True) * toward
    return out


def _spread_out(these: F64, points: F64) -> bool:
    """Whether these of all points are in several places, or in much of the frame."""
    import cv2

    low, high = points.min(axis=0), points.max(axis=0)
    edges = [np.linspace(low[axis], high[axis] + 1e-9, _TILES + 1) for axis in (0, 1)]
    counts, every = (np.histogram2d(p[:, 0], p[:, 1], edges)[0] for p in (these, points))
    told = (counts > 1) & (counts > _SHARE_OF_TILE * every)
    groups, _ = cv2.connectedComponents(told.view(np.uint8), connectivity=8)
    return groups - 1 >= _PLACES or float(told.mean()) >= _LARGE_SHARE
