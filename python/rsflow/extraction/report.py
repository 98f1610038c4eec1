"""What stands on the report page: figures, plots, and an honest account of what was not measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import columns
from .report_page import Figure, Plot, Report, Table
from .series import Series, runs
from .summary import way_of
from .svg import Curve, path_plot, time_plot
from .thing_report import thing_plots, thing_table
from .things import LASTING_FRAMES, value_text
from .velocity_plot import abscissa, axes_text, velocity_plot

if TYPE_CHECKING:
    from .outputs import Outputs

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


def build(outputs: Outputs, summary: Mapping[str, Any], files: Mapping[str, Path]) -> Report:
    """Put the page together from what the run has gathered."""
    width, height = summary["size"]
    return Report(
        title=Path(str(summary["source"])).name or str(summary["source"]),
        subtitle=f"motion extracted by rsflow {summary['version']} on {summary['date']}; {width} x {height} pixels",
        complete=summary["complete"],
        summary=summary["answers"],
        tiles=_tiles(summary),
        problems=summary["problems"],
        notes=summary["notes"],
        figures=_figures(outputs, files, summary),
        plots=[*thing_plots(outputs, summary), *_plots(outputs, still=summary["camera_still"])],
        tables=_tables(outputs, summary, files),
        settings=_settings(summary),
    )


def _tiles(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Answer first how many, how fast and where; then what that rests on."""
    tiles = [*_thing_tiles(summary), *_camera_tiles(summary)]
    pairs = max(summary["frames"] - 1, 0)
    frames = f"{summary['frames']}"
    if summary["duration_s"] is not None:
        frames += f" in {summary['duration_s']:.2f} s"
    tiles.append(("frames", frames))
    tiles.append(("pairs with a displacement", f"{summary['measured']} of {pairs}"))
    if summary["moving_share"] is not None:
        tiles.append(("of the picture moves on its own", f"{100 * summary['moving_share']:.1f} %"))
    if summary["flow_valid_share"] is not None:
        tiles.append(("of the dense flow is valid", f"{100 * summary['flow_valid_share']:.1f} %"))
    tiles.append(("processed at", f"{summary['frames_per_second']:.1f} frames/s"))
    return tiles


