"""``rsflow extract``: the main job, from one source to tables, videos and a report page."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import (
    add_camera_motion,
    add_illumination,
    add_lines,
    add_mask,
    add_max_displacement,
    add_overwrite,
    add_preset,
    add_range,
    add_rate,
    add_roi,
    add_times,
    source_of,
)
from rsflow.cli._sensors import add_ground, height_of, sensors_of

if TYPE_CHECKING:
    from rsflow.extraction import Extraction

DESCRIPTION = """\
Extract the motion of one source, in one pass, into a folder:

  report.html     look here first: key figures, plots, the three videos, what was invalid and why
  motion.csv      a row a frame: displacement with its uncertainty, flow, light, share that moves, status
  objects.csv     a row for each moving thing in each frame
  flow.mp4        the picture with the motion as arrows
  moving.mp4      what moves;  static.mp4: what stands still, without what moves
  velocity.csv    with --camera and --height: the camera's velocity over the ground in m/s
  trajectory.csv  with both: the path that the camera travelled, in metres
  summary.json    the key figures for programs

SOURCE is a video, a folder or glob of pictures, a camera's number (stop with Ctrl-C) or a URL.

examples:
  rsflow extract clip.mp4 -o out
  rsflow extract clip.mp4 -o out --camera cam.yaml --height 0.2
  rsflow extract clip.mp4 -o out --camera cam.yaml --range-csv ranges.csv --height-std 0.02 --rates gyro.csv
  rsflow extract 'frames/*.png' -o out --rate 30
  rsflow extract clip.mp4 -o out --start 100 --stop 400 --roi 0,80,640,400
  rsflow extract clip.mp4 -o out --mask scene.png         black in scene.png: letters over the picture, own vehicle
  rsflow extract street.mp4 -o out --line 320,470,320,10 --scale 0.02     who crosses it, and speeds in m/s
  rsflow extract clip.mp4 -o out --json | python -c 'import json, sys; print(json.load(sys.stdin)["frames"])'

Ctrl-C stops after the frame at hand: what is finished is kept, named *.partial.*, with a report; the same command with
--resume goes on, also after a crash, and gives the tables of a run in one piece.

exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that `extract` and `batch` share."""
    metric = parser.add_argument_group("metres per second")
    add_ground(metric)
    part = parser.add_argument_group("part of the source")
    add_range(part)
    add_roi(part)
    add_mask(part)
    add_rate(part)
    add_lines(parser.add_argument_group("things that move"))
    how = parser.add_argument_group("how to measure")
    add_preset(how, default="fast")
    add_camera_motion(how)
    add_illumination(how)
    add_max_displacement(how)
    how.add_argument("--no-videos", action="store_true", help="tables and report only: faster")
    add_overwrite(parser)
    parser.add_argument(
        "--resume", action="store_true", help="go on with a run that was interrupted or killed; with none, begin"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow extract``."""
    parser.add_argument("source", metavar="SOURCE", help="video, folder or glob of pictures, camera number, URL")
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help="folder for the results; made if missing")
    add_options(parser)
    add_times(parser)
    parser.add_argument("--json", action="store_true", help="print summary.json on standard output")
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress bar, no closing lines")


def options(args: argparse.Namespace) -> dict[str, Any]:
    """Keyword arguments of `rsflow.extract` from the parsed options."""
    return {
        "camera": args.camera,
        "height_m": height_of(args),
        "height_std_m": args.height_std,
        "sensors": sensors_of(args),
        "start": args.start,
        "stop": args.stop,
        "stride": args.stride,
        "roi": args.roi,
        "mask": args.mask,
        "lines": args.line,
        "scale_m_per_px": args.scale,
        "frame_rate": args.rate,
        "preset": args.preset,
        "camera_motion": args.camera_motion,
        "illumination": args.illumination,
        "max_displacement": args.max_displacement,
        "videos": not args.no_videos,
        "overwrite": args.overwrite,
        "resume": args.resume,
    }


def show(extraction: Extraction, *, as_json: bool, quiet: bool) -> None:
    """Print the result of an extraction: JSON, or a few lines for people."""
    if as_json:
        print(json.dumps(extraction.summary, indent=2))
    elif not quiet:
        summary = extraction.summary
        for line in summary.get("answers", (summary["text"],)):
            print(line)
        for line in summary["notes"]:
            print(f"note: {line}")
        print(f"look at {extraction.files['report']}" if "report" in extraction.files else f"see {extraction.folder}")


def run(args: argparse.Namespace) -> int:
    """Extract; on failure or Ctrl-C still show what is kept."""
    from rsflow.extraction import ExtractionInterrupted, PartialExtractionError, extract

    try:
        extraction = extract(
            source_of(args.source),
            args.output,
            **options(args),
            times=args.times,
            progress=False if args.quiet else sys.stderr.isatty(),
        )
    except (ExtractionInterrupted, PartialExtractionError) as stop:
        show(stop.extraction, as_json=args.json, quiet=args.quiet)
        raise
    show(extraction, as_json=args.json, quiet=args.quiet)
    return 0
