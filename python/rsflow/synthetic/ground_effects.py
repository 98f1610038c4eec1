"""What changes the look of the ground with place and time: shadows that move over it, water."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .. import _checks

__all__ = ["GroundEffect", "moving_shadow", "water"]

F64 = NDArray[np.float64]

# Grey levels of 0..255 seen at places (x, y) of the ground, in metres, at times in seconds, all (N,) -> grey levels.
GroundEffect = Callable[[F64, F64, F64, F64], F64]


def moving_shadow(
    factor: float,
    *,
    width_m: float = 0.05,
    gap_m: float = 0.1,
    velocity_m_s: tuple[float, float] = (0.1, 0.0),
    edge_m: float = 0.002,
) -> GroundEffect:
    """Multiply by `factor` in stripes of shadow that slide over the ground, square to the way that they go.

    With velocity 0 they lie on the ground as those of trees do, along y. A shadow that goes with the camera is a
    `lighting`, such as `rsflow.synthetic.shadow`.

    Parameters
    ----------
    factor : float
        Gain in the shadow.
    width_m, gap_m : float
        Width of a stripe, and of the light between two.
    velocity_m_s : (x, y)
        Of the shadows over the ground, in the world's axes.
    edge_m : float
        Width over which light becomes shadow.

    Returns
    -------
    GroundEffect

    Examples
    --------
    >>> import numpy as np
    >>> shade = moving_shadow(0.5, width_m=0.1, gap_m=0.1, velocity_m_s=(1.0, 0.0))
    >>> x, y = np.array([0.05, 0.15]), np.zeros(2)
    >>> shade(np.full(2, 100.0), x, y, np.zeros(2)).round(3).tolist()
    [50.0, 100.0]
    >>> shade(np.full(2, 100.0), x, y, np.full(2, 0.1)).round(3).tolist()
    [100.0, 50.0]
    """
    factor = _checks.number("factor", factor)
    lengths = ("width_m", width_m), ("gap_m", gap_m), ("edge_m", edge_m)
    width, gap, edge = (_checks.number(name, value, least=1e-9, most=1e9, of="metres") for name, value in lengths)
    velocity = _checks.vector("velocity_m_s", velocity_m_s, 2, "two finite numbers, along x and y")
    speed = float(np.hypot(*velocity))
    along = velocity / speed if speed else np.array([1.0, 0.0])

    def apply(levels: F64, x: F64, y: F64, t_s: F64) -> F64:
        place = np.mod(along[0] * x + along[1] * y - speed * t_s, width + gap)
        # How deep inside the stripe, in widths of its edge; the light comes back over the same width.
        depth = (width / 2 - np.abs(place - width / 2)) / edge
        share = np.clip(depth + 0.5, 0.0, 1.0)
        return np.asarray(levels * (1.0 + (factor - 1.0) * share), dtype=np.float64)

    return apply


def water(
    *,
    ripple: float = 0.1,
    glint_levels: float = 80.0,
    wavelength_m: float = 0.05,
    speed_m_s: float = 0.3,
    seed: int = 0,
) -> GroundEffect:
    """Lay shallow water over the ground: waves that brighten and darken it, and highlights that move with them.

    Five trains of waves run in different directions. What is seen of the ground stays in its place; over deep water
    that hides the ground (`contrast_levels=0`) nothing shows the camera's motion.

    Parameters
    ----------
    ripple : float
        Standard deviation of the waves' gain.
    glint_levels : float
        Brightness of the highlights, which stand where the waves add up.
    wavelength_m : float
        Mean length of the waves.
    speed_m_s : float
        Mean speed at which they run.
    seed : int
        Of their directions, lengths and phases.

    Returns
    -------
    GroundEffect

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow import synthetic
    >>> f = synthetic.flight(frames=2, velocity_m_s=(0, 0, 0), ground_effects=[water(seed=1)])
    >>> bool(np.abs(f.images[1].astype(float) - f.images[0]).mean() > 5)  # although the camera stands still
    True
    """
    ripple = _checks.number("ripple", ripple, least=0, most=1e6)
    glint_levels = _checks.number("glint_levels", glint_levels, of="grey levels")
    wavelength_m = _checks.number("wavelength_m", wavelength_m, least=1e-9, most=1e9, of="metres")
    speed_m_s = _checks.number("speed_m_s", speed_m_s, least=0, most=1e6, of="metres per second")
    rng = np.random.default_rng([_checks.integer("seed", seed, least=0), 32_452_843])
    count = 5
    turn = 2 * np.pi * (np.arange(count) / count + rng.uniform(-0.08, 0.08, count))
    number = 2 * np.pi / (wavelength_m * rng.uniform(0.6, 1.6, count))
    speed = speed_m_s * rng.uniform(0.7, 1.3, count)
    phase = rng.uniform(0.0, 2 * np.pi, count)

    def apply(levels: F64, x: F64, y: F64, t_s: F64) -> F64:
        height = np.zeros_like(levels)
        for k in range(count):
            along = np.cos(turn[k]) * x + np.sin(turn[k]) * y
            height += np.sin(number[k] * (along - speed[k] * t_s) + phase[k])
        # Of deviation 1; above two deviations they throw the light into the camera.
        height *= np.sqrt(2.0 / count)
        glint = glint_levels * np.clip(2.0 * (height - 1.5), 0.0, 1.0)
        return np.asarray(levels * (1.0 + ripple * height) + glint, dtype=np.float64)

    return apply
