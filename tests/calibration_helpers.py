"""A known camera, a printed board, and the pictures that this camera takes of it."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np

import rsflow
from rsflow.camera.board import Board

TRUTH = rsflow.Camera(
    398.3, 399.1, 236.4, 183.7, width=480, height=360, distortion=(-0.26, 0.08, 0.0009, -0.0004, -0.01)
)
BOARD, SQUARE_M = (8, 6), 0.025
SAMPLES = 3  # per pixel and axis
DOTS = 32  # of the printed board, per square


@cache
def rays() -> np.ndarray:
    """Rays of all samples of the true camera, (height, width, 2)."""
    centres = np.mgrid[0 : TRUTH.height, 0 : TRUTH.width].reshape(2, -1)[::-1].T
    at_centres = TRUTH.undistort_points(centres, normalized=True).reshape(TRUTH.height, TRUTH.width, 2)
    return cv2.resize(at_centres, None, fx=SAMPLES, fy=SAMPLES, interpolation=cv2.INTER_LINEAR)


def poses(count: int, seed: int = 4) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation vectors and positions of the board's middle: tilted, near and far, all over the picture."""
    rng = np.random.default_rng(seed)
    result = []
    for i in range(count):
        tilt, axis, distance = rng.uniform(0.3, 0.6), rng.uniform(0, 2 * math.pi), rng.uniform(0.27, 0.45)
        rotation = tilt * np.array([math.cos(axis), math.sin(axis), rng.uniform(-0.3, 0.3)])
        room = (0.6 * distance - 0.12, 0.45 * distance - 0.095)
        result.append((rotation, np.append(np.array([(i % 3) - 1.0, (i // 3 % 3) - 1.0]) * room, distance)))
    return result


def corners_in_camera(pose: tuple[np.ndarray, np.ndarray], board: Board) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation vector and translation of the board's first corner, and its rotation matrix."""
    rotation = cv2.Rodrigues(pose[0])[0]
    middle = board.points().mean(axis=0)
    return pose[0], pose[1] - rotation @ middle, rotation


def chessboard(cut: float = 0.0) -> np.ndarray:
    """The board as a picture, first corner 3 squares from the edge; `cut` squares are cut from its right side."""
    cols, rows = BOARD
    sheet = np.full(((rows + 5) * DOTS, (cols + 5) * DOTS), 90, np.uint8)
    sheet[DOTS // 2 : -DOTS // 2, DOTS // 2 : -DOTS // 2] = 205
    for y in range(rows + 1):
        for x in range(y % 2, cols + 1, 2):
            sheet[(y + 2) * DOTS : (y + 3) * DOTS, (x + 2) * DOTS : (x + 3) * DOTS] = 30
    if cut:
        sheet[:, round((cols + 3 - cut) * DOTS) :] = 90
    return sheet


def render(pose, sheet: np.ndarray, *, first=3.0, seed=0, board: Board | None = None) -> np.ndarray:
    """Render a sheet whose first corner is `first` squares from its edges: sampled, blurred, with noise."""
    _, translation, rotation = corners_in_camera(pose, board or Board(BOARD, SQUARE_M))
    inverse = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], translation]))
    to_dots = np.diag([DOTS / SQUARE_M, DOTS / SQUARE_M, 1.0])
    to_dots[:2, 2] = first * DOTS - 0.5
    where = cv2.perspectiveTransform(rays(), to_dots @ inverse).astype(np.float32)
    fine = cv2.remap(sheet, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=90)
    image = cv2.resize(fine.astype(np.float32), TRUTH.size, interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), 0.6) + np.random.default_rng(seed).normal(0, 2.0, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


@cache
def views() -> tuple[np.ndarray, ...]:
    return tuple(render(pose, chessboard(), seed=i) for i, pose in enumerate(poses(12)))


@cache
def calibration() -> rsflow.Calibration:
    return rsflow.calibrate(list(views()), board=BOARD, square_size_m=SQUARE_M)


def blank(count: int = 4) -> list[np.ndarray]:
    return [np.random.default_rng(i).integers(90, 110, (90, 120), np.uint8) for i in range(count)]
