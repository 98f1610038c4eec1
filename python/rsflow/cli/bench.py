"""``rsflow bench``: accuracy and time beside OpenCV, on scenes with exact truth."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsflow.bench import Bench, ExtractBench, KindsBench, SegmentationBench, VelocityBench

    _Found = Bench | KindsBench | VelocityBench | SegmentationBench | ExtractBench

DESCRIPTION = """\
Measure accuracy and time of rsflow beside OpenCV, on made scenes whose motion is known exactly.

  dense flow     dense_flow in its three presets; OpenCV's DIS and Farneback
  points         track_points; OpenCV's calcOpticalFlowPyrLK
  displacement   estimate_shift; OpenCV's phaseCorrelate with a Hann window

All take turns in each round, with the same number of threads; times are medians. The error is the length of the
difference from the truth: of dense flow at every pixel that stays in the picture, of points over those for which the
method gives an answer ('answered' is their share).

With 'kinds': dense flow, points, displacement and grids by kind of motion, light, content, noise and overlays, beside
every rival that is installed (OpenCV, scikit-image, OpenPIV): median and 95 % of the error, the share that is answered,
the share that is 'wrong and sure' (said to hold, and off by more than half a pixel and by more than five of the
deviations that are stated), what is within two deviations, and times. Where a rival is ahead is said in words. It takes
some minutes.

With 'velocity': VelocityEstimator under each condition of a set-up (light, tilt, gyro, times, rolling shutter, own
vehicle, weak and repeating ground, heights), on flights whose velocity is known exactly. rms and bias are in percent of
the speed; 'valid' is the share of frames with a velocity, 'false' of those with one that is off by more than five
deviations and 2 %; 'within 1' and 'within 2' are shares within as many standard deviations. Then the time from frame to
velocity, by stage, beside goodFeaturesToTrack, calcOpticalFlowPyrLK and RANSAC. It takes some minutes.

With 'segmentation': MotionSegmenter beside OpenCV's MOG2 and KNN (GSOC and CNT where this OpenCV has them), stabilised
where the camera moves and with the best of several median filters, on kinds of clips whose masks are known exactly
(cameras, speeds, light, noise, shadows, boxes, nothing that moves). 'F' is of the pixels, 1 is perfect; 'false' is the
share of still pixels that are called moving, 'far' of those more than 3 pixels from every thing. It takes some minutes.

With 'extract': the whole job, rsflow extract with a camera and a height, on made flights of three sizes: time by the
clock and of all processors a frame, beside one dense flow of OpenCV's DIS (medium) of each; then the processor time of
its parts, each call on one thread.

