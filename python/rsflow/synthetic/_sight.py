"""How the camera of `moving_things` moves over flat ground: homographies from the ground to each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError

F64 = NDArray[np.float64]

# Words for the camera, and how fast each moves where that is not said: pixels per frame; the share by which the picture
# grows, or the distance shrinks, per frame; degrees per frame; the deviation in pixels of a hand.
SPEEDS = {
    "static": 0.0, "pan": 2.0, "zoom": 0.01, "turn": 0.5, "hand_held": 3.0, "sideways": 2.0, "forward": 0.005,
}  # fmt: skip
# Cameras that move from place to place, and those that stay: of others, what is near and what is far moves alike.
WITH_DEPTH = ("static", "sideways", "forward")

# Periods, in frames, of the waves that a hand's sway is made of, and degrees that it turns a pixel of its sway.
_WAVES = (9.0, 14.0, 23.0, 37.0, 50.0)
_TURN_DEG = 0.1


@dataclass(frozen=True)
class Sight:
    """A camera that looks straight down on ground whose pixels are those of the first frame."""

    homographies: F64
    centre: F64
    # Of a camera that moves from place to place: where it is, in pixels of the ground, and its distance, at first 1.
    shifts: F64
    distances: F64

    def plane(self, frame: int, height: float) -> F64:
        """Homography from a plane at a height, as a share of the first distance, to a frame."""
        if height == 0.0:
            return np.asarray(self.homographies[frame])
        scale = 1.0 / (self.distances[frame] - height)
        x, y = self.centre - scale * (self.centre + self.shifts[frame])
        return np.array([[scale, 0.0, x], [0.0, scale, y], [0.0, 0.0, 1.0]])

    def below(self, frame: int) -> F64:
        """Point of the ground that is straight below the camera, (2,)."""
        return np.asarray(self.centre + self.shifts[frame])


def sight(
    camera: str, speed: float, heading_deg: float | None, frames: int, size: tuple[int, int], rng: np.random.Generator
) -> Sight:
    """Make the way of a camera; the first frame's homography is the identity."""
    centre = (np.array(size, dtype=np.float64) - 1.0) / 2.0
    drawn = rng.uniform(0.0, 2.0 * np.pi)
    heading = drawn if heading_deg is None else np.deg2rad(heading_deg)
    along = np.array([np.cos(heading), np.sin(heading)])
    shifts, distances = np.zeros((frames, 2)), np.ones(frames)
    turns, zooms, moves = np.zeros(frames), np.ones(frames), np.zeros((frames, 2))
    count = np.arange(frames, dtype=np.float64)
    if camera in ("pan", "sideways"):
        shifts = speed * count[:, None] * along
        moves = -shifts
    elif camera == "zoom":
        with np.errstate(over="ignore"):
            zooms = (1.0 + speed) ** count
    elif camera == "turn":
        turns = speed * count
    elif camera == "forward":
        distances = 1.0 - speed * count
        zooms = 1.0 / np.where(distances > 0.0, distances, np.nan)
    elif camera == "hand_held":
        moves, turns = speed * _sway(rng, count, 2), _TURN_DEG * speed * _sway(rng, count, 1)[:, 0]
    if not (np.isfinite(zooms).all() and 1e-3 <= zooms.min() <= zooms.max() <= 1e3):
        raise OptionError(
            f"camera_speed, frames: got {speed:g} and {frames}, which makes the picture {zooms[-1]:g} times as large, "
            "expected less than 1000 times, and no smaller than a thousandth"
        )
    matrices = [_similarity(centre, move, turn, zoom) for move, turn, zoom in zip(moves, turns, zooms, strict=True)]
    return Sight(np.stack(matrices), centre, shifts, distances)


def _similarity(centre: F64, move: F64, turn_deg: float, zoom: float) -> F64:
    """Turn and zoom about the centre, then move."""
    angle = np.deg2rad(turn_deg)
    cos, sin = zoom * np.cos(angle), zoom * np.sin(angle)
    linear = np.array([[cos, -sin], [sin, cos]])
    out = np.eye(3)
    out[:2, :2], out[:2, 2] = linear, centre + move - linear @ centre
    return out


def _sway(rng: np.random.Generator, count: F64, axes: int) -> F64:
    """Smooth ways (frames, axes) of a deviation of about 1, from 0 in the first frame."""
    out = np.zeros((len(count), axes))
    power = sum(period / _WAVES[-1] for period in _WAVES) / 2.0
    for axis in range(axes):
        for period in _WAVES:
            phase, own = rng.uniform(0.0, 2.0 * np.pi), period * rng.uniform(0.8, 1.2)
            size = np.sqrt(period / _WAVES[-1] / power)
            out[:, axis] += size * (np.sin(2.0 * np.pi * count / own + phase) - np.sin(phase))
    return out


def mapped(homography: F64, points: F64) -> F64:
    """Points (..., 2) through a homography."""
    x, y = points[..., 0], points[..., 1]
    w = homography[2, 0] * x + homography[2, 1] * y + homography[2, 2]
    return np.stack(
        [
            (homography[0, 0] * x + homography[0, 1] * y + homography[0, 2]) / w,
            (homography[1, 0] * x + homography[1, 1] * y + homography[1, 2]) / w,
        ],
        axis=-1,
    )
