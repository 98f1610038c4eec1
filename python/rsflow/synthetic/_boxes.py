"""Boxes that stand on the ground of `moving_things`: their parallax is not motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._composite import Layer
from ._outlines import SQUARE
from ._sight import Sight, mapped
from .textures import CONTRAST_LEVELS, MEAN_LEVEL, Texture

F64 = NDArray[np.float64]

# Half a box's side, as a share of the picture's width; where there are many, the smaller ones.
_HALF = (0.06, 0.1)
_MANY, _HALF_OF_MANY = 5, (0.04, 0.065)
# Levels of the sides beside the mean of the top: they lie in the shade, each in its own.
_SHADE = (-45.0, -30.0, -15.0, -35.0)
_PERIOD = 128


@dataclass(frozen=True)
class Box:
    """A box: its middle and half its sides on the ground in pixels of the first frame, its height, its texture."""

    middle: F64
    half: F64
    height: float
    level: float
    skin: Texture


def drawn_boxes(count: int, height: float, sight: Sight, size: tuple[int, int], rng: np.random.Generator) -> list[Box]:
    """Draw boxes that do not overlap where there is room, each in view in a frame: the first half-way through."""
    out: list[Box] = []
    frames = len(sight.homographies)
    for index in range(count):
        for _ in range(200):
            half = size[0] * rng.uniform(*(_HALF_OF_MANY if count >= _MANY else _HALF)) * rng.uniform(0.8, 1.0, 2)
            frame = int(rng.integers(frames)) if index else frames // 2
            seen = rng.uniform(0.15, 0.85, 2) * np.array(size)
            middle = mapped(np.linalg.inv(sight.homographies[frame]), seen)
            if all((np.abs(middle - box.middle) > half + box.half).any() for box in out):
                break
        skin = Texture.make("fine", seed=int(rng.integers(1_000, 1_000_000)), period=_PERIOD)
        out.append(Box(middle, half, height, MEAN_LEVEL + float(rng.uniform(-40.0, 40.0)), skin))
    return out


def box_layers(boxes: Sequence[Box], sight: Sight, frame: int) -> list[Layer]:
    """Sides and tops of boxes, those farthest from the point below the camera first: the others lean over them."""
    below = sight.below(frame)
    out: list[Layer] = []
    for box in sorted(boxes, key=lambda box: -float(np.hypot(*(box.middle - below)))):
        pose = np.eye(3)
        pose[:2, :2], pose[:2, 2] = np.diag(box.half), box.middle
        base, top = (sight.plane(frame, height) @ pose for height in (0.0, box.height))
        low, high = mapped(base, SQUARE), mapped(top, SQUARE)
        for side in range(4):
            after = (side + 1) % 4
            quad = np.array([low[side], low[after], high[after], high[side]])
            layer = _face(box, _from_square(quad), quad, box.level + _SHADE[side])
            if layer is not None:
                out.append(layer)
        roof = _face(box, top, high, box.level)
        if roof is not None:
            out.append(roof)
    return out


def _face(box: Box, to_picture: F64, quad: F64, level: float) -> Layer | None:
    """Make a layer of a square -1..1 on its plane; None where it is seen from its edge."""
    edge, other = quad[1] - quad[0], quad[2] - quad[0]
    if abs(edge[0] * other[1] - edge[1] * other[0]) < 1e-6:
        return None

    def levels(x: F64, y: F64) -> F64:
        return np.asarray(level + 0.6 * CONTRAST_LEVELS * box.skin.sample(x * box.half[0], y * box.half[1]))

    to_plane = np.asarray(np.linalg.inv(to_picture), dtype=np.float64)
    return Layer(to_plane, quad, lambda x, y: (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0), levels)


def _from_square(quad: F64) -> F64:
    """Homography that takes the corners of the square -1..1 to those of a quadrilateral."""
    rows, right = [], []
    for (x, y), (u, v) in zip(SQUARE, quad, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        right += [u, v]
    solved, *_ = np.linalg.lstsq(np.array(rows, dtype=np.float64), np.array(right), rcond=None)
    return np.append(solved, 1.0).reshape(3, 3)
