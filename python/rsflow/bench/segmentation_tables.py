"""What a run over what moves found, and the Markdown table made of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._display import fields
from ._markdown import markdown

__all__ = ["SEGMENTATION_MARKS", "SegmentationBench", "SegmentationRow"]

# What stands between these lines of a Markdown file is rewritten by `with_tables`.
SEGMENTATION_MARKS = ("<!-- segmentation-kinds-start -->", "<!-- segmentation-kinds-end -->")


@dataclass(frozen=True)
class SegmentationRow:
    """How well one method told what moves on the clips of one kind.

    Attributes
    ----------
    kind, method : str
    f : float
        Of the pixels: twice those rightly called moving, over those called so plus those that do move; 1 is perfect.
        NaN where nothing moves.
    precision, recall : float
        Share of the pixels called moving that do move, and of those that move that are called so; NaN where there is
        none.
    false, far : float
        Share of the still pixels that are called moving, and of those that are more than 3 pixels from every thing.
    time_ms : float
        Median time of a frame, with the stabilising of rivals but without their median filter.
    median_px : int
        Side of the median filter after it, the best of several; 0 for none.
    shadows : bool
        Whether what it takes for shadows is counted as moving, where that is better.

    Examples
    --------
    >>> row = SegmentationRow("hand-held", "OpenCV MOG2", 0.62, 0.8, 0.5, 0.002, 0.001, 3.2, 5, True)
    >>> row.f, row.median_px
    (0.62, 5)
    """

    kind: str
    method: str
    f: float
    precision: float
    recall: float
    false: float
    far: float
    time_ms: float
    median_px: int = 0
    shadows: bool = False


@dataclass(frozen=True, eq=False)
class SegmentationBench:
    """All rows of a run over what moves, and what it ran on.

    Attributes
    ----------
    rows : tuple of SegmentationRow
    cpu_level : str
        The instructions that rsflow used.
    threads, clips, frames : int
        How many threads each method had, and how many clips of how many frames each kind.
    size : (int, int)
        Width and height of the frames.
    versions : dict
        Of rsflow, OpenCV, numpy and Python.

    Examples
    --------
    >>> row = SegmentationRow("hand-held", "rsflow", 0.95, 0.96, 0.94, 0.001, 0.0, 2.5)
    >>> bench = SegmentationBench((row,), "avx2", 1, 2, 90, (320, 240), {"rsflow": "0.1.0"})
    >>> print(bench.tables().splitlines()[2])
    | hand-held | rsflow | 0.950 |     0.960 |  0.940 | 0.100 % | 0.000 % | 2.5 ms |
    """

    rows: tuple[SegmentationRow, ...]
    cpu_level: str
    threads: int
    clips: int
    frames: int
    size: tuple[int, int]
    versions: dict[str, str]

    __repr__ = fields

    def tables(self) -> str:
        """Write a Markdown table of the kinds, and a line on what they were measured on."""
        parts = []
        if self.rows:
            cells = [("kind", "method", "F", "precision", "recall", "false", "far", "time")]
            last = ""
            for row in self.rows:
                cells.append((
                    "" if row.kind == last else row.kind, _method(row), _share(row.f), _share(row.precision),
                    _share(row.recall), f"{100 * row.false:.3f} %", f"{100 * row.far:.3f} %", f"{row.time_ms:.1f} ms",
                ))  # fmt: skip
                last = row.kind
            parts.append(markdown(cells))
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        counts = [f"{n} {what}{'' if n == 1 else 's'}" for n, what in ((self.threads, "thread"), (self.clips, "clip"))]
        width, height = self.size
        ran = f"{counts[0]}, {counts[1]} of {self.frames} frames of {width} x {height} a kind"
        return "\n\n".join([*parts, f"CPU level {self.cpu_level}, {ran}, times are medians; {versions}."])


def _method(row: SegmentationRow) -> str:
    after = [f"median {row.median_px}"] * bool(row.median_px) + ["shadows"] * row.shadows
    return ", ".join([row.method, *after])


def _share(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"
