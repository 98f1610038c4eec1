"""What stands on the report page, and in which order: the answers, then what they rest on, then the rest."""

from __future__ import annotations

import math
from pathlib import Path

from .. import columns
from ..slides import MOST
from .command import commands
from .material import Material
from .over_time import displacement, flow_plots, ground_path, light, picture_way, velocities
from .page import Report, Section
from .parts import Clip, Commands, Folded, Link, Part, Slider, Table, Text
from .sure import budget, validity
from .things import count_plot, speed_plot, thing_map, thing_table

__all__ = ["build"]

_FILES = {
    "motion": "a row a frame: displacement, flow, light, shares, status",
    "objects": "a row for each moving thing in each frame",
    "velocity": "velocity of the camera over the ground, a row a frame",
    "trajectory": "path of the camera, from its velocities",
    "flow": "arrows over the picture, at one scale for the whole clip",
    "moving": "what moves on its own",
    "static": "what stands still, without what moves",
    "background": "the scene without what moves, the best of all frames",
    "summary": "the key figures of this page, for programs",
}


def build(material: Material) -> Report:
    """Put the page together from what the run has gathered."""
    summary = material.summary
    width, height = summary["size"]
    frames = f"{summary['frames']} frame{'' if summary['frames'] == 1 else 's'}"
    if summary["duration_s"] is not None:
        frames += f" in {summary['duration_s']:.2f} s"
    fast = [*velocities(material), *speed_plot(material)]
    if not fast and not material.still:
        fast = displacement(material)
    shown = {plot.title for plot in fast}
    rest = [
        plot for plot in (*displacement(material), *flow_plots(material), *light(material)) if plot.title not in shown
    ]
    return Report(
        title=Path(str(summary["source"])).name or str(summary["source"]),
        subtitle=f"What moved in {frames} of {width} x {height} pixels, measured by rsflow {summary['version']} on "
        f"{summary['date'][:16]}. A value ± another has that standard deviation.",
        complete=summary["complete"],
        answers=material.answers,
        problems=summary["problems"],
        notes=summary["notes"],
        sections=[
            Section("see-it", "See it", _slider(material)),
            Section("how-fast", "How fast", fast),
            Section("where", "Where", [*thing_map(material), *ground_path(material), *picture_way(material)]),
            Section("how-many", "How many", [*count_plot(material), *thing_table(material)]),
            Section("how-sure", "How sure", [*validity(material), *budget(material)]),
            Section("videos", "Videos", _clips(material)),
            Section("more-curves", "More curves", rest),
            Section("make-it-again", "Make it again", _again(material)),
            Section("files", "Files", _files(material)),
        ],
    )


def _slider(material: Material) -> list[Part]:
    slides = material.slides
    if not slides:
        return []
    pairs = max(material.summary["frames"] - 1, 0)
    which = f"{len(slides)} of the {pairs + 1} frames, evenly spread. " if len(slides) < pairs else ""
    caption = (
        f"{which}Around each thing its outline, with its number; arrows stand where motion is beyond its uncertainty, "
        f"and one on each thing. A motion of one pixel a frame is drawn {material.arrow_scale:g} px long in the "
        "full picture."
    )
    if material.settings.mask is not None:
        caption += " What is dark does not count, as the mask says."
    return [Slider(slides[:MOST], caption)]


def _clips(material: Material) -> list[Part]:
    if not material.posters:
        return [Text("No videos were made (--no-videos).")] if not material.settings.videos else []
    at = f"frame {material.poster_frame}"
    captions = {
        "flow": ("Motion", f"Arrows where motion is beyond its uncertainty, and one for each thing. Shown is {at}."),
        "moving": ("Moving", f"What moves on its own. Shown is {at}, where most moves."),
        "static": ("Static", f"The scene; in the place of what moves is what was seen before or after. Shown is {at}."),
    }
    playable = material.summary["video_codec"] in {None, "h264", "vp9"}
    return [
        Clip(title, caption, material.posters.get(name), material.files.get(name), playable)
        for name, (title, caption) in captions.items()
    ]


def _files(material: Material) -> list[Part]:
    files = material.files
    rows = [(Link(path.name, path.name), _size(path), _FILES.get(name, "")) for name, path in files.items()]
    meaning = [
        (f"{name}.csv", column, text)
        for name, names in (
            ("motion", columns.MOTION),
            ("objects", columns.OBJECTS),
            ("velocity", columns.VELOCITY),
            ("trajectory", columns.TRAJECTORY),
        )
        if name in files
        for column, text in names.items()
    ]
    return [
        Table("", ("file", "size", "what it holds"), rows, "Beside this page.", frozenset({1})),
        Folded("Columns of the tables", [Table("", ("file", "column", "meaning"), meaning)]),
    ]


def _size(path: Path) -> str:
    try:
        size = path.stat().st_size
    except OSError:
        return ""
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{math.ceil(size / 1e3)} kB"


def _again(material: Material) -> list[Part]:
    summary = material.summary
    settings = [
        ("source", str(summary["source"])),
        *((name, str(value)) for name, value in summary["settings"].items()),
    ]
    settings += [
        ("camera motion", f"{summary['camera_motion']} ({summary['camera_motion_reason']})"),
        ("times are from", str(summary["timestamps"])),
        ("version", f"rsflow {summary['version']}, {summary['build']}"),
        (
            "took",
            f"{summary['seconds']:.1f} s, {summary['frames_per_second']:.1f} frames/s, {summary['threads']} threads",
        ),
    ]
    return [Commands(*commands(material)), Folded("All settings", [Table("", ("setting", "value"), settings)])]