def _thing_tiles(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    count = summary["lasting_objects"]
    tiles = [(f"moved on their own, for {LASTING_FRAMES} frames or more", f"{count} thing{'' if count == 1 else 's'}")]
    if not count:
        return tiles
    if summary["at_once_median"] is not None:
        tiles.append((f"at once, median; at most {summary['at_once_max']}", f"{summary['at_once_median']:.0f}"))
    if summary["thing_speed_median"] is not None:
        unit = summary["thing_speed_unit"]
        median = value_text(summary["thing_speed_median"], summary["thing_speed_std_median"], unit)
        tiles.append(("speed of things, median", median))
        fastest = value_text(summary["fastest_thing_speed"], summary["fastest_thing_speed_std"], unit)
        tiles.append((f"the fastest, number {summary['fastest_thing']}", fastest))
    return tiles


def _camera_tiles(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    tiles = []
    if summary["camera_still"]:
        tiles.append(("the camera", "stood still"))
    elif summary["picture_speed_median"] is not None:
        speed, std, unit = (summary[f"picture_speed_{name}"] for name in ("median", "std_median", "unit"))
        tiles.append(("the picture as a whole went, median", value_text(speed, std, unit)))
    if summary.get("speed_median_m_s") is not None:
        speed = value_text(summary["speed_median_m_s"], summary["speed_std_median_m_s"], "m/s")
        tiles.append(("speed over ground, median", speed))
        tiles.extend(_way_tiles(summary))
    return tiles


def _way_tiles(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Lead with what was measured; what is assumed for the rest stands by itself."""
    missing = summary["distance_unmeasured"]
    if not missing:
        return [("way travelled", f"{summary['distance_m']:.4g} m")]
    lost = f"{missing} frames ({summary['distance_unmeasured_s']:.2f} s)"
    measured = (f"way travelled where it was measured; {lost} were not", f"{summary['distance_measured_m']:.4g} m")
    if summary["distance_m"] is None:
        return [measured, ("way travelled in all", "not known")]
    assumed = "way travelled in all, if the motion went on as beside in what was not measured"
    return [measured, (assumed, f"{summary['distance_m']:.3g} ± {summary['distance_std_m']:.1g} m")]


def _figures(outputs: Outputs, files: Mapping[str, Path], summary: Mapping[str, Any]) -> list[Figure]:
    views = outputs.views
    if views is None or not views.posters:
        return []
    at = f"frame {views.poster_frame}"
    arrow = f"One pixel of motion is drawn {views.style.scale:g} px long in the whole clip."
    captions = {
        "flow": (
            "Motion",
            f"Arrows where motion is beyond its uncertainty, and one for each thing; shown is {at}. {arrow}",
        ),
        "moving": ("Moving", f"What moves on its own; shown is {at}, where most moves."),
        "static": (
            "Static",
            f"The scene; in the place of what moves is what was seen before or after it. Shown is {at}.",
        ),
    }
    playable = views.codec in {None, "h264", "vp9"}
    return [
        Figure(title, caption, views.jpeg(name), files.get(name), playable)
        for name, (title, caption) in captions.items()
    ]


def _plots(outputs: Outputs, *, still: bool) -> list[Plot]:
    motion = outputs.series["motion"]
    if len(motion) < 2:
        return []
    x, x_label = abscissa(motion)
    valid = np.isfinite(motion["dx_px"])
    valid[0] = True
    plots = _velocity_plots(outputs)
    plots.append(
        Plot(
            "Displacement of the picture from frame to frame",
            time_plot(
                x,
                [
                    Curve("dx, to the right", motion["dx_px"], motion["dx_std_px"]),
                    Curve("dy, down", motion["dy_px"], motion["dy_std_px"]),
                ],
                title="displacement over time",
                y_label="px per frame",
                x_label=x_label,
                valid=valid,
                y_least=0.2,
            ),
            "One vector for the whole picture, robust against what moves on its own. Bands are one standard deviation."
            + (" The camera stood still: what is left are errors." if still else ""),
        )
    )
    if not still:
        ways = _ways(motion)
        plots.append(
            Plot(
                "Where the picture has gone",
                time_plot(
                    x,
                    [Curve("x, to the right", *ways[0]), Curve("y, down", *ways[1])],
                    title="summed displacement over time",
                    y_label="px since the start",
                    x_label=x_label,
                    valid=valid,
                    y_least=1.0,
                ),
                "Sum of the displacements. Where none was measured it goes on with the camera's motion from the dense "
                "flow, else as beside, which is an assumption that its band allows for; it ends where neither is known."
                " Bands are one standard deviation of the sum.",
            )
        )
    plots += _flow_plots(motion, x, x_label)
    if np.isfinite(motion["gain"]).any():
        plots.append(_light(motion, x, x_label, valid))
    return plots


def _flow_plots(motion: Series, x: np.ndarray, x_label: str) -> list[Plot]:
    return [
        Plot(
            "Dense flow",
            time_plot(
                x,
                [Curve("median length", motion["flow_median_px"]), Curve("95 % are below", motion["flow_p95_px"])],
                title="length of the dense flow over time",
                y_label="px per frame",
                x_label=x_label,
                floor=0.0,
                y_least=0.2,
            ),
        ),
        Plot(
            "How much is valid, how much moves",
            time_plot(
                x,
                [
                    Curve("flow is valid", 100 * motion["flow_valid_share"]),
                    Curve("moves on its own", 100 * motion["moving_share"]),
                ],
                title="share of valid flow and of moving pixels over time",
                y_label="% of the picture",
                x_label=x_label,
                floor=0.0,
                y_least=5.0,
            ),
        ),
    ]


def _ways(motion: Series) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sum and its deviation along each axis; NaN from where on they are not known."""
    way = way_of(motion)
    known = np.isfinite(way.variance)
    sums, std = np.where(known, way.sums, np.nan), np.sqrt(np.where(known, way.variance, np.nan))
    return [(sums[:, axis], std[:, axis]) for axis in (0, 1)]


def _light(motion: Series, x: np.ndarray, x_label: str, valid: np.ndarray) -> Plot:
    # Contrast changes multiply from frame to frame; a change is shown in per cent of the frame before.
    return Plot(
        "Change of light from frame to frame",
        time_plot(
            x,
            [Curve("contrast", 100 * (motion["gain"] - 1.0))],
            title="change of contrast over time",
            y_label="%",
            x_label=x_label,
            valid=valid,
            y_least=2.0,
        ),
        "What the displacement allows for; without it, a change of light would be taken for motion.",
    )


def _velocity_plots(outputs: Outputs) -> list[Plot]:
    if "velocity" not in outputs.series or len(outputs.series["velocity"]) < 2:
        return []
    velocity, trajectory = outputs.series["velocity"], outputs.series["trajectory"]
    mounted = outputs.settings.sensors is not None and outputs.settings.sensors.mount is not None
    return [
        Plot("Velocity of the camera over the ground", velocity_plot(velocity, mounted=mounted), axes_text(mounted)),
        Plot(
            "Path over the ground",
            path_plot(
                trajectory["x_m"], trajectory["y_m"], title="path over the ground", x_label="x in m", y_label="y in m"
            ),
            "Sum of velocity times time, in the same axes at the start, made level where straight down is known. Over a"
            " gap the velocity is carried on from before it to after it; the deviations of trajectory.csv grow by what"
            " that may be wrong.",
        ),
    ]


def _tables(outputs: Outputs, summary: Mapping[str, Any], files: Mapping[str, Path]) -> list[Table]:
    tables = [*thing_table(outputs), _validity(outputs), *_budget(summary)]
    rows = [(path.name, _size(path), _FILES.get(name, "")) for name, path in files.items()]
    tables.append(Table("Files", ("file", "size", "what it holds"), rows, numbers=frozenset({1})))
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
    tables.append(Table("Columns of the tables", ("file", "column", "meaning"), meaning))
    return tables


def _validity(outputs: Outputs) -> Table:
    """Say for each estimator how many frames it could measure, and at which frames not, and why."""
    rows: list[tuple[str, ...]] = []
    for name, series, column in (
        ("displacement", "motion", "status"),
        ("moving and static", "motion", "segmentation_status"),
        ("velocity", "velocity", "status"),
    ):
        if series not in outputs.series:
            continue
        data = outputs.series[series]
        words = np.array(data.words(column))
        for status, count in data.counts(column).items():
            if status:
                rows.append((name, status, str(count), columns.meaning(status), runs(data["frame"], words == status)))
    return Table(
        "What was measured and what was not",
        ("", "status", "frames", "meaning", "which"),
        rows,
        "What cannot be measured is nan in the tables with an infinite standard deviation: never zero, never a guess.",
        frozenset({2}),
    )


def _budget(summary: Mapping[str, Any]) -> list[Table]:
    """Say what share of the velocities' variance comes from each cause."""
    shares: Mapping[str, float] = summary.get("speed_variance_shares") or {}
    if not shares:
        return []
    rows = [(name, f"{100 * share:.1f}") for name, share in shares.items()]
    rows += [(name, "not stated") for name in summary.get("speed_std_without") or ()]
    return [
        Table(
            "Where the uncertainty of the speed comes from",
            ("cause", "% of the variance"),
            rows,
            "Of the variance of the speed over ground, over all frames with a velocity. What was not stated is missing"
            " in it: the speed is only as exact as that.",
            frozenset({1}),
        )
    ]


def _size(path: Path) -> str:
    try:
        size = path.stat().st_size
    except OSError:
        return ""
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{math.ceil(size / 1e3)} kB"


def _settings(summary: Mapping[str, Any]) -> dict[str, str]:
    settings = {"source": str(summary["source"]), **{name: str(value) for name, value in summary["settings"].items()}}
    settings["camera motion"] = f"{summary['camera_motion']} ({summary['camera_motion_reason']})"
    settings["times are from"] = str(summary["timestamps"])
    settings["version"] = f"rsflow {summary['version']}, {summary['build']}"
    settings["took"] = f"{summary['seconds']:.1f} s, {summary['threads']} threads"
    return settings
