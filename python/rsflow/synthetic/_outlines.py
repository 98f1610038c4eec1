"""Outlines of things, as functions that say which points are inside: the box of a thing is -1..1 along both axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]
Inside = Callable[[F64, F64], Mask]

# Corners of the box.
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
SHAPES = ("ellipse", "rectangle", "car", "walker")

# A walker's arms and legs swing by so much, in radians, once in so many of its half heights of way.
_SWING_RAD, _STRIDE = 0.5, 1.4


@dataclass(frozen=True)
class Outline:
    """A part of a thing. `glass`: it shows a level like the ground's in place of the thing's own."""

    inside: Inside
    glass: bool = False


def outlines(shape: str, way: float, *, mirrored: bool) -> list[Outline]:
    """Give the parts of a thing that has gone `way`, in its half heights; later parts lie on earlier ones."""
    if shape == "ellipse":
        return [Outline(_ellipse(0.0, 0.0, 1.0, 1.0))]
    if shape == "rectangle":
        return [Outline(lambda x, y: (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0))]
    if shape == "walker":
        return [Outline(inside) for inside in _walker(way)]
    sign = -1.0 if mirrored else 1.0
    return [
        Outline(_polygon([(-0.7, -0.1), (-0.5, -1.0), (0.3, -1.0), (0.62, -0.1)], sign)),
        Outline(_polygon([(-1.0, 0.0), (-0.9, -0.15), (0.95, -0.15), (1.0, 0.2), (1.0, 0.75), (-1.0, 0.75)], sign)),
        Outline(_polygon([(-0.58, -0.2), (-0.44, -0.85), (0.25, -0.85), (0.48, -0.2)], sign), glass=True),
        *(Outline(_ellipse(0.6 * side, 0.7, 0.17, 0.3)) for side in (-1.0, 1.0)),
    ]


def _ellipse(x0: float, y0: float, a: float, b: float) -> Inside:
    return lambda x, y: ((x - x0) / a) ** 2 + ((y - y0) / b) ** 2 <= 1.0


def _polygon(corners: Sequence[tuple[float, float]], sign: float) -> Inside:
    """Points inside of a polygon, by the number of its sides to the right of them."""
    points = [(sign * x, y) for x, y in corners]

    def inside(x: F64, y: F64) -> Mask:
        within = np.zeros(np.broadcast_shapes(x.shape, y.shape), dtype=np.bool_)
        for (x0, y0), (x1, y1) in zip(points, [*points[1:], points[0]], strict=True):
            if y0 != y1:
                within ^= ((y0 > y) != (y1 > y)) & (x < x0 + (x1 - x0) * (y - y0) / (y1 - y0))
        return within

    return inside


def _capsule(start: tuple[float, float], angle: float, length: float, radius: float) -> Inside:
    """Points within `radius` of a line that hangs from its start, turned by an angle."""
    dx, dy = np.sin(angle), np.cos(angle)

    def inside(x: F64, y: F64) -> Mask:
        along = np.clip((x - start[0]) * dx + (y - start[1]) * dy, 0.0, length)
        return np.asarray(np.hypot(x - start[0] - along * dx, y - start[1] - along * dy) <= radius)

    return inside


def _walker(way: float) -> list[Inside]:
    """Give the parts of a figure from the side, twice as high as wide before its box stretches it."""
    swing = _SWING_RAD * np.sin(2.0 * np.pi * way / _STRIDE)
    parts = [
        _capsule((0.0, -0.52), -swing, 0.5, 0.07),
        _capsule((0.0, 0.05), -swing, 0.85, 0.1),
        _capsule((0.0, 0.05), swing, 0.85, 0.1),
        _capsule((0.0, -0.5), 0.0, 0.5, 0.2),
        _capsule((0.0, -0.52), swing, 0.5, 0.07),
        _ellipse(0.0, -0.83, 0.14, 0.17),
    ]
    return [lambda x, y, part=part: part(0.5 * x, y) for part in parts]  # type: ignore[misc]
