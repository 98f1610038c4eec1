"""Things that slide over the ground of a flight."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _checks

__all__ = ["MovingObject"]

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class MovingObject:
    """A flat thing that slides over the ground, with a texture of its own.

    Attributes
    ----------
    center_m : (x, y)
        Where it is on the ground at time 0, from the point below the camera; x and y as the camera's.
    size_m : (float, float)
        Its extent along x and y.
    velocity_m_s : (x, y)
        Its velocity over the ground.
    shape : {"ellipse", "rectangle"}
        Its outline.
    level : float
        Its mean grey level.
    seed : int
        Of its texture.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> thing = synthetic.MovingObject((0.01, 0.0), (0.02, 0.01), (0.05, 0.0), shape="rectangle")
    >>> flight = synthetic.flight(frames=3, objects=[thing], seed=1)
    >>> bool((flight.masks == 1).any()), flight.objects == (thing,)
    (True, True)
    """

    center_m: tuple[float, float]
    size_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    shape: str = "ellipse"
    level: float = 150.0
    seed: int = 1_000

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        for name in ("center_m", "size_m", "velocity_m_s"):
            values = _checks.vector(name, getattr(self, name), 2, "two finite numbers, along x and y")
            put(name, tuple(values.tolist()))
        if not 1e-9 <= min(self.size_m) <= max(self.size_m) <= 1e9:
            raise _checks.refused("size_m", self.size_m, "two lengths from 1e-09 to 1e+09 metres")
        _checks.choice("shape", self.shape, ("ellipse", "rectangle"))
        put("level", _checks.number("level", self.level, least=-1e9, most=1e9, of="grey levels"))
        put("seed", _checks.integer("seed", self.seed, least=0))

    def covers(self, x: F64, y: F64, t_s: float) -> NDArray[np.bool_]:
        """Whether the ground at (x, y), in metres, is under the object at time `t_s`."""
        x = _checks.array("x", x, ..., "metres on the ground").astype(np.float64, copy=False)
        y = _checks.array("y", y, ..., "metres on the ground").astype(np.float64, copy=False)
        t_s = _checks.number("t_s", t_s, of="seconds")
        _checks.broadcast("x, y", x, y)
        return covered(self, x, y, np.asarray(t_s))


def covered(thing: MovingObject, x: F64, y: F64, t_s: F64) -> NDArray[np.bool_]:
    """Whether the ground at (x, y) is under the object at times that broadcast with them: `covers`, unchecked."""
    # Far outside it overflows, and is outside.
    with np.errstate(over="ignore", invalid="ignore"):
        a = (x - thing.center_m[0] - thing.velocity_m_s[0] * t_s) / (0.5 * thing.size_m[0])
        b = (y - thing.center_m[1] - thing.velocity_m_s[1] * t_s) / (0.5 * thing.size_m[1])
        if thing.shape == "ellipse":
            return np.asarray(a * a + b * b <= 1.0)
    return np.asarray((np.abs(a) <= 1.0) & (np.abs(b) <= 1.0))
