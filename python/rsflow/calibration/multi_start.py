"""The fit from several starts: a focal length each, with the poses that it gives the views; the best end counts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .bundle_adjustment import SHAPE, Fit, Problem, fit, residuals_of, weighted

__all__ = ["MOST_CORNERS", "STEPS", "best", "ends", "thinned"]

Array = NDArray[np.float64]

# Focal lengths in sides of the picture: of fields of view of 90 to 16 degrees, for a fisheye of 180 to 60 degrees.
_FOCALS = {"pinhole": (0.5, 0.8, 1.3, 2.2, 3.6), "fisheye": (0.318, 0.41, 0.57, 0.95)}
# Distortion coefficients that a fit begins with; the others join when those have settled.
_FIRST = 5
# Corners of all views that a fit takes at most, that the starts are tried on, and that each view keeps.
MOST_CORNERS, _START_CORNERS, _LEAST_CORNERS = 12000, 2500, 12
# Steps from each start, and from there on with all parameters.
_START_STEPS, STEPS = 40, 60
# Rays farther off the axis are left out of a first pose, in radians (80 degrees).
_WIDEST = 1.4


def _starts(problem: Problem) -> list[Fit]:
    """Give a start for each focal length, without distortion, the principal point in the middle."""
    width, height = problem.size
    side = float(max(width, height))
    focals = [share * side for share in _FOCALS[problem.model]]
    found = []
    for focal in focals:
        camera = np.concatenate([[focal, focal, (width - 1) / 2, (height - 1) / 2], np.zeros(problem.coefficients)])
        poses = [_pose(problem, view, camera) for view in range(len(problem.board))]
        if any(pose is None for pose in poses):
            continue
        rotations = np.array([pose[0] for pose in poses if pose is not None])
        translations = np.array([pose[1] for pose in poses if pose is not None])
        found.append(
            Fit(
                camera,
                np.zeros(len(SHAPE)),
                rotations,
                translations,
                np.zeros(problem.seen.shape),
                problem.there.astype(np.float64),
                1.0,
                np.inf,
                False,
            )
        )
    return found


def _pose(problem: Problem, view: int, camera: Array) -> tuple[Array, Array] | None:
    """Rotation of the board and place of its middle for one view, from the homography to its rays."""
    import cv2

    there = problem.there[view]
    flat = (problem.board[view] - problem.centre)[there][:, :2] / problem.half
    rays = (problem.seen[view][there] - camera[2:4]) / camera[:2]
    if problem.model == "fisheye":
        theta = np.linalg.norm(rays, axis=1)
        inside = theta < _WIDEST
        if inside.sum() < 6:
            return None
        scale = np.tan(np.minimum(theta, _WIDEST)) / np.maximum(theta, 1e-12)
        flat, rays = flat[inside], (rays * np.where(theta > 1e-9, scale, 1.0)[:, None])[inside]
    homography = cv2.findHomography(flat, rays)[0]
    if homography is None or not np.isfinite(homography).all():
        return None
    columns = np.linalg.norm(homography[:, :2], axis=0)
    if not (columns > 0).all():
        return None
    homography = homography / np.sqrt(columns[0] * columns[1])
    if homography[2, 2] < 0:
        homography = -homography
    across = np.cross(homography[:, 0], homography[:, 1])
    left, _, right = np.linalg.svd(np.column_stack([homography[:, :2], across]))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    translation = homography[:, 2] * problem.half
    depth = ((problem.board[view] - problem.centre) @ rotation.T + translation)[:, 2]
    if not (depth > 0).all():
        return None
    return rotation, translation


def ends(problem: Problem) -> list[Fit]:
    """Where each start leads, on a plane board and with few coefficients, the best first."""
    first = thinned(replace(problem, coefficients=min(problem.coefficients, _FIRST)), _START_CORNERS)
    reached = [fit(first, start, steps=_START_STEPS, rounds=0, shaped=False) for start in _starts(first)]
    return sorted((end for end in reached if math.isfinite(end.cost)), key=lambda end: end.cost)


def thinned(problem: Problem, most: int) -> Problem:
    """Take fewer corners of large boards, evenly, so that time is bounded: what is wrong is not the corners' noise."""
    every = int(problem.there.sum()) // most + 1
    if every == 1:
        return problem
    kept = problem.there & (np.arange(problem.there.shape[1]) % every == 0)
    # A view needs enough for its pose.
    few = kept.sum(axis=1) < _LEAST_CORNERS
    kept[few] = problem.there[few]
    return replace(problem, there=kept)


def best(problem: Problem, begun: list[Fit]) -> Fit:
    """Go on from the best end with all parameters, and with corners that lie off counting less."""
    end = begun[0]
    lens = np.zeros(problem.coefficients)
    lens[: len(end.camera) - 4] = end.camera[4:]
    start = replace(end, camera=np.concatenate([end.camera[:4], lens]))
    start = replace(start, residuals=residuals_of(problem, start), weights=problem.there.astype(np.float64))
    return fit(problem, weighted(problem, start), steps=STEPS)
