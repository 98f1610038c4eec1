"""What a frame's mask shows: its regions, with the motion and the grey levels in them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from ..regions import labelled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F64 = NDArray[np.float64]

# Motion and grey levels of a region are taken at so many places along each side of its box.
_SAMPLES = 16
SAMPLES = _SAMPLES * _SAMPLES
# Grey levels fall into so many bins.
BINS = 16
# Share of a region's samples whose motion must be known for their median to be its motion.
_ENOUGH_MOTION = 0.3
# What moves by less than this share of the fastest tenth stands, if so much of the rest goes, and that tenth by so many
# pixels per frame: what is chosen from noise by its length is too long.
_GOING, _LEAST_GOING = 0.3, 0.25
_LEAST_FASTEST_PX = 1.0
# Neighbouring pixels' motion is alike: so many count as one.
_ALIKE_PX = 50.0


@dataclasses.dataclass
class Regions:
    """The regions of a mask, by label.

    Attributes
    ----------
    labels : (height, width) int32
        The region at each pixel, from 1, 0 where there is none.
    count : int
        How many labels there are, 0 with them.
    label : (n,) int
        The label of each region that is large enough.
    box : (n, 4) float64
        Left, top, right and bottom of its pixels, the last two beyond it.
    area : (n,) float64
    centre : (n, 2) float64
        Of its pixels.
    motion : (n, 2) float64
        Median of the motion in it, NaN where less than 30 % of it is known.
    motion_variance : (n, 2) float64
        Variance of that median.
    histogram : (n, 16) float64
        Shares of its grey levels; all zero without a picture.
    rows, columns : (n, 16) int
        Where samples of each region are taken: every row with every column.
    inside : (n, 256) bool
        Which of these are its pixels.
    image : (height, width) array or None
        The picture.
    """

    labels: NDArray[np.int32]
    count: int
    label: NDArray[np.intp]
    box: F64
    area: F64
    centre: F64
    motion: F64
    motion_variance: F64
    histogram: F64
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    inside: NDArray[np.bool_]
    image: NDArray[Any] | None

    def __len__(self) -> int:
        return len(self.label)

    @property
    def size(self) -> F64:
        """Width and height of each box, (n, 2)."""
        return self.box[:, 2:] - self.box[:, :2]


def observe(
    mask: NDArray[np.bool_], motion: NDArray[np.floating] | None, image: NDArray[Any] | None, min_area: int
) -> Regions:
    """Take a mask apart into its regions of at least `min_area` pixels."""
    _, labels, stats, centres = labelled(mask)
    label = np.flatnonzero(stats[1:, 4] >= min_area) + 1
    kept = stats[label].astype(np.float64)
    box = np.concatenate([kept[:, :2], kept[:, :2] + kept[:, 2:4]], axis=1)
    count = len(label)
    motions, variance = np.full((count, 2), np.nan), np.full((count, 2), np.inf)
    histogram = np.zeros((count, BINS))
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    columns = (kept[:, 0, None] + kept[:, 2, None] * steps).astype(np.intp)
    rows = (kept[:, 1, None] + kept[:, 3, None] * steps).astype(np.intp)
    place = (rows[:, :, None] * labels.shape[1] + columns[:, None, :]).reshape(count, SAMPLES)
    inside = labels.reshape(-1)[place] == label[:, None]
    if count and motion is not None:
        motions, variance = _medians(np.asarray(motion).reshape(-1, 2)[place], inside, kept[:, 4])
    if count and image is not None:
        histogram = histograms(image[rows[:, :, None], columns[:, None, :]].reshape(count, -1), inside)
    return Regions(
        labels,
        len(stats),
        label,
        box,
        kept[:, 4],
        centres[label],
        motions,
        variance,
        histogram,
        rows,
        columns,
        inside,
        image,
    )


def _medians(vectors: NDArray[Any], inside: NDArray[np.bool_], area: F64) -> tuple[F64, F64]:
    """Median of the known vectors of each row, and its variance; the lower of two middle ones."""
    known = inside & np.isfinite(vectors[..., 0]) & np.isfinite(vectors[..., 1])
    told, within = known.sum(axis=1), inside.sum(axis=1)
    known = _going(np.where(known, np.hypot(vectors[..., 0], vectors[..., 1]), -1.0).astype(np.float64), known, told)
    count = known.sum(axis=1)
    # What is not known comes last.
    order = np.sort(np.where(known[..., None], vectors, np.inf).astype(np.float64), axis=1)
    row = np.arange(len(count))
    most = np.maximum(count, 1)
    quartile = [order[row, (most - 1) * part // 4] for part in (1, 2, 3)]
    # Of normal values a quarter of the range between the quartiles is 0.337 deviations, of a median 1.25 over the root.
    with np.errstate(invalid="ignore"):
        spread = (quartile[2] - quartile[0]) * (0.7413 * 1.2533)
    free = np.clip(area * (count / np.maximum(within, 1)) / _ALIKE_PX, 1.0, np.maximum(count, 1))
    enough = (told >= _ENOUGH_MOTION * within) & (count > 0)
    median = np.where(enough[:, None], quartile[1], np.nan)
    variance = np.where(enough[:, None], spread * spread / free[:, None], np.inf)
    return median, variance


def _going(length: F64, known: NDArray[np.bool_], count: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Leave out what stands in a region that goes: shadow and pavement around a thing."""
    longest = np.sort(length, axis=1)
    # Unknown ones come first.
    high = longest[np.arange(len(count)), length.shape[1] - 1 - count // 10]
    going = known & (length >= _GOING * high[:, None])
    enough = (going.sum(axis=1) >= _LEAST_GOING * count) & (high >= _LEAST_FASTEST_PX)
    out: NDArray[np.bool_] = np.where(enough[:, None], going, known)
    return out


def histograms(grey: NDArray[Any], inside: NDArray[np.bool_]) -> F64:
    """Shares of grey levels in each row, of those `inside`."""
    dtype = grey.dtype
    if dtype == np.uint8:
        bins = (grey >> 4).astype(np.intp)
    else:
        levels = np.nan_to_num(grey.astype(np.float64))
        top = 65536.0 if dtype == np.uint16 else 256.0
        bins = np.clip(levels * (BINS / top), 0, BINS - 1).astype(np.intp)
    row = np.arange(len(grey))[:, None] * BINS
    total = np.bincount((row + bins)[inside], minlength=len(grey) * BINS).reshape(-1, BINS).astype(np.float64)
    out: F64 = total / np.maximum(total.sum(axis=1, keepdims=True), 1)
    return out
