"""The text beside the picture, in Markdown: what is measured now, the things that move, and what to know."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ...extraction.columns import meaning
from ...extraction.things import value_text
from .scene import speed_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..frame import LiveFrame

__all__ = ["panel_text"]

# Things that are listed, and notes that are kept, so that the text fits beside the picture.
_THINGS, _NOTES = 12, 4
_ARROWS = ("→", "↘", "↓", "↙", "←", "↖", "↑", "↗")


def panel_text(frame: LiveFrame, *, source: str, zoom: int, not_shown: int, notes: Sequence[str]) -> str:
    """Write the text for a frame."""
    return "\n".join([*_motion(frame), *_things(frame), *_source(frame, source, zoom, not_shown), *_told(notes)])


def _motion(frame: LiveFrame) -> list[str]:
    told = frame.reading
    if told is None:
        why = "after a gap: nothing to compare with" if frame.after_gap else "the first frame"
        return ["### Motion", "", f"{why}", ""]
    rows = []
    if told.velocity_status is not None:
        if told.velocity_status == "ok":
            for axis in ("x", "y", "z"):
                value, std = getattr(told, f"v{axis}_m_s"), getattr(told, f"v{axis}_std_m_s")
                rows.append((f"v{axis}", value_text(value, std, "m/s")))
        else:
            rows.append(("velocity", meaning(told.velocity_status)))
    if told.status == "ok":
        rows.append(("picture right", value_text(told.dx_px, told.dx_std_px, "px")))
        rows.append(("picture down", value_text(told.dy_px, told.dy_std_px, "px")))
    else:
        rows.append(("picture", meaning(told.status)))
    return ["### Motion", "", "| of | value |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows), ""]


def _things(frame: LiveFrame) -> list[str]:
    rows = [row for row in frame.measured.objects if row["area_px"] > 0]
    hidden = len(frame.measured.objects) - len(rows)
    count = f"{len(rows)} thing{'' if len(rows) == 1 else 's'} that move{'s' if len(rows) == 1 else ''}"
    lines = [f"### {count}", ""]
    if hidden:
        lines = [f"### {count}, {hidden} hidden", ""]
    if not frame.measured.segmentation.valid:
        return [*lines, meaning(frame.measured.segmentation.status.word), ""]
    if rows:
        lines += ["| no. | speed | way | frames |", "|---|---|---|---|"]
    for row in rows[:_THINGS]:
        speed = value_text(*speed_of(row))
        lines.append(f"| {row['id']} | {speed} | {_direction(row)} | {row['age_frames']} |")
    if len(rows) > _THINGS:
        lines.append(f"| ... | {len(rows) - _THINGS} more | | |")
    return [*lines, ""]


def _direction(row: dict[str, Any]) -> str:
    angle = row.get("direction_rad")
    if angle is None or not math.isfinite(angle):
        angle = math.atan2(row["vy_px_per_frame"], row["vx_px_per_frame"])
    return _ARROWS[round(angle / (math.pi / 4)) % 8] if math.isfinite(angle) else ""


def _source(frame: LiveFrame, source: str, zoom: int, not_shown: int) -> list[str]:
    height, width = frame.measured.frame.image.shape[:2]
    camera = frame.measured.segmentation.camera_model
    rows = [("source", source.replace("|", "\\|")), ("picture", f"{width} x {height}"), ("camera", camera)]
    if math.isfinite(frame.frame_rate_hz):
        rows.append(("frames", f"{frame.frame_rate_hz:.1f} a second"))
    if math.isfinite(frame.delay_s):
        rows.append(("delay", f"{1e3 * frame.delay_s:.0f} ms"))
    if frame.not_measured:
        rows.append(("not measured", f"{frame.not_measured} frames"))
    if not_shown:
        rows.append(("not shown", f"{not_shown} pictures"))
    if zoom > 1:
        rows.append(("arrows", f"{zoom} times the motion of a frame"))
    return ["### Source", "", "| what | value |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows), ""]


def _told(notes: Sequence[str]) -> list[str]:
    return ["### Notes", "", *(f"- {note}" for note in notes[-_NOTES:]), ""] if notes else []
