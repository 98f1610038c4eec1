"""Pairs of frames with several motions in one picture: parts that shift, turn and zoom, with exact truth."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import fields
from ..errors import OptionError, ShapeError
from .lighting import Lighting, lit
from .sensor import Sensor, sensor_or
from .textures import BANDS, CONTRAST_LEVELS, MEAN_LEVEL, Texture

__all__ = ["MotionsPair", "Part", "motions_pair"]


@dataclass(frozen=True)
class Part:
    """A part of the picture with one motion: turn and zoom about (x, y), then shift.

    Attributes
    ----------
    dx, dy : float
        Displacement in pixels of what is at (x, y).
    turn_deg : float
        Rotation in degrees, from x towards y: clockwise as the picture is looked at.
    zoom : float
        Factor on distances from (x, y).
    x, y : float
        Centre of turn and zoom, in pixels of `prev`.
    box : (float, float, float, float) or None
        x, y, width and height of the part in `prev`; None covers the plane.
    kind : str
        Texture, see `BANDS`.

    Examples
    --------
    >>> from rsflow.synthetic import Part
    >>> Part(dx=2.0, zoom=1.5, x=10.0, y=10.0).move([[14.0, 10.0]])
    array([[18., 10.]])
    """

    dx: float = 0.0
    dy: float = 0.0
    turn_deg: float = 0.0
    zoom: float = 1.0
    x: float = 0.0
    y: float = 0.0
    box: tuple[float, float, float, float] | None = None
    kind: str = "fine"

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        for name in ("dx", "dy", "turn_deg", "x", "y"):
            put(name, _checks.number(name, getattr(self, name), least=-1e9, most=1e9))
        put("zoom", _checks.number("zoom", self.zoom, least=1e-6, most=1e6))
        if self.box is not None:
            expected = "(x, y, width, height), finite numbers, or None"
            put("box", tuple(_checks.vector("box", self.box, 4, expected).tolist()))
        _checks.choice("kind", self.kind, BANDS)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Turn and zoom, shape (2, 2)."""
        angle = np.deg2rad(self.turn_deg)
        cos, sin = self.zoom * np.cos(angle), self.zoom * np.sin(angle)
        return np.array([[cos, -sin], [sin, cos]])

    def move(self, points: ArrayLike) -> NDArray[np.float64]:
        """Where points of the part go, shape (..., 2).

        Parameters
        ----------
        points : array_like, (..., 2)
            Pixels (x, y).

        Returns
        -------
        (..., 2) float64

        Examples
        --------
        >>> Part(dx=1, turn_deg=90, x=10, y=10).move([[12, 10]]).round(6) + 0
        array([[11., 12.]])
        """
        centre = np.array([self.x, self.y])
        # What is infinite has no place.
        with np.errstate(invalid="ignore"):
            moved = (_places(points) - centre) @ self.matrix.T + centre + np.array([self.dx, self.dy])
        return np.asarray(moved, np.float64)

    def trace(self, points: ArrayLike) -> NDArray[np.float64]:
        """Where points of the part came from, shape (..., 2): the inverse of `move`.

        Parameters
        ----------
        points : array_like, (..., 2)
            Pixels (x, y).

        Returns
        -------
        (..., 2) float64
        """
        centre = np.array([self.x, self.y])
        offset = _places(points) - centre - np.array([self.dx, self.dy])
        with np.errstate(invalid="ignore"):
            return np.asarray(offset @ np.linalg.inv(self.matrix).T + centre, np.float64)

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points of `prev` the part covers, shape (...,)."""
        points = _places(points)
        if self.box is None:
            return np.ones(points.shape[:-1], dtype=np.bool_)
        left, top, width, height = self.box
        x, y = points[..., 0], points[..., 1]
        return np.asarray((x >= left) & (x < left + width) & (y >= top) & (y < top + height))


@dataclass(frozen=True, eq=False)
class MotionsPair:
    """Two frames of a scene whose parts move each in its own way.

    Attributes
    ----------
    prev, next : (height, width) of the sensor's dtype
        The frames.
    parts : tuple of Part
        The later ones lie over the earlier ones.
    part_prev, part_next : (height, width) int64
        Which part is seen at each pixel.

    Examples
    --------
    >>> from rsflow.synthetic import Part, motions_pair
    >>> pair = motions_pair([Part(dx=3.0), Part(dy=-2.0, box=(20, 20, 30, 30))], size=(96, 64), seed=1)
    >>> pair.truth([[5.0, 5.0], [30.0, 30.0]])
    array([[ 8.,  5.],
           [30., 28.]])
    """

    prev: NDArray[Any]
    next: NDArray[Any]
    parts: tuple[Part, ...]
    part_prev: NDArray[np.int64]
    part_next: NDArray[np.int64]

    __repr__ = fields

    def truth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Where points (N, 2) of `prev` are in `next`, inside of the frame or not, hidden or not."""
        points = _checks.coordinates("points", points).astype(np.float64)
        part = _at(self.part_prev, points)
        moved = np.full(points.shape, np.nan)
        for index, each in enumerate(self.parts):
            moved[part == index] = each.move(points[part == index])
        return moved

    def clear(self, points: ArrayLike, *, radius: int) -> NDArray[np.bool_]:
        """Which points see one part only within `radius` pixels, in both frames, and stay that far inside."""
        points = _checks.coordinates("points", points).astype(np.float64)
        radius = _checks.integer("radius", radius, least=0, most=1_000, of="pixels")
        moved = self.truth(points)
        part = _at(self.part_prev, points)
        side = np.arange(-radius, radius + 1)
        x, y = (axis.ravel() for axis in np.meshgrid(side, side))
        rim = np.maximum(np.abs(x), np.abs(y)) == radius
        clear = part >= 0
        for offset in np.stack([x[rim], y[rim]], axis=1):
            for labels, where in ((self.part_prev, points), (self.part_next, moved)):
                clear &= _at(labels, where + offset) == part
        return clear


