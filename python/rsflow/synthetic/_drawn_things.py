"""Things drawn at random for `moving_things`: of many looks, in view all through the clip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ._outlines import SHAPES, SQUARE
from ._sight import Sight, mapped
from .textures import MEAN_LEVEL
from .thing import THING_LEVELS, Thing

F64 = NDArray[np.float64]

# Pixels per frame where nothing is said, and the size of things as a share of the picture's width.
_SPEEDS = (1.0, 4.0)
_SIZES = (0.1, 0.2)
# Grey levels between a plain thing and the ground's mean, and between a textured one and it.
_PLAIN_LEVELS, _TEXTURED_LEVELS = (50.0, 90.0), (25.0, 60.0)


@dataclass(frozen=True)
class Wishes:
    """What drawn things have in common."""

    speed_px: float | None
    textured: bool | None
    shape: str | None
    stop_frames: int
    crossing: bool


def drawn(count: int, wishes: Wishes, sight: Sight, size: tuple[int, int], rng: np.random.Generator) -> list[Thing]:
    """Draw so many things that are there at once; one that leaves the picture comes in anew on the other side."""
    out: list[Thing] = []
    for index in range(count):
        place = np.array(
            [((index + rng.uniform(0.25, 0.75)) / count * 0.8 + 0.1) * size[0], rng.uniform(0.2, 0.8) * size[1]]
        )
        thing = _one(wishes, place, sight, size, rng)
        out += [thing] if wishes.crossing else _going_on(thing, sight, size)
    return out


def _one(wishes: Wishes, place: F64, sight: Sight, size: tuple[int, int], rng: np.random.Generator) -> Thing:
    frames = len(sight.homographies)
    shape = str(rng.choice(SHAPES)) if wishes.shape is None else wishes.shape
    length = size[0] * rng.uniform(*_SIZES)
    height = 1.6 * length if shape == "walker" else length * rng.uniform(0.4, 0.9)
    width = 0.5 * height if shape == "walker" else length
    speed = float(rng.uniform(*_SPEEDS)) if wishes.speed_px is None else wishes.speed_px
    way = rng.uniform(0.0, 2.0 * np.pi)
    if shape in ("car", "walker"):
        # Along the picture's rows, more or less.
        way = rng.choice([0.0, np.pi]) + rng.normal(0.0, 0.1)
    velocity = speed * np.array([np.cos(way), np.sin(way)])
    textured = bool(rng.random() < 0.6) if wishes.textured is None else wishes.textured
    away = rng.uniform(*(_TEXTURED_LEVELS if textured else _PLAIN_LEVELS)) * rng.choice([-1.0, 1.0])
    if wishes.crossing:
        middle = np.array(size) * rng.uniform(0.45, 0.55, 2)
        half = frames // 2
        # Not from farther away than the picture's edge.
        longest = 0.45 * min(size) / max(half, 1)
        velocity *= min(1.0, longest / max(speed, 1e-9))
        start = _ground(sight, half, middle) - half * velocity
    else:
        start = _ground(sight, 0, place)
    at = int(rng.integers(frames // 4, frames // 2 + 1))
    return Thing(
        x=float(start[0]),
        y=float(start[1]),
        dx=float(velocity[0]),
        dy=float(velocity[1]),
        width=float(width),
        height=float(height),
        shape=shape,
        level=float(MEAN_LEVEL + away),
        contrast_levels=THING_LEVELS if textured else 0.0,
        turn_deg=0.0 if shape in ("car", "walker") else float(rng.normal(0.0, 0.5)),
        stops=((at, at + wishes.stop_frames),) if wishes.stop_frames else (),
        seed=int(rng.integers(1_000, 1_000_000)),
    )


def _ground(sight: Sight, frame: int, place: F64) -> F64:
    return mapped(np.linalg.inv(sight.homographies[frame]), place)


def _going_on(thing: Thing, sight: Sight, size: tuple[int, int]) -> list[Thing]:
    """Give the thing until it has left the picture, then another like it that comes in on the other side, and so on."""
    out, current, sides = [], thing, np.array(size, dtype=np.float64) - 1.0
    for frame, homography in enumerate(sight.homographies):
        corners = mapped(homography @ current.pose(frame), SQUARE)
        low, high = corners.min(axis=0) - 1.0, corners.max(axis=0) + 1.0
        out_of = np.where(high < 0.0, 1.0, np.where(low > sides, -1.0, 0.0))
        if out_of.any():
            place = mapped(homography, current.position(frame))
            entry = _ground(sight, frame, place + out_of * (sides + high - low))
            out.append(replace(current, last_frame=max(frame - 1, 0)))
            current = replace(current, x=float(entry[0]), y=float(entry[1]), first_frame=frame)
    return [*out, current]
