"""``rsflow velocity``: how fast the camera travels over flat ground."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import add_mask, add_overwrite, add_range, add_rate, identity_of, mask_of, source_of
from rsflow.errors import OptionError

if TYPE_CHECKING:
    from rsflow._results.folder import ResultFolder
    from rsflow.capture import Frames
    from rsflow.velocity import Heights

DESCRIPTION = """\
Measure how fast a camera travels over flat ground, and what the figures are worth.

Needs a calibrated camera (see 'rsflow calibrate') and the height over the ground: constant, or a CSV with the columns
t_s,height_m (read between its rows) or frame,height_m. Writes into the folder OUT:

  velocity.csv   a row a frame: frame,t_s,dt_s,vx_m_s,vy_m_s,vz_m_s, their standard deviations, height_m,
                 dx_px,dy_px (how far the picture went), n_points,status
  velocity.png   the velocity over time (needs matplotlib: pip install 'rsflow-motion[plot]')

Axes are the camera's: x right, y down the picture, z along the optical axis. A camera that moves to its right has
vx > 0 while the picture flows to the left. What cannot be measured is nan, with the reason in the column status.

examples:
  rsflow velocity flight.mp4 --camera cam.yaml --height 0.2
  rsflow velocity flight.mp4 --camera cam.yaml --height-csv heights.csv --height-std 0.002 -o out
  rsflow velocity 'pictures/*.png' --rate 30 --camera cam.yaml --height 0.2 --json
  rsflow velocity flight.mp4 --camera cam.yaml --height 0.2 --mask ground.png     without what goes with the camera
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow velocity``."""
    parser.add_argument("source", metavar="SOURCE", help="video, folder or glob of pictures, camera number, URL")
    parser.add_argument("--camera", metavar="FILE", required=True, help="calibration: ROS, OpenCV, kalibr or JSON")
    height = parser.add_mutually_exclusive_group(required=True)
    height.add_argument("--height", type=float, metavar="M", help="perpendicular distance from the ground in metres")
    height.add_argument("--height-csv", metavar="FILE", help="heights: columns t_s,height_m or frame,height_m")
    parser.add_argument(
        "--height-std", type=float, metavar="M", help="standard deviation of the height, 0 where it is exact"
    )
    parser.add_argument("-o", "--output", default=".", metavar="OUT", help="folder for the files (default: this one)")
    add_mask(parser)
    add_rate(parser)
    add_range(parser)
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print a summary as JSON")


def run(args: argparse.Namespace) -> int:
    """Measure, write the table and the plot, print a summary."""
    import rsflow
    from rsflow.capture.masks import expect_size
    from rsflow.capture.too_few import too_few
    from rsflow.extraction.metric import fitting_camera
    from rsflow.extraction.summary import as_json
    from rsflow.extraction.trajectory import Trajectory
    from rsflow.velocity import Heights, velocity_row, write_velocity_csv
    from rsflow.velocity.result import not_stated

    camera = rsflow.Camera.load(args.camera)
    heights = None if args.height_csv is None else Heights.read(args.height_csv)
    mask = mask_of(args.mask)
    folder = Path(args.output)
    table, picture = folder / "velocity.csv", folder / "velocity.png"
    rows: list[dict[str, Any]] = []
    trajectory = Trajectory()
    budget, scaled, interrupted = "", "", False
    unstated: tuple[str, ...] = ()
    broken: rsflow.RsflowError | None = None
    source = source_of(args.source)
    with (
        rsflow.frames(source, frame_rate=args.rate, start=args.start, stop=args.stop, stride=args.stride) as sequence,
        _folder(args, source, sequence, [table, picture]) as result,
    ):
        estimator = None
        try:
            for frame in sequence:
                if estimator is None:
                    fitted, scaled = fitting_camera(camera, sequence, None)
                    if mask is not None:
                        expect_size(f"--mask {args.mask}", mask, fitted.size)
                    estimator = rsflow.VelocityEstimator(
                        fitted, height_m=args.height, height_std_m=args.height_std, mask=mask
                    )
                own = None if heights is None else heights.at(frame=frame.index, t_s=frame.t_s)
                v = estimator.update(frame.image, frame.t_s, height_m=own)
                trajectory.add(v, frame.index)
                rows.append(velocity_row(v, frame=frame.index, height_m=args.height if own is None else own))
                budget, unstated = (v.budget(), v.unstated) if v.valid else (budget, unstated)
        except KeyboardInterrupt:
            interrupted = True
        except rsflow.RsflowError as error:
            if not rows:
                raise
            broken = error
        if not rows and interrupted:
            raise KeyboardInterrupt
        if len(rows) < 2 and not interrupted and broken is None:
            raise too_few(sequence, len(rows))
        if heights is not None and broken is None:
            _expect_a_height(heights, rows, args.height_csv)
        result.record()
        write_velocity_csv(table, rows)
        note = _plotted(picture, rows, str(args.source))
        result.finish([table] if note is not None else [table, picture])
    pauses = () if heights is None else heights.notes
    notes = [text for text in (*sequence.notes, *pauses, scaled, not_stated(unstated)) if text]
    summary = _summary(rows) | as_json(trajectory.figures()) | {"std_without": list(unstated), "notes": notes}
    summary |= {"csv": str(table), "plot": str(picture) if note is None else None}
    if args.json:
        print(json.dumps(summary, indent=2))
    else:
        _show(summary, budget)
    if heights is not None and "no_height" in summary["status"]:
        without = f"{summary['status']['no_height']} frames have no height: {args.height_csv} has {heights.span}"
        print(f"rsflow velocity: {without}", file=sys.stderr)
    if note is not None:
        print(f"rsflow velocity: no plot: {note}", file=sys.stderr)
    if broken is not None:
        raise type(broken)(f"{broken}; {table} has the {len(rows)} frames before") from broken
    if interrupted:
        raise KeyboardInterrupt(f"interrupted after {len(rows)} frames; {table} has them")
    return 0


def _folder(args: argparse.Namespace, source: int | str, sequence: Frames, files: list[Path]) -> ResultFolder:
    """Find out whether the files may be written, before the work."""
    from rsflow._results.folder import ResultFolder
    from rsflow._results.inputs import Inputs
    from rsflow.capture.too_few import expect_range

    expect_range(sequence)
    Inputs(source, files=(args.camera, args.height_csv, args.mask)).refuse(files)
    identity = identity_of(source, args, files=("camera", "height_csv", "mask"))
    return ResultFolder(files[0].parent, "velocity", [path.name for path in files], identity, overwrite=args.overwrite)


def _expect_a_height(heights: Heights, rows: list[dict[str, Any]], path: str) -> None:
    """Raise OptionError where no frame has a height."""
    if not any(math.isfinite(row["height_m"]) for row in rows):
        first, last = rows[0], rows[-1]
        raise OptionError(
            f"--height-csv: got {path} with {heights.span}, expected heights of the frames from {first['frame']} to "
            f"{last['frame']}, at times from {first['t_s']:g} to {last['t_s']:g} s: none has a height"
        )


def _plotted(path: Path, rows: list[dict[str, Any]], title: str) -> str | None:
    """Draw the plot; what stands in the way as a sentence."""
    from rsflow.errors import MissingExtraError
    from rsflow.velocity import plot_velocity

    try:
        plot_velocity(path, rows, title=title)
    except MissingExtraError as error:
        return str(error)
    return None


def _summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    import numpy as np

    measured = [row for row in rows if row["status"] == "ok"]
    summary: dict[str, Any] = {
        "frames": len(rows),
        "measured": len(measured),
        "status": dict(Counter(row["status"] for row in rows)),
    }
    for name in ("vx_m_s", "vy_m_s", "vz_m_s"):
        values = np.array([row[name] for row in measured], dtype=np.float64)
        values = values[np.isfinite(values)]
        summary[f"mean_{name}"] = float(values.mean()) if values.size else None
    speeds = [math.hypot(row["vx_m_s"], row["vy_m_s"]) for row in measured]
    summary["mean_speed_m_s"] = float(np.mean(speeds)) if speeds else None
    return summary


def _show(summary: dict[str, Any], budget: str) -> None:
    from rsflow.extraction.summary import way_text

    others = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in summary["status"].items() if name != "ok")
    print(f"{summary['measured']} of {summary['frames']} frames measured" + (f" ({others})" if others else ""))
    if summary["measured"]:
        print("mean velocity  " + "  ".join(
            f"{axis} {summary[f'mean_{axis}_m_s']:+.4g} m/s" if summary[f"mean_{axis}_m_s"] is not None else f"{axis} ?"
            for axis in ("vx", "vy", "vz")
        ))  # fmt: skip
        print(f"mean speed     {summary['mean_speed_m_s']:.4g} m/s where it was measured; {way_text(summary)}")
        print("uncertainty of the last frame's speed, by origin:")
        print("\n".join(f"  {line}" for line in budget.splitlines()))
    for text in summary["notes"]:
        print(f"note: {text}")
    print(f"table  {summary['csv']}")
    if summary["plot"]:
        print(f"plot   {summary['plot']}")
