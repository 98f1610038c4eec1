"""Overlays that are fixed to the sensor, and the masks that leave them out."""

from __future__ import annotations

import numpy as np

SHAPE = (144, 176)


def overlay_mask(kind: str, share: float, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """False where an overlay of this kind covers about this share of the picture."""
    height, width = shape
    keep = np.ones(shape, bool)
    if kind == "below":
        keep[height - round(height * share) :] = False
    elif kind == "middle":
        down, across = (round(side * (1 - share**0.5) / 2) for side in shape)
        keep[down:-down, across:-across] = False
    elif kind == "around":
        inside = (1 - share) ** 0.5
        down, across = (round(side * (1 - inside) / 2) for side in shape)
        keep[:] = False
        keep[down:-down, across:-across] = True
    else:
        rng = np.random.default_rng(4)
        while keep.mean() > 1 - share:
            y, x = rng.integers(0, height - 8), rng.integers(0, width - 16)
            keep[y : y + 8, x : x + 16] = False
    return keep


def overlay(shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """What stands before the scene and does not move: a texture with sharp edges."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.where((x // 5 + y // 7 + (x * y) // 90) % 2, 235, 20).astype(np.uint8)
