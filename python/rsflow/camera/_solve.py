"""The least squares of a calibration, and honest deviations of what it gives.

OpenCV finds the parameters. Its own deviations hold when the errors of all corners are independent, which they are
not: those of one view share the board's bend, the blur and the light. So the views are taken as the independent
observations, and the deviations are those of the jackknife that leaves out one view at a time, linearised at the
solution (Bell and McCaffrey 2002, "Bias reduction in standard errors for linear regression with multi-stage samples").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError

Array = NDArray[np.float64]

# Condition number of the scaled normal equations beyond which they are singular: good views have some thousand, a board
# that is never tilted 1e13.
_SINGULAR = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Parameters in the order fx, fy, cx, cy, then the distortion coefficients."""

    values: Array
    std: Array
    rms: float
    rotations: list[Array]
    translations: list[Array]
    residuals: list[Array]
    # How far the parameters move when a view is left out, (views, parameters).
    influence: Array


def solve(
    board: list[NDArray[np.float32]],
    corners: list[NDArray[np.float32]],
    size: tuple[int, int],
    coefficients: int,
    square_pixels: bool,
) -> Solution:
    """Calibrate from corners on the board, (N, 3) each, and in the pictures, (N, 2) each."""
    import cv2

    flags = cv2.CALIB_FIX_ASPECT_RATIO if square_pixels else 0
    flags |= {
        0: cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
        4: cv2.CALIB_FIX_K3,
        5: 0,
        8: cv2.CALIB_RATIONAL_MODEL,
        12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL,
    }[coefficients]
    try:
        answer = cv2.calibrateCameraExtended(
            [points.reshape(-1, 1, 3) for points in board],
            [points.reshape(-1, 1, 2) for points in corners],
            size,
            np.eye(3),
            np.zeros(14 if coefficients > 5 else 5),
            flags=flags,
        )
    except cv2.error as error:
        raise CalibrationError(f"the views do not determine a camera: {_last_line(error)}") from None
    rms, matrix, lens, rotations, translations = answer[:5]
    values = np.concatenate([[matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]], np.ravel(lens)[:coefficients]])
    if not np.isfinite(values).all() or values[0] <= 0 or values[1] <= 0 or not np.isfinite(rms):
        raise CalibrationError(f"the views do not determine a camera: got fx, fy = {values[0]:.6g}, {values[1]:.6g}")
    formal = np.ravel(answer[5])[: 4 + coefficients].astype(np.float64)
    if square_pixels:
        formal[0] = formal[1]
    poses = list(zip(rotations, translations, strict=True))
    spread, influence, residuals = _jackknife(board, corners, matrix, lens, poses, coefficients, square_pixels)
    # With few views the jackknife itself is uncertain: it may raise the formal deviation, never lower it.
    return Solution(
        values,
        np.fmax(formal, spread),
        float(rms),
        [np.ravel(rotation) for rotation in rotations],
        [np.ravel(translation) for translation in translations],
        residuals,
        influence,
    )


def _jackknife(
    board: list[NDArray[np.float32]],
    corners: list[NDArray[np.float32]],
    matrix: Array,
    lens: Array,
    poses: list[tuple[Array, Array]],
    coefficients: int,
    square_pixels: bool,
) -> tuple[Array, Array, list[Array]]:
    """Leave out each view in turn, with its pose eliminated; all in the linearised problem."""
    import cv2

    information, gradients, residuals = [], [], []
    for points, seen, (rotation, translation) in zip(board, corners, poses, strict=True):
        projected, jacobian = cv2.projectPoints(points, rotation, translation, matrix, lens)
        residual = (seen.reshape(-1, 2) - projected.reshape(-1, 2)).astype(np.float64)
        residuals.append(residual)
        pose = np.linalg.qr(jacobian[:, :6])[0]
        inner = jacobian[:, 6 : 10 + coefficients]
        if square_pixels:
            # One focal length for both axes: fx follows fy, with the ratio fixed at 1.
            inner = np.column_stack([inner[:, 0] + inner[:, 1], inner[:, 2:]])
        inner = inner - pose @ (pose.T @ inner)
        information.append(inner.T @ inner)
        gradients.append(inner.T @ residual.ravel())
    total = np.sum(information, axis=0)
    scale = np.sqrt(np.diag(total))
    scale[scale == 0] = 1.0
    if not np.linalg.cond(total / np.outer(scale, scale)) < _SINGULAR:
        raise CalibrationError(
            "the views do not determine a camera: tilt the board by 20 to 45 degrees, in different directions"
        )
    moved = np.full((len(board), total.shape[0]), np.nan)
    for i, (own, gradient) in enumerate(zip(information, gradients, strict=True)):
        rest = (total - own) / np.outer(scale, scale)
        # Views that do not determine the camera once this one is gone say nothing by leaving it out.
        if np.linalg.cond(rest) < _SINGULAR:
            moved[i] = -np.linalg.solve(rest, gradient / scale) / scale
    count = len(board)
    if np.isfinite(moved).all():
        spread = np.sqrt((count - 1) / count * np.sum((moved - moved.mean(axis=0)) ** 2, axis=0))
    else:
        spread = np.full(total.shape[0], np.nan)
    if square_pixels:
        spread = np.concatenate([spread[:1], spread])
        moved = np.column_stack([moved[:, :1], moved])
    return spread, moved, residuals


def _last_line(error: Exception) -> str:
    lines = str(getattr(error, "err", "") or error).strip().splitlines()
    return lines[-1] if lines else type(error).__name__