examples:
  rsflow bench
  rsflow bench kinds --only "points" --only "stripes"
  rsflow bench velocity
  rsflow bench velocity --only "level" --only "rolling shutter" --flights 5
  rsflow bench segmentation --only "hand-held" --clips 4
  rsflow bench extract --threads 2
  rsflow bench --threads 4 --rounds 21
  rsflow bench --quick --json
  rsflow bench --update README.md"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow bench``."""
    parser.add_argument(
        "subject",
        nargs="?",
        choices=("kinds", "velocity", "segmentation", "extract"),
        help="what to measure (default: motion in pictures)",
    )
    parser.add_argument("--threads", type=int, metavar="N",
                        help="of rsflow and of OpenCV (default 1; extract: 2)")  # fmt: skip
    parser.add_argument(
        "--rounds",
        type=int,
        metavar="N",
        help="timed calls of each method (default 9; kinds and --quick: 3), or frames of each size (velocity: 60, "
        "extract: 150)",
    )
    parser.add_argument(
        "--only", metavar="NAME", action="append",
        help="kinds: subjects, groups or kinds whose name begins so; velocity: conditions, and no times; segmentation: "
        "kinds; may be given several times",
    )  # fmt: skip
    parser.add_argument("--flights", type=int, metavar="N", help="velocity: flights of each condition (default 3)")
    parser.add_argument("--clips", type=int, metavar="N", help="segmentation: clips of each kind (default 2)")
    parser.add_argument("--quick", action="store_true", help="smaller scenes and fewer pairs: a trial, not for quoting")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument(
        "--update", metavar="FILE",
        help="rewrite what stands between <!-- bench-start --> and <!-- bench-end --> in this Markdown file (kinds: "
        "<!-- kinds-start --> and -end; velocity: "
        "<!-- velocity-conditions-start --> and -end; segmentation: <!-- segmentation-kinds-start --> and -end; "
        "extract: <!-- extract-parts-start --> and -end)",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure, print, and rewrite the file if there is one."""
    from rsflow import bench
    from rsflow.io.atomic import writing

    marks = {
        "kinds": bench.KINDS_MARKS, "velocity": bench.VELOCITY_MARKS, "segmentation": bench.SEGMENTATION_MARKS,
        "extract": bench.EXTRACT_MARKS,
    }  # fmt: skip
    marks_of = marks.get(args.subject, (bench.BEGIN, bench.END))
    # Before the measuring: what is wrong with the file should not cost a minute.
    page = None if args.update is None else _read(args.update)
    if page is not None:
        bench.with_tables(page, None, name=args.update, marks=marks_of)
    _refuse_others(args)
    if args.threads is None:
        args.threads = 2 if args.subject == "extract" else 1
    measures: dict[str | None, Callable[[argparse.Namespace], _Found]] = {
        None: _motion, "kinds": _kinds, "velocity": _velocity, "segmentation": _segmentation, "extract": _extract,
    }  # fmt: skip
    found = measures[args.subject](args)
    if args.json:
        figures = asdict(found)
        rows = [row for part in figures.values() if isinstance(part, tuple) for row in part if isinstance(row, dict)]
        for row in rows:
            # JSON has no NaN.
            row.update({k: None for k, v in row.items() if isinstance(v, float) and not math.isfinite(v)})
        print(json.dumps(figures, indent=1))
    else:
        print(found.tables())
    if page is not None:
        with writing(args.update) as partial:
            partial.write_bytes(bench.with_tables(page, found, name=args.update, marks=marks_of).encode("utf-8"))
        print(f"{args.update}: tables rewritten", file=sys.stderr)
    return 0


# What each subject alone takes.
_OF = {"only": ("kinds", "velocity", "segmentation"), "flights": ("velocity",), "clips": ("segmentation",)}


def _refuse_others(args: argparse.Namespace) -> None:
    from rsflow.errors import OptionError

    for name, subjects in _OF.items():
        value = getattr(args, name)
        if value is not None and args.subject not in subjects:
            rest = " or ".join(subjects)
            raise OptionError(f"--{name}: got {value}, expected it with rsflow bench {rest} alone")


def _motion(args: argparse.Namespace) -> Bench:
    from rsflow import bench

    rounds = args.rounds if args.rounds is not None else 3 if args.quick else 9
    return bench.measure(threads=args.threads, rounds=rounds, quick=args.quick)


def _kinds(args: argparse.Namespace) -> KindsBench:
    from rsflow import bench

    rounds = 3 if args.rounds is None else args.rounds
    return bench.measure_kinds(only=args.only, rounds=rounds, threads=args.threads, quick=args.quick, progress=_told)


def _velocity(args: argparse.Namespace) -> VelocityBench:
    from rsflow import bench
    from rsflow.errors import OptionError

    if args.threads != 1:
        raise OptionError(f"--threads: got {args.threads}, expected 1: velocities are timed on one thread")
    rounds = args.rounds if args.rounds is not None else 0 if args.only else 60
    return bench.measure_velocity(
        only=args.only, flights=3 if args.flights is None else args.flights, rounds=rounds, quick=args.quick,
        progress=_told,
    )  # fmt: skip


def _segmentation(args: argparse.Namespace) -> SegmentationBench:
    from rsflow import bench
    from rsflow.errors import OptionError

    if args.rounds is not None:
        raise OptionError(f"--rounds: got {args.rounds}, expected it without segmentation: each frame is timed once")
    clips = 2 if args.clips is None else args.clips
    return bench.measure_segmentation(
        only=args.only, clips=clips, threads=args.threads, quick=args.quick, progress=_told
    )


def _extract(args: argparse.Namespace) -> ExtractBench:

    frames = 150 if args.rounds is None else args.rounds
    from rsflow.bench import extract_run

    return extract_run.measure_extract(threads=args.threads, frames=frames, quick=args.quick)


def _told(name: str) -> None:
    print(name, file=sys.stderr, flush=True)


def _read(path: str) -> str:
    from rsflow.io.limits import read_text

    return read_text(path)
