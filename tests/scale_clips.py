"""Clips for the checks of scale: a camera turned by hand, and one that travels, with exact truth."""

from __future__ import annotations

import functools

import numpy as np

from rsflow import Camera
from rsflow.synthetic import Flight, flight

LENS = Camera(150.0, 150.0, 80.0, 60.0, width=160, height=120, distortion=(-0.25, 0.12, 0.001, -0.0005, 0.01))
SWAPPED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def waves(seed: int, size: float, axes: tuple[float, ...], *, count: int = 4):
    """Give three functions of time, each a sum of waves of 0.4 to 1.6 Hz, of this root mean square."""
    rng = np.random.default_rng(seed)
    hz, phase = rng.uniform(0.4, 1.6, (count, 3)), rng.uniform(0, 2 * np.pi, (count, 3))
    weight = rng.normal(size=(count, 3))
    weight *= size / np.sqrt((weight**2).sum(axis=0) / 2)

    def at(t_s):
        angle = 2 * np.pi * hz * np.asarray(t_s)[..., None, None] + phase
        return np.asarray(axes) * (weight * np.sin(angle)).sum(axis=-2)

    return at


@functools.cache
def turned(seed: int, *, axes: tuple[float, ...] = (1.0, 1.0, 1.0), readout_s: float = 0.0, frames: int = 60) -> Flight:
    """Render a camera that is turned in place, to and fro about these axes."""
    return flight(
        LENS,
        frames=frames,
        height_m=1.0,
        velocity_m_s=(0.0, 0.0, 0.0),
        rate_rad_s=waves(seed, 0.5, axes),
        readout_s=readout_s,
        seed=seed,
    )


@functools.cache
def steadily_turned(rate: tuple[float, float, float]) -> Flight:
    """Render a camera that turns at a steady rate."""
    return flight(LENS, frames=40, height_m=1.0, velocity_m_s=(0.0, 0.0, 0.0), rate_rad_s=rate, seed=3)
