"""``rsflow batch``: the main job over many sources."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys

from rsflow.cli._options import source_of
from rsflow.cli.extract import add_options, options

DESCRIPTION = """\
Extract from many sources at once, each into a folder of its own in OUT, on a pool of processes. A source that fails
does not stop the others; a table at the end says what became of each. Ctrl-C ends those at hand after the frame at
hand and keeps what is finished, a second one ends them at once; with --resume those go on that did not end.

examples:
  rsflow batch clips/*.mp4 -o out
  rsflow batch a.mp4 b.mp4 -o out --jobs 2 --camera cam.yaml --height 0.2
  rsflow batch clips/*.mp4 -o out --json > batch.json

exit codes: 0 all done, 1 at least one failed, 2 wrong usage, 130 interrupted."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow batch``."""
    parser.add_argument("sources", nargs="+", metavar="SOURCE", help="videos, folders of pictures, URLs")
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help="folder for the folders of the results")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes (default: one a processor)")
    add_options(parser)
    parser.add_argument("--json", action="store_true", help="a JSON array on standard output, an object a source")
    parser.add_argument("-q", "--quiet", action="store_true", help="no line a source while running")


def run(args: argparse.Namespace) -> int:
    """Extract from all; print the table."""
    from rsflow.batch import BatchItem, extract_many

    total = len(args.sources)
    done = 0

    def report(item: BatchItem) -> None:
        nonlocal done
        done += 1
        if not args.quiet:
            print(
                f"[{done}/{total}] {item.source}: {item.status}{': ' if item.error else ''}{item.error}",
                file=sys.stderr,
            )

    items = extract_many(
        [source_of(text) for text in args.sources], args.output, jobs=args.jobs, on_done=report, **options(args)
    )
    if args.json:
        print(json.dumps([{**dataclasses.asdict(item), "folder": str(item.folder)} for item in items], indent=2))
    else:
        _table(items)
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
