"""``rsflow bench``: accuracy and time beside OpenCV, on scenes with exact truth."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict

DESCRIPTION = """\
Measure accuracy and time of rsflow beside OpenCV, on made scenes whose motion is known exactly.

  dense flow     dense_flow in its three presets; OpenCV's DIS and Farneback
  points         track_points; OpenCV's calcOpticalFlowPyrLK
  displacement   estimate_shift; OpenCV's phaseCorrelate with a Hann window

All take turns in each round, with the same number of threads; times are medians. The error is the length of the
difference from the truth: of dense flow at every pixel that stays in the picture, of points over those for which the
method gives an answer ('answered' is their share).

examples:
  rsflow bench
  rsflow bench --threads 4 --rounds 21
  rsflow bench --quick --json
  rsflow bench --update README.md"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow bench``."""
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="of rsflow and of OpenCV (default 1)")
    parser.add_argument("--rounds", type=int, metavar="N", help="timed calls of each method (default 9; --quick: 3)")
    parser.add_argument("--quick", action="store_true", help="smaller scenes and fewer pairs: a trial, not for quoting")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument(
        "--update", metavar="FILE",
        help="rewrite what stands between <!-- bench-start --> and <!-- bench-end --> in this Markdown file",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure, print, and rewrite the file if there is one."""
    from rsflow import bench
    from rsflow.io.atomic import writing

    # Before the measuring: what is wrong with the file should not cost a minute.
    page = None if args.update is None else _read(args.update)
    if page is not None:
        bench.with_tables(page, None, name=args.update)
    rounds = args.rounds if args.rounds is not None else 3 if args.quick else 9
    found = bench.measure(threads=args.threads, rounds=rounds, quick=args.quick)
    if args.json:
        figures = asdict(found)
        for row in figures["rows"]:
            # JSON has no NaN.
            row.update({k: None for k, v in row.items() if isinstance(v, float) and not math.isfinite(v)})
        print(json.dumps(figures, indent=1))
    else:
        print(found.tables())
    if page is not None:
        with writing(args.update) as partial:
            partial.write_bytes(bench.with_tables(page, found, name=args.update).encode("utf-8"))
        print(f"{args.update}: tables rewritten", file=sys.stderr)
    return 0


def _read(path: str) -> str:
    from rsflow.io.limits import read_text

    return read_text(path)
