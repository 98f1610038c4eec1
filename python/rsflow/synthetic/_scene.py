"""The ground and what moves on it, as a camera sees it along its path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ._geometry import Optics
from ._path import Path
from .ground_effects import GroundEffect
from .moving_object import MovingObject, covered
from .textures import CONTRAST_LEVELS, MEAN_LEVEL, Texture

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """The ground and what moves on it, seen along a path, row after row where the shutter rolls."""

    optics: Optics
    path: Path
    ground: Texture
    scale_m: float
    contrast_levels: float
    objects: Sequence[MovingObject]
    kind: str
    effects: Sequence[GroundEffect]
    readout_s: float

    @cached_property
    def textures(self) -> list[Texture]:
        """Of the objects."""
        return [Texture.make(self.kind, seed=thing.seed, period=256) for thing in self.objects]

    def exposed(self, t_s: float, exposure_s: float, margin: int) -> F64:
        """Render the picture without noise, averaged over the exposure, with `margin` more pixels on each side."""
        if exposure_s == 0.0:
            return self.instant(t_s, margin)
        # Half a pixel between instants: the sum then differs from the integral by less than the rounding to uint8.
        way_px = self.optics.longest_way(self.path, t_s - exposure_s / 2, t_s + exposure_s / 2)
        count = int(np.clip(np.ceil(2.0 * way_px), 2, 64))
        moments = t_s + exposure_s * ((np.arange(count) + 0.5) / count - 0.5)
        return np.asarray(sum(self.instant(float(t), margin) for t in moments) / count)

    def seen(self, t_s: float, margin: int) -> tuple[F64, F64, F64]:
        """Where the pixels meet the ground, in metres, and when: a time, or one a row, (rows, 1)."""
        t = np.asarray(t_s, dtype=np.float64)
        if self.readout_s:
            t = (
                t
                + row_delay(np.arange(-margin, self.optics.height + margin), self.optics.height, self.readout_s)[
                    :, None
                ]
            )
        return (*self.optics.ground(*self.path.at(t), margin=margin), t)

    def instant(self, t_s: float, margin: int) -> F64:
        """Render what is seen at a time, without exposure and noise."""
        x, y, t = self.seen(t_s, margin)
        seen = np.isfinite(x) & np.isfinite(y)
        image = self.ground.sample(np.where(np.isfinite(x), x, 0.0) / self.scale_m,
                                   np.where(np.isfinite(y), y, 0.0) / self.scale_m)  # fmt: skip
        image = np.where(seen, MEAN_LEVEL + self.contrast_levels * image, MEAN_LEVEL)
        wide_x, wide_y, moments = np.broadcast_arrays(x, y, t)
        for thing, own in zip(self.objects, self.textures, strict=True):
            inside = covered(thing, x, y, t)
            if inside.any():
                dx = wide_x[inside] - thing.velocity_m_s[0] * moments[inside]
                dy = wide_y[inside] - thing.velocity_m_s[1] * moments[inside]
                image[inside] = thing.level + CONTRAST_LEVELS * own.sample(dx / self.scale_m, dy / self.scale_m)
        for effect in self.effects:
            changed = np.asarray(effect(image[seen], wide_x[seen], wide_y[seen], moments[seen]), dtype=np.float64)
            if changed.shape != image[seen].shape or not np.isfinite(changed).all():
                raise _checks.refused("ground_effects", changed, "functions that give one finite grey level a point")
            image[seen] = changed
        return image

    def mask(self, t_s: float) -> NDArray[np.uint8]:
        """Where the objects are seen: their number, from 1; 0 on the ground."""
        mask = np.zeros((self.optics.height, self.optics.width), dtype=np.uint8)
        if self.objects:
            x, y, t = self.seen(t_s, 0)
            for number, thing in enumerate(self.objects, 1):
                mask[covered(thing, x, y, t)] = number
        return mask


def row_delay(row: NDArray[Any], height: int, readout_s: float) -> F64:
    """How much later than the frame's time a row is exposed; rows between pixels, and outside of the picture, too."""
    return np.asarray(readout_s * (row - (height - 1) / 2) / max(height - 1, 1), dtype=np.float64)