def motions_pair(
    parts: Sequence[Part],
    *,
    size: tuple[int, int] = (640, 480),
    lighting: Lighting | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> MotionsPair:
    """Two frames with several motions; what one part uncovers shows those under it.

    Parameters
    ----------
    parts : sequence of Part
        The later ones lie over the earlier ones; the first should cover the plane. Each has a texture of its own.
    size : (int, int)
        Width and height in pixels; textures repeat after 1024.
    lighting : Lighting, optional
        What happens to the light of `next`.
    sensor : Sensor, optional
        Noise and dtype of both frames; by default noise of one grey level, uint8.
    seed : int
        Of textures and noise.

    Returns
    -------
    MotionsPair

    Examples
    --------
    >>> pair = motions_pair([Part(dx=3), Part(turn_deg=20, x=50, y=40, box=(30, 20, 40, 40))], size=(100, 80))
    >>> pair.truth([[10, 10], [50, 40]])
    array([[13., 10.],
           [50., 40.]])
    """
    parts = list(_checks.iterable("parts", parts, "Parts, the first of which covers the plane (box=None)"))
    for part in parts:
        _checks.instance("parts", part, Part, "Parts")
    if not parts or parts[0].box is not None:
        first = f"a first one with {parts[0].box}" if parts else "none"
        raise OptionError(f"parts: got {first}, expected a first part that covers the plane (box=None)")
    width, height = _checks.size("size", size, most=10_000)
    seed = _checks.integer("seed", seed, least=0, most=2**48)
    sensor = sensor_or(Sensor(), sensor)
    lighting = None if lighting is None else _checks.function("lighting", lighting, 1)
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.stack([x, y], axis=-1)
    images = [np.zeros((height, width)) for _ in range(2)]
    labels = [np.full((height, width), -1, dtype=np.int64) for _ in range(2)]
    for index, part in enumerate(parts):
        texture = Texture.make(part.kind, seed=1000 * seed + index)
        for image, label, place in zip(images, labels, (pixels, part.trace(pixels)), strict=True):
            inside = part.covers(place)
            image[inside] = MEAN_LEVEL + CONTRAST_LEVELS * texture.sample(place[inside, 0], place[inside, 1])
            label[inside] = index
    images[1] = lit("lighting", lighting, images[1])
    rng = np.random.default_rng([seed, 130_363])
    prev, after = (sensor.expose(image, rng) for image in images)
    return MotionsPair(prev, after, tuple(parts), labels[0], labels[1])


def _places(points: ArrayLike) -> NDArray[np.float64]:
    found = _checks.array("points", points, ..., "numbers, (..., 2), x and y of each point")
    if found.ndim == 0 or found.shape[-1] != 2:
        raise ShapeError(f"points: got shape {found.shape}, expected (..., 2), x and y of each point")
    return found.astype(np.float64)


def _at(labels: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Look up the label of the pixel that each point is in; -1 outside."""
    height, width = labels.shape
    whole = np.round(np.nan_to_num(points, nan=-1.0).clip(-1.0, max(width, height))).astype(np.int64)
    inside = ((whole >= 0) & (whole < (width, height))).all(axis=-1)
    found = np.full(points.shape[:-1], -1, dtype=np.int64)
    found[inside] = labels[whole[inside, 1], whole[inside, 0]]
    return found
