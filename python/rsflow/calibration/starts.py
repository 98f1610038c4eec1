"""Where a calibration begins: several focal lengths, each with the poses that it gives the views."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .bundle_adjustment import SHAPE, Fit, Problem

__all__ = ["starts"]

Array = NDArray[np.float64]

# Focal lengths in sides of the picture: of fields of view of 90 to 16 degrees, for a fisheye of 180 to 60 degrees.
_FOCALS = {"pinhole": (0.5, 0.8, 1.3, 2.2, 3.6), "fisheye": (0.318, 0.41, 0.57, 0.95)}
# Rays farther off the axis are left out of a first pose, in radians (80 degrees).
_WIDEST = 1.4


def starts(problem: Problem) -> list[Fit]:
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
