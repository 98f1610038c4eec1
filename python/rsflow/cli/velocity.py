"""``rsflow velocity``: how fast the camera travels over flat ground."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.cli import _check_scale
from rsflow.cli._export import add_exports, exports
from rsflow.cli._options import add_mask, add_overwrite, add_range, add_rate, add_times, identity_of, mask_of, source_of
from rsflow.cli._sensors import FILES, add_ground, height_of, sensors_of

if TYPE_CHECKING:
    from rsflow._results.folder import ResultFolder
    from rsflow.capture import Frames
    from rsflow.extraction.filtered import Filtered

FILES_OF = {
    "csv": "velocity.csv",
    "trajectory": "trajectory.csv",
    "svg": "velocity.svg",
    "plot": "velocity.png",
    "parquet": "velocity.parquet",
    "filtered": "filtered.csv",
}

DESCRIPTION = """\
Measure how fast a camera travels over flat ground, and what the figures are worth.

Needs a calibrated camera (see 'rsflow calibrate') and the height over the ground: constant, or a log of heights or
ranges. Writes into the folder OUT:

  velocity.csv    a row a frame: frame,t_s,dt_s,vx_m_s,vy_m_s,vz_m_s, their deviations and covariances, height_m,
                  dx_px,dy_px (how far the picture went), n_points,status; velocity.parquet too with --parquet
  trajectory.csv  the path: x_m,y_m,z_m,heading_rad,distance_m, their deviations, the covariance of the place
  filtered.csv    with --filter: velocity, position, acceleration and heading by a Kalman filter over all frames
  velocity.svg    the velocity over time, with the band of its deviation
  velocity.png    the same with the speed over ground (needs matplotlib: pip install 'rsflow-motion[plot]')

Axes are the camera's: x right, y down the picture, z along the optical axis; with --mount the body's. A camera that
moves to its right has vx > 0 while the picture flows to the left. What cannot be measured is nan, with the reason in
the column status.

Logs are CSV files with times of their own (t_s, t_ms, t_us or t_ns), or tables of PX4's ulog2csv and ArduPilot's
mavlogdump.py as they are: see docs/how-to/sensor_logs.md.

