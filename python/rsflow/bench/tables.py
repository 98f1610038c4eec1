"""The rows of a run, and the Markdown tables made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import _checks
from .._display import fields
from ..errors import FormatError

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
            parts.append(_table(cells))
        return "\n\n".join([*parts, self.conditions()])


def _pixels(length: float) -> str:
    return f"{length:.4f} px" if np.isfinite(length) else "-"


def _table(cells: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[j]) for row in cells) for j in range(len(cells[0]))]

    def line(row: Sequence[str]) -> str:
        # The first two columns are words, the others numbers.
        padded = (f"{cell:{'<' if j < 2 else '>'}{widths[j]}}" for j, cell in enumerate(row))
        return f"| {' | '.join(padded)} |"

    rule = "|" + "|".join("-" * (w + 2) if j < 2 else "-" * (w + 1) + ":" for j, w in enumerate(widths)) + "|"
    return "\n".join([line(cells[0]), rule, *map(line, cells[1:])])


def with_tables(text: str, bench: Bench | None, *, name: str = "the file") -> str:
    r"""Give the Markdown `text` with the tables of `bench` between the lines `BEGIN` and `END`.

    Parameters
    ----------
    text : str
    bench : Bench or None
        None changes nothing and only checks `text`.
    name : str
        What to call the text in an error.

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
        _checks.instance("bench", bench, Bench, "a Bench or None")
    lines = [line.strip() for line in text.splitlines()]
    if (lines.count(BEGIN), lines.count(END)) != (1, 1) or lines.index(BEGIN) > lines.index(END):
        raise FormatError(
            f"{name}: {lines.count(BEGIN)} lines {BEGIN!r} and {lines.count(END)} lines {END!r}, "
            "expected one of each, in this order, around the tables"
        )
    if bench is None:
        return text
    kept = text.splitlines(keepends=True)
    begin, end = lines.index(BEGIN), lines.index(END)
    return "".join([*kept[: begin + 1], "\n", bench.tables(), "\n\n", *kept[end:]])
