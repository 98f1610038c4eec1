"""What a run by kind of scene found, the Markdown tables made of it, and what they say in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .._display import fields
from ._markdown import markdown

__all__ = ["KINDS_MARKS", "KindRow", "KindsBench", "SizeRow"]

# What stands between these lines of a Markdown file is rewritten by `with_tables`.
KINDS_MARKS = ("<!-- kinds-start -->", "<!-- kinds-end -->")

# A rival is ahead where its median or its 95 % is smaller by more than a tenth and by more than this, in pixels.
AHEAD = 0.1
AHEAD_PX = {"dense flow": 0.01, "points": 0.005, "displacement": 0.002, "grid": 0.005}
# A method that answers less than half of what another one answers is not compared with it.
ENOUGH = 0.5
# Shares that are worth a word: sure and wrong, and within two deviations (95.4 % if the deviations hold).
WRONG, WITHIN = 0.01, 0.85
# What rsflow's methods are held to: rivals of the same name or speed; all others to the first one that is there.
PEERS = {
    "rsflow ultrafast": ("OpenCV DIS ultrafast",),
    "rsflow fast": ("OpenCV DIS ultrafast", "OpenCV DIS fast"),
    "rsflow balanced": (), "rsflow track_points": (), "rsflow estimate_shift": (), "rsflow displacement_grid": (),
}  # fmt: skip


@dataclass(frozen=True)
class KindRow:
    """What one method did on the scenes of one kind.

    Attributes
    ----------
    subject : str
        "dense flow", "points", "displacement" or "grid".
    group, kind, method : str
    median_px, p95_px : float
        Median and 95th percentile of the length of the error: of dense flow at every pixel that stays in the picture
        and is not hidden, of the others over what the method says holds. NaN if that is nothing.
    answered : float
        Share that the method says holds, of what stays in the picture.
    wrong : float
        Share that the method says holds and that is off by more than half a pixel and by more than five of the
        deviations that it states, of everything that has a truth, hidden or gone as well.
    within_2 : float
        Share of the components of what holds that are within two of their deviations; NaN without deviations.
    time_ms, times : float
        Median time of a call, and as a multiple of that of rsflow's own on the same scenes.

    Examples
    --------
    >>> row = KindRow("points", "light", "steady", "rsflow track_points", 0.006, 0.013, 0.96, 0.0, 0.95, 2.6, 1.0)
    >>> row.kind, row.wrong
    ('steady', 0.0)
    """

    subject: str
    group: str
    kind: str
    method: str
    median_px: float
    p95_px: float
    answered: float
    wrong: float
    within_2: float
    time_ms: float
    times: float


@dataclass(frozen=True)
class SizeRow:
    """What a method takes on a picture of one size.

    Attributes
    ----------
    subject : str
    size : (int, int)
        Width and height in pixels.
    method : str
    time_ms, times : float
        Median time of a call, and as a multiple of that of rsflow's own.

    Examples
    --------
    >>> SizeRow("dense flow", (640, 480), "OpenCV DIS fast", 6.0, 0.5).times
    0.5
    """

    subject: str
    size: tuple[int, int]
    method: str
    time_ms: float
    times: float


@dataclass(frozen=True, eq=False)
class KindsBench:
    """All rows of a run by kind of scene, and what it ran on.

    Attributes
    ----------
    rows : tuple of KindRow
    sizes : tuple of SizeRow
    cpu, cpu_level : str
        The processor, and the instructions that rsflow used.
    threads, rounds : int
    versions : dict
        Of rsflow, its rivals, numpy and Python.
    missing : tuple of str
        Rivals that are not installed.

    Examples
    --------
    >>> ours = KindRow("points", "light", "steady", "rsflow track_points", 0.006, 0.013, 0.96, 0.0, 0.95, 2.6, 1.0)
    >>> theirs = KindRow("points", "light", "steady", "OpenCV PyrLK", 0.02, 0.05, 1.0, 0.02, float("nan"), 1.3, 0.5)
    >>> bench = KindsBench((ours, theirs), (), "a CPU", "avx2", 1, 3, {"rsflow": "0.1.0"})
    >>> print(bench.tables().splitlines()[9])
    | steady                          | **0.0060 (0.013)** | 0.020 (0.050) |
    """

    rows: tuple[KindRow, ...]
    sizes: tuple[SizeRow, ...]
    cpu: str
    cpu_level: str
    threads: int
    rounds: int
    versions: dict[str, str]
    missing: tuple[str, ...] = ()

    __repr__ = fields

    def conditions(self) -> str:
        """Say in one line what was measured on."""
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        counts = [
            f"{n} {what}{'' if n == 1 else 's'}" for n, what in ((self.threads, "thread"), (self.rounds, "round"))
        ]
        left = f" Not installed, and left out: {', '.join(self.missing)}." if self.missing else ""
        clock = "processor's times" if self.threads == 1 else "times"
        ran = f"{counts[0]}, {clock} are medians of {counts[1]}"
        return f"{self.cpu}, CPU level {self.cpu_level}, {ran}; {versions}.{left}"

    def tables(self) -> str:
        """Write the tables of each subject, what they say in words, and the line of `conditions`."""
        parts = [self.conditions()]
        for subject in dict.fromkeys(row.subject for row in self.rows):
            rows = [row for row in self.rows if row.subject == subject]
            sizes = [row for row in self.sizes if row.subject == subject]
            parts += [
                f"### {_title(subject)}",
                "Errors in pixels: median (95 %). The best median is bold.",
                errors(rows),
                in_words(rows),
                "Shares in percent: answered; wrong and sure; with deviations also what is within two of them.",
                trust(rows),
            ]
            if sizes:
                parts += ["Times in ms, and in brackets how many of rsflow's own they are.", times(sizes)]
        return "\n\n".join(parts)


def _title(subject: str) -> str:
    return subject[0].upper() + subject[1:]


def _by_kind(rows: Sequence[KindRow]) -> dict[tuple[str, str], dict[str, KindRow]]:
    found: dict[tuple[str, str], dict[str, KindRow]] = {}
    for row in rows:
        found.setdefault((row.group, row.kind), {})[row.method] = row
    return found


def _methods(rows: Iterable[KindRow | SizeRow]) -> list[str]:
    return list(dict.fromkeys(row.method for row in rows))


def _length(value: float) -> str:
    """Two digits that count, and no exponent."""
    if not np.isfinite(value):
        return "-"
    return f"{value:.0f}" if value >= 10 else f"{value:.{max(0, 1 - int(np.floor(np.log10(max(value, 1e-4)))))}f}"


def errors(rows: Sequence[KindRow]) -> str:
    """Write median and 95 % of the errors, a line a kind and a column a method, the best in bold; times below."""
    methods = _methods(rows)
    cells: list[tuple[str, ...]] = [("kind", *methods)]
    last = ""
    for (group, kind), each in _by_kind(rows).items():
        most = max(row.answered for row in each.values())
        able = [row.median_px for row in each.values() if _enough(row, most) and np.isfinite(row.median_px)]
        best = _length(min(able)) if able else ""
        texts = []
        for method in methods:
            row = each[method]
            text = f"{_length(row.median_px)} ({_length(row.p95_px)})" if np.isfinite(row.median_px) else "-"
            bold = bool(able) and _length(row.median_px) == best and _enough(row, most)
            texts.append(f"**{text}**" if bold else text)
        if group != last:
            cells.append((f"*{group}*", *("" for _ in methods)))
        cells.append((kind, *texts))
        last = group
    ratios = [[row.times for row in rows if row.method == method and np.isfinite(row.times)] for method in methods]
    medians = (_length(float(np.median(each))) if each else "-" for each in ratios)
    cells.append((f"*time, {methods[_first(methods)]} = 1*", *medians))
    return markdown(cells, words=1)


def _first(methods: Sequence[str]) -> int:
    return next((k for k, method in enumerate(methods) if method in PEERS and not PEERS[method]), 0)


def _enough(row: KindRow, most: float) -> bool:
    """Whether a method answers enough to be compared; of dense flow every pixel is compared."""
    return row.subject == "dense flow" or row.answered >= ENOUGH * most


def trust(rows: Sequence[KindRow]) -> str:
    """Write what was answered, what was wrong though sure, and how well the deviations hold, in percent."""
    methods = _methods(rows)
    cells: list[tuple[str, ...]] = [("kind", *methods)]
    last = ""
    for (group, kind), each in _by_kind(rows).items():
        texts = []
        for method in methods:
            row = each[method]
            within = f"; {100 * row.within_2:.0f}" if np.isfinite(row.within_2) else ""
            texts.append(f"{100 * row.answered:.0f}; {_percent(row.wrong)}{within}")
        if group != last:
            cells.append((f"*{group}*", *("" for _ in methods)))
        cells.append((kind, *texts))
        last = group
    return markdown(cells, words=1)


def _percent(share: float) -> str:
    value = 100 * share
    return "0" if value == 0 else "<0.1" if value < 0.1 else f"{value:.1f}" if value < 9.95 else f"{value:.0f}"


def times(rows: Sequence[SizeRow]) -> str:
    """Write the times by size, and in brackets how many of rsflow's own they are."""
    methods = _methods(rows)
    cells: list[tuple[str, ...]] = [("size", *methods)]
    for size in dict.fromkeys(row.size for row in rows):
        found = {row.method: row for row in rows if row.size == size}
        texts = [
            f"{_length(found[method].time_ms)} ({_length(found[method].times)})" if method in found else "-"
            for method in methods
        ]
        cells.append((f"{size[0]} x {size[1]}", *texts))
    return markdown(cells, words=1)


