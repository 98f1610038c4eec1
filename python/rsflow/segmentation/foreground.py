"""What differs from the background: the outline of what moves, for a while also when it pauses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from . import evidence, regions
from .photometric import relit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    Mask = NDArray[np.bool_]

# A difference from the background of this many mean squares (see `mismatch`) is one; a weaker one only beside it.
_STRONG = 20.0
_WEAK = 8.0
# What differs less shows the background.
_SAME = 2.5
# Ground without texture: the mean squared gradient over this window is below so many times the noise's variance.
_PLAIN_WINDOW = 7
_PLAIN = 10.0
# For how many frames after it moved a thing that differs from the background, and has a rim, is still moving; and what
# differs in its light alone.
_MEMORY_FRAMES = 100
_LIGHT_FRAMES = 20
# A thing has a rim: so many times stronger in the frame than in the background where it stands, the other way round
# where it left.
_RIM = 1.5
# Share of a frame in the usual variance of a pixel's difference: it remembers twenty frames.
_LEARNING_RATE = 0.05


class Outline:
    """With a static camera: regions that differ from the background and move, or moved lately."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._heat: NDArray[np.uint8] = np.zeros(shape, np.uint8)
        self.variance: F32 | None = None

    def update(self, current: F32, background: F32, found: evidence.FlowEvidence, kept: Mask, rounding: float) -> Mask:
        """Take a frame with its background, NaN where that is not known, and what flow and pictures say."""
        known = np.isfinite(background)
        if not known.any():
            return found.moving
        still = known & ~kept & ~regions.dilated(found.moving, 5)
        filled = relit(np.where(known, background, current), current, still, found.spread)
        usual = found.spread**2 if self.variance is None else np.maximum(self.variance, np.float32(rounding**2))
        differs, apart = difference(current, filled, known, found, usual)
        surely = differs & (apart > _STRONG)
        self._heat = np.where(self._heat > 0, self._heat - 1, 0).astype(np.uint8)
        warm = regions.dilated(self._heat > 0, 3)
        # What changed from frame to frame moved, also where it was too fast for its flow.
        moves = found.moving | found.changed
        mask = regions.grown(differs, surely & (moves | warm)) | (found.moving & ~known)
        moved = regions.grown(mask, mask & moves)
        self._heat[moved] = _MEMORY_FRAMES
        there, left = rims(mask & ~moved, filled, found.slope)
        left |= mask & ~moved & ~there & (self._heat < _MEMORY_FRAMES - _LIGHT_FRAMES)
        self._heat[left] = 0
        mask &= ~left
        self._learn(found, mask)
        return mask

    def _learn(self, found: evidence.FlowEvidence, mask: Mask) -> None:
        """Keep the usual variance of each pixel's difference from frame to frame."""
        square = np.minimum(found.square, np.float32(4 * found.spread**2))
        if self.variance is None:
            self.variance = np.maximum(square, np.float32(found.spread**2))
        else:
            step = np.where(regions.dilated(mask, 5), np.float32(0), np.float32(_LEARNING_RATE))
            self.variance += step * (square - self.variance)


def difference(
    current: F32, background: F32, known: Mask, found: evidence.FlowEvidence, usual: float | F32
) -> tuple[Mask, F32]:
    """Where a frame does not show the background, in whatever light; and by how many mean squares (see `mismatch`)."""
    apart = evidence.mismatch(current - background, found.slope, usual)
    differs = known & (apart > _WEAK) & ~evidence.explained_by_light(background, current, found.spread)
    return differs & evidence.outstanding(current - background), apart


def rims(paused: Mask, background: F32, slope: F32) -> tuple[Mask, Mask]:
    """Regions where a thing stands that is not in the background, and those where one of the background left.

    Parameters
    ----------
    paused : (H, W) bool
        What differs from the background and does not move.
    background : (H, W) float32
        In the light of the frame.
    slope : (H, W) float32
        Squared gradient of the frame.
    """
    if not paused.any():
        return paused, paused
    count, labels, _, _ = regions.labelled(paused)
    rim = paused & regions.dilated(~paused, 3)
    of = labels[rim]
    gx, gy = evidence.gradient(background)
    before = np.bincount(of, (gx * gx + gy * gy)[rim], count)
    here = np.bincount(of, slope[rim], count)
    stands, left = here > _RIM**2 * before, before > _RIM**2 * here
    stands[0] = left[0] = False
    return stands[labels], left[labels]


def shows_background(current: F32, background: F32, found: evidence.FlowEvidence) -> Mask:
    """Where a frame shows the background, as far as that is known: nothing else can be there."""
    known = np.isfinite(background)
    if not known.any():
        return known
    still = known & ~regions.dilated(found.moving, 5)
    filled = relit(np.where(known, background, current), current, still, found.spread)
    change = current - filled
    # Compression lets a frame differ less from the one before than from the background.
    spread = max(found.spread, evidence.noise_of(change, still))
    apart = evidence.mismatch(change, found.slope, spread**2)
    # Ground without texture also shows in the soft shadow of a thing, or in what a lens or a codec makes of it.
    plain = evidence.box(found.slope, _PLAIN_WINDOW) < np.float32(_PLAIN * spread**2)
    return known & ((apart < _SAME) | (plain & ~evidence.outstanding(change)))
