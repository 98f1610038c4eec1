"""Flat layers over one another, with exact shares of each pixel: nine samples a pixel say which layer is seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._outlines import Inside
from ._sight import mapped

F64 = NDArray[np.float64]

# Samples a pixel and axis.
SAMPLES = 3


@dataclass(frozen=True)
class Layer:
    """A part of a plane: where it is seen, what it shows, and of which thing it is part (0: of none)."""

    to_plane: F64
    # Corners (N, 2) in the picture of what encloses it.
    around: F64
    inside: Inside
    levels: Callable[[F64, F64], F64]
    thing: int = 0

    def window(self, shape: tuple[int, int], margin: int) -> tuple[slice, slice] | None:
        """Rows and columns of the picture with its margin that it may touch."""
        low = np.floor(self.around.min(axis=0)).astype(np.int64) + margin
        high = np.ceil(self.around.max(axis=0)).astype(np.int64) + margin + 1
        x0, x1 = np.clip([low[0], high[0]], 0, shape[1])
        y0, y1 = np.clip([low[1], high[1]], 0, shape[0])
        return (slice(int(y0), int(y1)), slice(int(x0), int(x1))) if x0 < x1 and y0 < y1 else None

    def plane(self, window: tuple[slice, slice], margin: int, samples: int) -> tuple[F64, F64]:
        """Coordinates on the plane of a window's pixels, or of `samples` a pixel and axis."""
        axes = []
        for part in (window[1], window[0]):
            place = np.arange(part.start * samples, part.stop * samples, dtype=np.float64)
            axes.append((place + 0.5) / samples - 0.5 - margin)
        x, y = np.meshgrid(*axes)
        points = mapped(self.to_plane, np.stack([x, y], axis=-1))
        return points[..., 0], points[..., 1]


def shares(layer: Layer, window: tuple[slice, slice], margin: int) -> F64:
    """Share of each pixel of a window that a layer covers where nothing hides it."""
    return _blocks(layer.inside(*layer.plane(window, margin, SAMPLES)))


def composed(ground: F64, layers: Sequence[Layer], margin: int) -> tuple[F64, NDArray[np.int32], dict[int, float]]:
    """Picture of the layers over the ground, later ones on top, labels of things, and the area of each that is seen.

    The ground and the picture are larger by the margin on each side; labels and areas are of the picture without it.
    """
    height, width = shape = (ground.shape[0], ground.shape[1])
    owner = np.zeros((height * SAMPLES, width * SAMPLES), dtype=np.int32)
    windows = [layer.window(shape, margin) for layer in layers]
    for number, (layer, window) in enumerate(zip(layers, windows, strict=True), 1):
        if window is not None:
            owner[_finer(window)][layer.inside(*layer.plane(window, margin, SAMPLES))] = number
    image = ground.copy()
    covered: dict[int, F64] = {}
    for number, (layer, window) in enumerate(zip(layers, windows, strict=True), 1):
        if window is None:
            continue
        share = _blocks(owner[_finer(window)] == number)
        if share.any():
            image[window] += share * (layer.levels(*layer.plane(window, margin, 1)) - ground[window])
            if layer.thing:
                covered.setdefault(layer.thing, np.zeros(shape))[window] += share
    inner = (slice(margin, height - margin), slice(margin, width - margin))
    labels, best, total = (np.zeros((height - 2 * margin, width - 2 * margin)) for _ in range(3))
    areas = {}
    for thing, share in sorted(covered.items()):
        own = share[inner]
        areas[thing] = float(own.sum())
        labels[own > best] = thing
        best = np.maximum(best, own)
        total += own
    labels[total <= 0.5] = 0
    return image, labels.astype(np.int32), areas


def _finer(window: tuple[slice, slice]) -> tuple[slice, slice]:
    rows, columns = (slice(part.start * SAMPLES, part.stop * SAMPLES) for part in window)
    return rows, columns


def _blocks(inside: NDArray[np.bool_]) -> F64:
    rows, columns = inside.shape[0] // SAMPLES, inside.shape[1] // SAMPLES
    counted = inside.reshape(rows, SAMPLES, columns, SAMPLES).sum(axis=(1, 3))
    return np.asarray(counted / SAMPLES**2, dtype=np.float64)