def in_words(rows: Sequence[KindRow]) -> str:
    """Say in which kinds a rival is ahead, and where rsflow is sure and wrong or too sure."""
    behind, sure, close = [], [], []
    for (_, kind), each in _by_kind(rows).items():
        rivals = [row for row in each.values() if not row.method.startswith("rsflow")]
        for name, peers in PEERS.items():
            ours = each.get(name)
            if ours is None:
                continue
            ahead = [r for r in rivals if (not peers or r.method in peers) and _ahead(r, ours)]
            if ahead:
                better = ", ".join(f"{r.method} {_length(r.median_px)} ({_length(r.p95_px)})" for r in ahead)
                own = (
                    f"{_length(ours.median_px)} ({_length(ours.p95_px)})"
                    if np.isfinite(ours.median_px)
                    else "no answer"
                )
                behind.append(f"{kind}: {name} {own}; {better}")
        for row in each.values():
            if not row.method.startswith("rsflow"):
                continue
            if row.wrong > WRONG:
                sure.append(f"{kind}: {row.method} {_percent(row.wrong)} %")
            if row.within_2 < WITHIN:
                close.append(f"{kind}: {row.method} {100 * row.within_2:.0f} %")
    alone = all(row.method.startswith("rsflow") for row in rows)
    parts = [] if alone else [_listed("A rival is ahead", behind, "No rival is ahead in any row.")]
    parts.append(_listed(f"Sure and wrong in more than {100 * WRONG:.0f} %", sure, "Sure and wrong in no row."))
    parts.append(_listed(f"Fewer than {100 * WITHIN:.0f} % within two deviations", close, "Too sure in no row."))
    return "\n\n".join(parts)


def _listed(head: str, lines: Sequence[str], none: str) -> str:
    return f"{head}:\n\n" + "\n".join(f"- {line}" for line in lines) if lines else none


def _ahead(rival: KindRow, ours: KindRow) -> bool:
    if not _enough(rival, ours.answered) or not np.isfinite(rival.median_px):
        return False
    if not np.isfinite(ours.median_px):
        # It does not answer: that is no error, unless a rival is right there.
        return rival.p95_px < 0.5
    least = AHEAD_PX[ours.subject]
    pairs = ((rival.median_px, ours.median_px), (rival.p95_px, ours.p95_px))
    return any(theirs < (1 - AHEAD) * own and theirs < own - least for theirs, own in pairs)
