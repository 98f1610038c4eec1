"""``rsflow batch``: the main job over many sources."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import sys
from typing import Any

from rsflow.cli.extract import add_options, options

DESCRIPTION = """\
Extract from many sources at once, each into a folder of its own in OUT: on the processors of this machine, or on a Dask
cluster that is there (--scheduler). A source that fails does not stop the others; a table at the end says what became
of each, and OUT/index.html: what was not done and why, headline figures, links to the reports.

SOURCE is a video, a pattern, a folder of pictures, a folder with videos in it and below, a URL of storage that fsspec
knows (s3://, gs://, ...; so may be OUT), a camera's number or a URL.

A video of at least two parts (--part-frames) is cut into them: they are measured at once, and joined to what one run
gives: displacement, flow, velocity and path byte for byte. What moves (objects.csv; moving_share, objects, camera_* and
segmentation_status in motion.csv) is told from --overlap frames before each part: things keep their numbers over the
cuts, but the figures differ a little from those of one run, all the way through a part. --in-order measures the parts
one after the other, each with all that the one before knew: then everything is that of one run. Points (rsflow track)
and grids (rsflow grid) are no part of a batch.

Ctrl-C ends those at hand after the frame at hand and keeps what is finished, a second one ends them at once; with
--resume those go on that did not end, and parts that are done are not done again.

examples:
  rsflow batch clips/ 'more/*.mkv' -o out
  rsflow batch a.mp4 b.mp4 -o out --jobs 2 --camera cam.yaml --height 0.2
  rsflow batch s3://bucket/day1/ -o s3://bucket/motion --scheduler tcp://10.0.0.1:8786 --parquet
  rsflow batch clips/*.mp4 -o out --json > batch.json

exit codes: 0 all done, 1 at least one failed, 2 wrong usage, 130 interrupted."""

# Half an hour at 30 frames a second: shorter videos are one piece.
_PART_FRAMES = 54_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow batch``."""
    parser.add_argument(
        "sources", nargs="+", metavar="SOURCE", help="videos, folders, patterns, URLs of videos or of storage"
    )
    parser.add_argument(
        "-o", "--output", required=True, metavar="OUT", help="folder, or URL of storage, for the folders of the results"
    )
    where = parser.add_argument_group("where and how much at once")
    where.add_argument(
        "--jobs", type=int, metavar="N", help="processes (default: one for each processor that may be used)"
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster, as tcp://host:8786, or its scheduler file"
    )
    where.add_argument(
        "--part-frames",
        type=int,
        default=_PART_FRAMES,
        metavar="N",
        help=f"cut longer videos into parts of so many frames; 0: never (default: {_PART_FRAMES})",
    )
    where.add_argument(
        "--overlap",
        type=int,
        metavar="N",
        help="frames before a part from which what moves is told (default: 60)",
    )
    where.add_argument("--in-order", action="store_true", help="parts one after the other: all is that of one run")
    where.add_argument(
        "--retries", type=int, default=2, metavar="N", help="tries of a part whose process died (default: 2)"
    )
    add_options(parser)
    parser.add_argument("--parquet", action="store_true", help="tables as Parquet too, with a row group for each part")
    parser.add_argument("--json", action="store_true", help="a JSON array on standard output, an object a source")
    parser.add_argument("-q", "--quiet", action="store_true", help="no line a source while running, no progress")


def run(args: argparse.Namespace) -> int:
    """Extract from all; print the table."""
    from rsflow._extras import require
    from rsflow.batch import extract_many
    from rsflow.batch.cluster import cluster
    from rsflow.batch.places import found_sources
    from rsflow.cli._batch_progress import BatchProgress
    from rsflow.errors import OptionError

    if args.scheduler is not None and args.jobs is not None:
        raise OptionError("--jobs and --scheduler: got both, expected one of them: a cluster has its workers")
    if args.in_order and args.overlap is not None:
        raise OptionError("--in-order and --overlap: got both, expected one of them: parts in order do not overlap")
    if args.parquet:
        require("pyarrow", extra="parquet", purpose="writing Parquet")
    sources, notes = found_sources(args.sources)
    for note in notes:
        print(f"rsflow batch: {note}", file=sys.stderr)
    total = len(sources)
    how: dict[str, Any] = {
        "jobs": args.jobs,
        "part_frames": args.part_frames or None,
        "retries": args.retries,
        "parquet": args.parquet,
    }
    if args.in_order:
        how["overlap"] = None
    elif args.overlap is not None:
        how["overlap"] = args.overlap
    with contextlib.ExitStack() as stack:
        if args.scheduler is not None:
            how["executor"], how["at_once"] = stack.enter_context(cluster(args.scheduler))
        progress = stack.enter_context(BatchProgress(total, quiet=args.quiet))
        items = extract_many(
            sources, args.output, on_done=progress.ended, on_progress=progress.advanced, **how, **options(args)
        )
    if args.json:
        print(json.dumps([{**dataclasses.asdict(item), "folder": str(item.folder)} for item in items], indent=2))
    else:
        _table(items)
        print(f"look at {str(args.output).rstrip('/')}/index.html")
    if args.quiet:
        for item in items:
            if item.error:
                print(f"rsflow batch: {item.source}: {item.status}: {item.error}", file=sys.stderr)
    statuses = [item.status for item in items]
    if "cancelled" in statuses or any(item.error.startswith("interrupted") for item in items):
        counts = ", ".join(f"{statuses.count(name)} {name}" for name in dict.fromkeys(statuses))
        print(f"rsflow batch: interrupted: of {total} sources {counts}", file=sys.stderr)
        return 130
    return 0 if set(statuses) == {"done"} else 1


def _table(items: list) -> None:  # type: ignore[type-arg]
    """One line a source: status, frames, mean rate, folder."""
    rows = [("source", "status", "frames", "measured", "frames/s", "folder")]
    for item in items:
        summary = item.summary
        rows.append(
            (
                str(item.source),
                item.status,
                str(summary.get("frames", "-")),
                str(summary.get("measured", "-")),
                f"{summary['frames_per_second']:.1f}" if "frames_per_second" in summary else "-",
                str(item.folder),
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
