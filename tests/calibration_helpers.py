"""A known camera, a printed board, and the pictures that this camera takes of it."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np

import rsflow
from rsflow.calibration import Board
from rsflow.synthetic.boards import DOTS, FIRST_CORNER, chessboard_sheet, sample_rays, seen

TRUTH = rsflow.Camera(
    398.3, 399.1, 236.4, 183.7, width=480, height=360, distortion=(-0.26, 0.08, 0.0009, -0.0004, -0.01)
)
BOARD, SQUARE_M = (8, 6), 0.025


@cache
def rays() -> np.ndarray:
    return sample_rays(TRUTH)


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
    """The board as a picture; `cut` squares are cut from its right side."""
    sheet = chessboard_sheet(BOARD)
    if cut:
        sheet[:, round((BOARD[0] + 3 - cut) * DOTS) :] = 90
    return sheet


def render(pose, sheet: np.ndarray, *, first=FIRST_CORNER, seed=0, board: Board | None = None) -> np.ndarray:
    """Render a sheet whose first corner is `first` squares from its edges: sampled, blurred, with noise."""
    _, translation, rotation = corners_in_camera(pose, board or Board(BOARD, SQUARE_M))
    image = seen(TRUTH, rays(), sheet, rotation, translation, SQUARE_M, first)
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
