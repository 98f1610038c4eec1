"""What moves, told by rsflow and by OpenCV's background subtractors, against exact masks."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._core import __version__, build_info
from ..segmentation import MotionSegmenter
from ..synthetic import MovingThings
from ._threads import threads as threads_of
from .segmentation_kinds import Kind, kinds
from .segmentation_rivals import Stabiliser, filtered, subtractors, variants
from .segmentation_tables import SegmentationBench, SegmentationRow

__all__ = ["measure_segmentation"]

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Every method learns its background in the first frames, which do not count.
LEARNING_FRAMES = 10
# A false pixel farther than this from every thing is not one of an outline that is too wide.
FAR_PX = 3


@dataclass(frozen=True)
class Counts:
    """Pixels by what they are and what they are called: right, false, missed; false ones far from all; still ones."""

    right: int = 0
    false: int = 0
    missed: int = 0
    far: int = 0
    still: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(a + b for a, b in zip(self._values(), other._values(), strict=True)))

    def _values(self) -> tuple[int, ...]:
        return self.right, self.false, self.missed, self.far, self.still

    @property
    def f(self) -> float:
        """Twice what is right over all that is called moving and all that moves; NaN where nothing moves."""
        moving = self.right + self.missed
        return 2 * self.right / (2 * self.right + self.false + self.missed) if moving else np.nan

    def row(self, kind: str, method: str, time_ms: float, variant: tuple[int, bool] = (0, False)) -> SegmentationRow:
        """Give the shares that a table shows."""
        called, moving = self.right + self.false, self.right + self.missed
        return SegmentationRow(
            kind=kind,
            method=method,
            f=self.f,
            precision=self.right / called if called else np.nan,
            recall=self.right / moving if moving else np.nan,
            false=self.false / max(self.still, 1),
            far=self.far / max(self.still, 1),
            time_ms=time_ms,
            median_px=variant[0],
            shadows=variant[1],
        )


def counted(found: Sequence[Mask], truth: Sequence[Mask]) -> Counts:
    """Count the pixels of frames after the first ones."""
    import cv2

    near = np.ones((2 * FAR_PX + 1, 2 * FAR_PX + 1), np.uint8)
    total = Counts()
    for called, moves in zip(found[LEARNING_FRAMES:], truth[LEARNING_FRAMES:], strict=True):
        away = cv2.dilate(moves.astype(np.uint8), near) == 0
        values = (called & moves, called & ~moves, ~called & moves, called & away, ~moves)
        total += Counts(*(int(np.count_nonzero(value)) for value in values))
    return total


def measure_segmentation(
    *,
    only: Sequence[str] | None = None,
    clips: int = 2,
    threads: int = 1,
    quick: bool = False,
    progress: Callable[[str], object] | None = None,
) -> SegmentationBench:
    """Measure how well what moves is told from what stands still, on kinds of scenes with exact masks.

    Clips of `rsflow.synthetic.moving_things`, 90 frames of 320 x 240 pixels; those before the tenth do not count.
    Beside `rsflow.MotionSegmenter` OpenCV's MOG2 and KNN, and GSOC and CNT where this OpenCV has them, as users
    compose them: where the camera moves, each frame is laid over the first one by a homography; after each comes the
    best of several median filters, and of counting what it calls a shadow or not, by the figures of that kind.

    Parameters
    ----------
    only : sequence of str, optional
        Kinds whose name begins with one of these; an empty sequence measures none. By default all.
    clips : int
        How many clips, of different things and ground, each kind has.
    threads : int
        For rsflow and for OpenCV.
    quick : bool
        One clip of 24 frames of 160 x 120 pixels: to see that it works, not to quote.
    progress : callable, optional
        Called with the name of each kind before it is measured.

    Returns
    -------
    SegmentationBench

    Raises
    ------
    OptionError
        If a number is below 1, or nothing is called as in `only`.

    Examples
    --------
    >>> from rsflow.bench import measure_segmentation
    >>> found = measure_segmentation(only=["empty, static"], quick=True)
    >>> row = found.rows[0]
    >>> row.kind, row.method, row.false < 0.002
    ('empty, static camera', 'rsflow', True)
    """
    import cv2

    clips = _checks.integer("clips", clips, least=1, most=1000)
    threads = _checks.integer("threads", threads, least=1, most=1024)
    quick = _checks.flag("quick", quick)
    told = (lambda name: None) if progress is None else _checks.function("progress", progress, 1)
    clips, frames, size = (1, 24, (160, 120)) if quick else (clips, 90, (320, 240))
    rows: list[SegmentationRow] = []
    with threads_of(threads):
        for kind in _chosen(only):
            told(kind.name)
            rows += rows_of(kind, [kind.make(clip, frames, size) for clip in range(clips)])
    versions = {
        "rsflow": __version__, "OpenCV": cv2.__version__, "numpy": np.__version__, "Python": platform.python_version(),
    }  # fmt: skip
    return SegmentationBench(tuple(rows), str(build_info()["cpu_level"]), threads, clips, frames, size, versions)


def _chosen(only: Sequence[str] | None) -> list[Kind]:
    every = list(kinds())
    if only is None:
        return every
    if isinstance(only, str):
        raise _checks.refused("only", only, "a sequence of names, or of their beginnings")
    begins = [_checks.text("only", name) for name in _checks.iterable("only", only, "names of kinds")]
    for begin in begins:
        if not any(kind.name.startswith(begin) for kind in every):
            raise _checks.refused("only", begin, f"the beginning of one of: {'; '.join(k.name for k in every)}")
    return [kind for kind in every if any(kind.name.startswith(begin) for begin in begins)]


def rows_of(kind: Kind, clips: Sequence[MovingThings]) -> list[SegmentationRow]:
    """Give a row for each method, over all clips of a kind."""
    total, times = Counts(), []
    for clip in clips:
        masks, taken = _ours(clip, kind.still_camera)
        total += counted(masks, list(clip.masks))
        times += taken
    rows = [total.row(kind.name, "rsflow", float(np.median(times)))]
    for name, make in subtractors().items():
        counts: dict[tuple[int, bool], Counts] = {variant: Counts() for variant in variants(name)}
        times = []
        for clip in clips:
            levels, taken = _theirs(clip, make() if kind.still_camera else Stabiliser(make, kind.pad))
            times += taken
            for variant in counts:
                counts[variant] += counted(filtered(levels, variant), list(clip.masks))
        best = _best(counts)
        rows.append(counts[best].row(kind.name, name, float(np.median(times)), best))
    return rows


def _best(counts: Mapping[tuple[int, bool], Counts]) -> tuple[int, bool]:
    """Give the variant of the best F, or of the fewest false pixels where nothing moves."""
    return max(counts, key=lambda variant: (np.nan_to_num(counts[variant].f), -counts[variant].false))


def _ours(clip: MovingThings, still: bool) -> tuple[list[Mask], list[float]]:
    segmenter = MotionSegmenter(camera_motion="static" if still else "moving")
    masks, times = [], []
    for image in clip.images:
        begin = time.perf_counter()
        seen = segmenter.update(image)
        times.append(1000.0 * (time.perf_counter() - begin))
        masks.append(np.array(seen.moving))
    return masks, times[1:]


def _theirs(clip: MovingThings, model: Any) -> tuple[list[NDArray[np.uint8]], list[float]]:
    levels, times = [], []
    for image in clip.images:
        begin = time.perf_counter()
        said = model.apply(image)
        times.append(1000.0 * (time.perf_counter() - begin))
        levels.append(np.array(said))
    return levels, times[1:]
