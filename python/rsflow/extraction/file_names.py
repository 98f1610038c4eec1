"""Names of the files that an extraction leaves: of a complete run, and of one that was not."""

from __future__ import annotations

from pathlib import Path

__all__ = ["NAMES", "partial_name"]

# Every file that an extraction may leave, by what it holds.
NAMES = {
    "report": "report.html",
    "motion": "motion.csv",
    "objects": "objects.csv",
    "velocity": "velocity.csv",
    "trajectory": "trajectory.csv",
    "flow": "flow.mp4",
    "moving": "moving.mp4",
    "static": "static.mp4",
    "background": "background.png",
    "summary": "summary.json",
}


def partial_name(path: Path) -> Path:
    """Name under which the unfinished result for `path` is kept: ``motion.csv`` gives ``motion.partial.csv``."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")