examples:
  rsflow velocity flight.mp4 --camera cam.yaml --height 0.2
  rsflow velocity flight.mp4 --camera cam.yaml --range-csv ranges.csv --height-std 0.02 --rates gyro.csv -o out
  rsflow velocity flight.mp4 --camera cam.yaml --range-csv log_distance_sensor_0.csv --log-start 312.4 \\
      --rates log_sensor_combined_0.csv --attitude log_vehicle_attitude_0.csv --mount x-right
  rsflow velocity 'pictures/*.png' --times times.csv --camera cam.yaml --height-csv heights.csv --rates gyro.csv
  rsflow velocity 'pictures/*.png' --rate 30 --camera cam.yaml --height 0.2 --json
  rsflow velocity flight.mp4 --camera cam.yaml --height 0.2 --json-lines | while read line; do ...
  rsflow velocity flight.mp4 --camera cam.yaml --height 0.2 --mavlink px4:flow.tlog --ros2-bag bag    for autopilots
  rsflow velocity flight.mp4 --camera cam.yaml --height 0.2 --mask ground.png     without what goes with the camera
  rsflow velocity turn.mp4 --camera cam.yaml --check-scale --rates gyro.csv       are focal length, axes, times right?
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow velocity``."""
    parser.add_argument("source", metavar="SOURCE", help="video, folder or glob of pictures, camera number, URL")
    heights = add_ground(parser, required=True)
    parser.add_argument("-o", "--output", default=".", metavar="OUT", help="folder for the files (default: this one)")
    add_mask(parser)
    add_rate(parser)
    add_times(parser)
    add_range(parser)
    add_overwrite(parser)
    add_exports(parser)
    parser.add_argument(
        "--filter",
        type=float,
        metavar="M_S2",
        help="write filtered.csv too, by a Kalman filter: by how much accelerations change within a second (10: flown "
        "hard, 1: hovering, 0.1: a model on a table)",
    )
    parser.add_argument("--parquet", action="store_true", help="write velocity.parquet too")
    said = parser.add_mutually_exclusive_group()
    said.add_argument("--json", action="store_true", help="print a summary as JSON")
    said.add_argument("--json-lines", action="store_true", help="a JSON object a frame, the summary last")
    _check_scale.add_check_scale(parser, heights)


def run(args: argparse.Namespace) -> int:
    """Measure; with --check-scale find out what is wrong with the set-up."""
    if args.check_scale:
        return _check_scale.run(args)
    _check_scale.expect_none(args)
    return _measure(args)


def _measure(args: argparse.Namespace) -> int:
    """Measure, write the tables and the plots, print a summary."""
    import rsflow
    from rsflow.capture.masks import expect_size
    from rsflow.capture.too_few import too_few
    from rsflow.extraction.filtered import Filtered
    from rsflow.extraction.ground import Ground
    from rsflow.extraction.summary import as_json
    from rsflow.extraction.trajectory import Trajectory
    from rsflow.velocity.result import not_stated

    height_m = height_of(args)
    assert height_m is not None, "argparse wants one"
    ground = Ground(args.camera, height_m, args.height_std, sensors_of(args))
    mask = mask_of(args.mask)
    rows: list[dict[str, Any]] = []
    path: list[dict[str, Any]] = []
    trajectory, filtered = Trajectory(), Filtered(args.filter, constant_height=args.height is not None)
    budget, interrupted = "", False
    broken: rsflow.RsflowError | None = None
    source = source_of(args.source)
    with (
        rsflow.frames(
            source, frame_rate=args.rate, times=args.times, start=args.start, stop=args.stop, stride=args.stride
        ) as sequence,
        _folder(args, source, sequence) as result,
        exports(args, inputs=(source, *(getattr(args, name) for name in FILES)), overwrite=args.overwrite) as sent,
    ):
        ground.expect_some(sequence)
        try:
            for frame in sequence:
                if not ground.is_open:
                    if mask is not None:
                        expect_size(f"--mask {args.mask}", mask, (frame.image.shape[1], frame.image.shape[0]))
                    ground.open(sequence, None, mask)
                v, row = ground.update(frame)
                sent.write(v, **ground.known)
                filtered.add(v, frame.index, ground.known)
                path.append(trajectory.add(v, frame.index, **ground.attitude))
                rows.append(row)
                budget = v.budget() if v.valid else budget
                if args.json_lines:
                    print(json.dumps(as_json(row)), flush=True)
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
        missed = ground.missed()
        if missed is not None and broken is None:
            raise missed
        result.record()
        files, note = _write(args, rows, path, filtered)
        result.finish(list(files.values()))
    notes = [text for text in (*sequence.notes, *ground.notes, *ground.doubts(), not_stated(ground.unstated)) if text]
    summary = _summary(rows) | as_json(trajectory.figures()) | {"std_without": list(ground.unstated), "notes": notes}
    summary |= {"variance_shares": ground.shares.shares(), "gyro": ground.gyro()}
    summary |= sent.told()
    plot = files.get("plot", files["svg"])
    summary |= {"csv": str(files["csv"]), "trajectory": str(files["trajectory"]), "svg": str(files["svg"])}
    summary |= {"plot": str(plot), "parquet": str(files["parquet"]) if "parquet" in files else None}
    summary |= {"filtered": str(files["filtered"])} if "filtered" in files else {}
    if args.json or args.json_lines:
        print(json.dumps(summary, indent=2 if args.json else None))
    else:
        _show(summary, budget)
    for text in ground.gaps():
        print(f"rsflow velocity: {text}", file=sys.stderr)
    if note is not None:
        print(f"rsflow velocity: no {FILES_OF['plot']}: {note}", file=sys.stderr)
    if broken is not None:
        raise type(broken)(f"{broken}; {files['csv']} has the {len(rows)} frames before") from broken
    if interrupted:
        raise KeyboardInterrupt(f"interrupted after {len(rows)} frames; {files['csv']} has them")
    return 0


def _folder(args: argparse.Namespace, source: int | str, sequence: Frames) -> ResultFolder:
    """Find out whether the files may be written, before the work."""
    from rsflow._results.folder import ResultFolder
    from rsflow._results.inputs import Inputs
    from rsflow.capture.too_few import expect_range

    expect_range(sequence)
    folder = Path(args.output)
    asked = {"parquet": args.parquet, "filtered": args.filter is not None}
    names = [name for kind, name in FILES_OF.items() if asked.get(kind, True)]
    Inputs(source, files=[getattr(args, name) for name in FILES]).refuse([folder / name for name in names])
    identity = identity_of(source, args, files=FILES)
    return ResultFolder(folder, "velocity", list(FILES_OF.values()), identity, overwrite=args.overwrite)


def _write(
    args: argparse.Namespace, rows: list[dict[str, Any]], path: list[dict[str, Any]], filtered: Filtered
) -> tuple[dict[str, Path], str | None]:
    """Write the files; give them by kind, and what stands in the way of the plot as a sentence."""
    from rsflow.errors import MissingExtraError
    from rsflow.extraction.columns import TRAJECTORY, VELOCITY, WORDS
    from rsflow.extraction.report.velocity_plot import velocity_plot
    from rsflow.extraction.series import Series
    from rsflow.extraction.tables import CsvTable
    from rsflow.io.atomic import writing
    from rsflow.velocity import plot_velocity, write_velocity_csv, write_velocity_parquet

    files = {kind: Path(args.output) / name for kind, name in FILES_OF.items()}
    write_velocity_csv(files["csv"], rows)
    with CsvTable(files["trajectory"], tuple(TRAJECTORY)) as table:
        for row in path:
            table.append(row)
    series = Series(set(VELOCITY) - WORDS)
    for row in rows:
        series.append(row)
    with writing(files["svg"]) as partial:
        partial.write_text(velocity_plot(series, mounted=args.mount is not None).file(), encoding="utf-8")
    if not filtered.write(files["filtered"]):
        del files["filtered"]
    if args.parquet:
        write_velocity_parquet(files["parquet"], rows)
    else:
        del files["parquet"]
    try:
        plot_velocity(files["plot"], rows, title=str(args.source))
    except MissingExtraError as error:
        del files["plot"]
        return files, str(error)
    return files, None


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
    from rsflow.extraction.answers import way_text

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
    print(f"path   {summary['trajectory']}")
    print(f"plot   {summary['plot']}")
    if "filtered" in summary:
        print(f"filter {summary['filtered']}")
    for place in (summary.get("mavlink"), summary.get("ros2_bag")):
        if place is not None:
            print(f"sent   {place}: {summary['exported']} frames, {summary['exported_blind']} of them with quality 0")
