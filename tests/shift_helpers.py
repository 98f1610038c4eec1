"""Pairs of windows whose displacement is known."""

from __future__ import annotations

import numpy as np
from scipy import ndimage


def scene(height: int = 120, width: int = 140, *, sigma: float = 1.5, seed: int = 0) -> np.ndarray:
    """A smooth random scene in grey levels, mean 110 and standard deviation 25."""
    texture = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal((height, width)), sigma)
    return 110 + 25 * (texture - texture.mean()) / texture.std()


def moved(picture: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """The picture with its content moved by (dx, dy)."""
    return ndimage.shift(picture, (dy, dx), order=5, mode="reflect")


def pair(dx: float, dy: float, *, size: int = 60, noise: float = 0.0, seed: int = 0, sigma: float = 1.5):
    big = scene(size + 80, size + 80, sigma=sigma, seed=seed)
    part = (slice(40, 40 + size),) * 2
    rng = np.random.default_rng(seed + 1000)
    frames = [big[part], moved(big, dx, dy)[part]]
    return tuple((frame + noise * rng.standard_normal(frame.shape)).astype(np.float32) for frame in frames)


def particles(field, size: int, seed: int, *, loss: float = 0.0, density: float = 0.04) -> list[np.ndarray]:
    """Particles that move by `field`, of which a share `loss` is replaced."""
    rng = np.random.default_rng(seed)
    count = round(density * (size + 40) ** 2)
    x, y, light = rng.uniform(-20, size + 20, count), rng.uniform(-20, size + 20, count), rng.uniform(60, 200, count)
    u, v = field(x, y)
    lost = rng.random(count) < loss
    after = [np.where(lost, rng.uniform(-20, size + 20, count), at) for at in (x + u, y + v)]
    frames = []
    for px, py in ((x, y), after):
        canvas = np.full((size, size), 10.0)
        for cx, cy, peak in zip(px, py, light, strict=True):
            left, top = max(round(cx) - 5, 0), max(round(cy) - 5, 0)
            part = canvas[top : round(cy) + 6, left : round(cx) + 6]
            if part.size:
                gy, gx = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
                part += peak * np.exp(-((gx - cx) ** 2 + (gy - cy) ** 2) / 0.8)
        frames.append(np.clip(np.round(canvas + 2 * rng.standard_normal(canvas.shape)), 0, 255).astype(np.uint8))
    return frames
