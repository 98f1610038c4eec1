"""How many processors this process may use: fewer than the machine has, in a container or bound to some of them."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from pathlib import Path

__all__ = ["processors", "quota"]

_ROOT = Path("/")


def processors() -> int:
    """Give the number of processors: those that this process is bound to, within the quota of its control group."""
    counted = getattr(os, "process_cpu_count", os.cpu_count)() or 1
    if hasattr(os, "sched_getaffinity"):
        counted = min(counted, len(os.sched_getaffinity(0)))
    limit = quota()
    return counted if limit is None else max(1, min(counted, math.ceil(limit)))


def quota(root: Path = _ROOT) -> float | None:
    """Give the processors that the control groups of this process allow, of Linux; None without a limit.

    Parameters
    ----------
    root : Path
        Where ``proc`` and ``sys`` are.
    """
    limits = [limit for folder, version in _groups(root) if (limit := _limit(folder, version)) is not None]
    return min(limits, default=None)


def _groups(root: Path) -> Iterator[tuple[Path, int]]:
    """Give the folder of each control group that may limit this process, its own and those above, with its version."""
    text = ""
    with contextlib.suppress(OSError):
        text = (root / "proc/self/cgroup").read_text()
    for line in text.splitlines():
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if controllers == "":
            mounts, version = ["sys/fs/cgroup", "sys/fs/cgroup/unified"], 2
        elif "cpu" in controllers.split(","):
            mounts, version = ["sys/fs/cgroup/cpu", "sys/fs/cgroup/cpu,cpuacct"], 1
        else:
            continue
        # Within a container its own group is the root of what is mounted, whatever the path says.
        own = Path(path.lstrip("/"))
        for mount in mounts:
            for part in (own, *own.parents):
                yield root / mount / part, version


def _limit(folder: Path, version: int) -> float | None:
    with contextlib.suppress(OSError, ValueError):
        if version == 2:
            quota_us, period_us = (folder / "cpu.max").read_text().split()
        else:
            quota_us = (folder / "cpu.cfs_quota_us").read_text()
            period_us = (folder / "cpu.cfs_period_us").read_text()
        if float(quota_us) > 0 and float(period_us) > 0:
            return float(quota_us) / float(period_us)
    return None
