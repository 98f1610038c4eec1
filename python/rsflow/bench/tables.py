"""The rows of a run, and the Markdown tables made of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _checks
from .._display import fields
from ..errors import FormatError
from ._markdown import markdown
from .extract_tables import ExtractBench
from .kinds_tables import KindsBench
from .segmentation_tables import SegmentationBench
from .velocity_tables import VelocityBench

__all__ = ["BEGIN", "END", "Bench", "Row", "with_tables"]

# What stands between these lines of a Markdown file is rewritten by `with_tables`.
BEGIN = "<!-- bench-start -->"
END = "<!-- bench-end -->"


@dataclass(frozen=True)
class Row:
    """What one method did on one scene.

    Attributes
    ----------
    subject : str
        "dense flow", "points" or "displacement".
    scene, method : str
    median_px, p95_px : float
        Median and 95th percentile of the length of the error, over what the method answers; NaN if that is nothing.
    answered : float
        Share of the windows, points or pixels, of those that stay in the picture, for which the method gives an answer.
    time_ms : float
        Median time of a call.

    Examples
    --------
    >>> row = Row("points", "made", "rsflow track_points", 0.006, 0.013, 0.96, 2.6)
    >>> row.median_px, row.time_ms
    (0.006, 2.6)
    """

    subject: str
    scene: str
    method: str
    median_px: float
    p95_px: float
    answered: float
    time_ms: float


@dataclass(frozen=True, eq=False)
class Bench:
    """All rows of a run, and what it ran on.

    Attributes
    ----------
    rows : tuple of Row
    cpu_level : str
        The instructions that rsflow used.
    threads, rounds : int
    versions : dict
        Of rsflow, OpenCV, numpy and Python.

    Examples
    --------
    >>> row = Row("points", "made", "rsflow track_points", 0.006, 0.013, 0.96, 2.6)
    >>> Bench((row,), "avx2", 1, 9, {"rsflow": "0.1.0"}).conditions()
    'CPU level avx2, 1 thread, times are medians of 9 rounds; rsflow 0.1.0.'
    """

    rows: tuple[Row, ...]
    cpu_level: str
    threads: int
    rounds: int
    versions: dict[str, str]

    __repr__ = fields

    def conditions(self) -> str:
        """Say in one line what was measured on."""
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        counts = [
            f"{n} {what}{'' if n == 1 else 's'}" for n, what in ((self.threads, "thread"), (self.rounds, "round"))
        ]
        return f"CPU level {self.cpu_level}, {counts[0]}, times are medians of {counts[1]}; {versions}."

    def tables(self) -> str:
        """Write one Markdown table a subject, and the line of `conditions` below."""
        parts = []
        for subject in dict.fromkeys(row.subject for row in self.rows):
            cells = [(f"{subject}: scene", "method", "error: median", "95 %", "answered", "time")]
            last = ""
            for row in (row for row in self.rows if row.subject == subject):
                taken = f"{row.time_ms:.3g} ms" if row.time_ms < 100 else f"{row.time_ms:.0f} ms"
                cells.append((
                    "" if row.scene == last else row.scene, row.method, _pixels(row.median_px), _pixels(row.p95_px),
                    f"{100 * row.answered:.1f} %", taken,
                ))  # fmt: skip
                last = row.scene
            parts.append(markdown(cells))
        return "\n\n".join([*parts, self.conditions()])


def _pixels(length: float) -> str:
    return f"{length:.4f} px" if np.isfinite(length) else "-"


def with_tables(
    text: str,
    bench: Bench | KindsBench | VelocityBench | SegmentationBench | ExtractBench | None,
    *,
    name: str = "the file",
    marks: tuple[str, str] = (BEGIN, END),
) -> str:
    r"""Give the Markdown `text` with the tables of `bench` between the lines `BEGIN` and `END`.

    Parameters
    ----------
    text : str
    bench : Bench, KindsBench, VelocityBench, SegmentationBench, ExtractBench or None
        None changes nothing and only checks `text`.
    name : str
        What to call the text in an error.
    marks : (str, str)
        The two lines; `KINDS_MARKS` for a `KindsBench`, `VELOCITY_MARKS` for a `VelocityBench`, `SEGMENTATION_MARKS`
        for a `SegmentationBench`, `EXTRACT_MARKS` for an `ExtractBench`.

    Returns
    -------
    str

    Raises
    ------
    FormatError
        If the two lines are not there once each, in this order.

    Examples
    --------
    >>> with_tables(f"{BEGIN}\nold\n{END}\n", None) == f"{BEGIN}\nold\n{END}\n"
    True
    """
    text, name = _checks.text("text", text), _checks.text("name", name)
    if bench is not None:
        kinds = (Bench, KindsBench, VelocityBench, SegmentationBench, ExtractBench)
        expected = "a Bench, a KindsBench, a VelocityBench, a SegmentationBench, an ExtractBench or None"
        _checks.instance("bench", bench, kinds, expected)
    pair = [_checks.text("marks", mark) for mark in _checks.iterable("marks", marks, "two lines")]
    if len(pair) != 2:
        raise _checks.refused("marks", marks, "two lines")
    first, last = pair
    lines = [line.strip() for line in text.splitlines()]
    if (lines.count(first), lines.count(last)) != (1, 1) or lines.index(first) > lines.index(last):
        raise FormatError(
            f"{name}: {lines.count(first)} lines {first!r} and {lines.count(last)} lines {last!r}, "
            "expected one of each, in this order, around the tables"
        )
    if bench is None:
        return text
    kept = text.splitlines(keepends=True)
    begin, end = lines.index(first), lines.index(last)
    return "".join([*kept[: begin + 1], "\n", bench.tables(), "\n\n", *kept[end:]])
