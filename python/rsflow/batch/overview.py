"""A page of the whole batch: what became of each source, what was measured of it, and where its report is."""

from __future__ import annotations

import math
import os
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ..errors import OptionError
from ..extraction.answers import Answer, Fact
from ..extraction.report.page import Report, Section, page
from ..extraction.report.parts import Badge, Link, Table
from ..extraction.things import value_text
from ..io.atomic import writing
from . import remote
from .items import BatchItem, BatchStatus

__all__ = ["NAME", "expect_place", "write_overview"]

NAME = "index.html"
# Rows of the list at most; what was not done stands first.
_MOST = 5_000
# What tells a page of ours from another that stands there.
_MARK = '<meta name="generator" content="rsflow batch">'
_ORDER = (BatchStatus.FAILED, BatchStatus.PARTIAL, BatchStatus.CANCELLED, BatchStatus.DONE)
_HEADER = ("source", "state", "length", "frames", "measured", "speed", "things")


def expect_place(out: str | os.PathLike[str]) -> None:
    """Raise OptionError where another page or a folder stands where the overview is to be."""
    path = Path(out) / NAME
    if remote.is_remote(str(out)) or not path.exists():
        return
    if path.is_dir() or _MARK not in path.read_text(encoding="utf-8", errors="replace")[:2_000]:
        raise OptionError(f"out: got {out}, where {NAME} is something else than an overview, expected another folder")


def write_overview(items: Sequence[BatchItem], out: str | os.PathLike[str]) -> str:
    """Write the page of all sources; give its path or URL."""
    text = overview(items)
    if not remote.is_remote(str(out)):
        path = Path(out) / NAME
        with writing(path) as beside:
            beside.write_text(text, encoding="utf-8")
        return str(path)
    with tempfile.TemporaryDirectory(prefix="rsflow-overview-") as folder:
        (Path(folder) / NAME).write_text(text, encoding="utf-8")
        remote.sent(Path(folder), str(out).rstrip("/"))
    return f"{str(out).rstrip('/')}/{NAME}"


def overview(items: Sequence[BatchItem]) -> str:
    """Give the page of all sources as HTML: what was not done first, each with a link to its report."""
    counts = Counter(BatchStatus(item.status) for item in items)
    sources = f"{len(items)} source{'' if len(items) == 1 else 's'}"
    ordered = sorted(items, key=lambda item: _ORDER.index(BatchStatus(item.status)))
    failed = [item for item in ordered if item.error]
    sections = (
        Section("not-done", "What was not done, and why", [_not_done(failed)] if failed else []),
        Section("sources", "All sources", [_all(ordered)]),
    )
    report = Report(
        title=sources,
        subtitle=", ".join(f"{counts[status]} {status.word}" for status in _ORDER if counts[status]),
        complete=counts[BatchStatus.DONE] == len(items),
        answers=_answers(items, counts),
        sections=sections,
        ended_early="not all sources were done",
    )
    return page(report).replace('<meta name="viewport"', f'{_MARK}\n<meta name="viewport"', 1)


def _answers(items: Sequence[BatchItem], counts: Mapping[BatchStatus, int]) -> list[Answer]:
    def total(name: str) -> int:
        return sum(int(_number(item.summary, name, 0.0)) for item in items)

    pairs = sum(max(int(_number(item.summary, "frames", 0.0)) - 1, 0) for item in items)
    length = sum(_number(item.summary, "duration_s", 0.0) for item in items)
    share = f"{100 * total('measured') / pairs:.1f} %" if pairs else "none"
    facts = {
        "How many?": Fact(f"{counts[BatchStatus.DONE]} of {len(items)}", "sources done"),
        "How long?": Fact(_time(length), f"of video, {total('frames')} frames"),
        "What moved?": Fact(str(total("lasting_objects")), "things moved on their own, in all sources together"),
        "How sure?": Fact(share, "of the pairs of frames that were read could be measured"),
    }
    return [Answer(question, (fact,), (), ()) for question, fact in facts.items()]


def _number(summary: Mapping[str, Any], name: str, otherwise: float = math.nan) -> float:
    value = summary.get(name)
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else otherwise


def _time(seconds: float) -> str:
    """Write a length of time as a person says it."""
    if not math.isfinite(seconds):
        return ""
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"


def _speed(summary: Mapping[str, Any]) -> str:
    """Say how fast the camera, or the picture as a whole, went."""
    if summary.get("velocity_measured"):
        return value_text(_number(summary, "speed_median_m_s"), _number(summary, "speed_std_median_m_s"), "m/s")
    if summary.get("camera_still"):
        return "stood still"
    speed = _number(summary, "picture_speed_median")
    if not math.isfinite(speed):
        return ""
    return value_text(speed, _number(summary, "picture_speed_std_median"), str(summary["picture_speed_unit"]))


def _cells(item: BatchItem) -> tuple[str, ...]:
    summary = item.summary
    if not summary:
        return ("",) * 5
    frames, measured = int(summary.get("frames") or 0), int(summary.get("measured") or 0)
    share = f"{100 * measured / (frames - 1):.0f} %" if frames > 1 else ""
    things = str(summary.get("lasting_objects", ""))
    return (_time(_number(summary, "duration_s")), str(frames), share, _speed(summary), things)


def _source(item: BatchItem) -> str | Link:
    """Give the source, which leads to its report where there is one."""
    name, report = str(item.source), (item.summary.get("files") or {}).get("report")
    if not report:
        return name
    folder = str(item.folder).rstrip("/").replace("\\", "/").rsplit("/", 1)[-1]
    return Link(name, f"{quote(folder)}/{quote(Path(str(report)).name)}")


def _state(item: BatchItem) -> Badge:
    status = BatchStatus(item.status)
    return Badge(status.word, status == BatchStatus.DONE)


def _not_done(items: Sequence[BatchItem]) -> Table:
    rows = [(_source(item), _state(item), item.error) for item in items]
    return Table("", ("source", "state", "why"), rows, stacks=True, name="what was not done")


def _all(items: Sequence[BatchItem]) -> Table:
    caption = "Speeds are medians with the standard deviation of one frame; measured: of the pairs of frames."
    if len(items) > _MOST:
        caption += f" The first {_MOST} of {len(items)}."
    parts = [item for item in items if item.summary.get("parts")]
    if parts:
        caption += (
            f" {len(parts)} of them were measured in parts that overlap: what moves is there that of one run but for "
            "what is older than the overlap, all else to the byte; see the notes in summary.json."
        )
    rows = [(_source(item), _state(item), *_cells(item)) for item in items[:_MOST]]
    return Table("", _HEADER, rows, caption, stacks=True, name="all sources")
