"""A soak: many frames through each streaming object; memory must stay flat, and no descriptor or thread be left.

    python .ci/soak.py [--frames 1000000] [--only NAME] [--jobs N] [--json FILE]

Each object has a process of its own, which says how much memory it holds after a twentieth of its frames (all
buffers, tables and caches are there by then) and at places between that and the end. It fails where one of the later
figures is more than 1 % above the first, or where there are more descriptors or threads at the end than at the first.
Frames are small and few, and come again and again, so that a million of them take minutes and not days.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import rsflow
from rsflow import synthetic

# What may be added to the memory after the first twentieth.
MARGIN = 0.01
PLACES = 10
SIZE = (40, 32)
DT_S = 1.0 / 30.0

Update = Callable[[np.ndarray, int], Any]


def frames() -> list[np.ndarray]:
    """Make a flight to and fro, so that the last frame and the first are neighbours, with something that moves."""
    width, height = SIZE
    camera = rsflow.Camera(width, width, (width - 1) / 2, (height - 1) / 2, width=width, height=height)
    flown = synthetic.flight_with_object(camera, frames=31, velocity_m_s=(0.1, 0.03, 0.0), seed=1)
    there = [frame.image for frame in flown]
    return there + there[-2:0:-1]


def objects() -> dict[str, Callable[[], Update]]:
    """Name -> what makes the object, as a function of frame and number."""
    width, height = SIZE
    camera = rsflow.Camera(width, width, (width - 1) / 2, (height - 1) / 2, width=width, height=height)

    def plain(made: Any) -> Update:
        return lambda image, number: made.update(image)

    def timed(made: Any) -> Update:
        return lambda image, number: made.update(image, number * DT_S)

    def seen(camera_motion: str) -> Update:
        segmenter = rsflow.MotionSegmenter(camera_motion=camera_motion)
        return lambda image, number: segmenter.update(image, t_s=number * DT_S).objects

    def filtered() -> Update:
        estimator, smooth = rsflow.VelocityEstimator(camera, height_m=0.2), rsflow.VelocityFilter()
        return lambda image, number: smooth.update(estimator.update(image, number * DT_S))

    return {
        "DenseFlow": lambda: plain(rsflow.DenseFlow(preset="fast")),
        "DenseFlow, covariance": lambda: plain(rsflow.DenseFlow(preset="balanced", covariance=True)),
        "PointTracker": lambda: plain(rsflow.PointTracker(max_corners=40)),
        "VelocityEstimator": lambda: timed(rsflow.VelocityEstimator(camera, height_m=0.2)),
        "VelocityFilter": filtered,
        "MotionSegmenter, static": lambda: seen("static"),
        "MotionSegmenter, moving": lambda: seen("moving"),
        "GridSequence": lambda: plain(rsflow.GridSequence(window_size=16, step=16)),
    }


def held() -> tuple[float, int, int]:
    """Memory in MB, descriptors and threads of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return (
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        sum(1 for _ in Path("/proc/self/fd").iterdir()),
        sum(1 for _ in Path("/proc/self/task").iterdir()),
    )


def endless(pictures: list[np.ndarray], count: int) -> Iterator[tuple[int, np.ndarray]]:
    """Give the pictures over and over, each with its number."""
    for number in range(count):
        yield number, pictures[number % len(pictures)]


def soak(name: str, count: int) -> dict[str, Any]:
    """Put `count` frames through one object; what the process held on the way."""
    pictures, update = frames(), objects()[name]()
    marks = {count * (2 * place + 1) // (2 * PLACES) for place in range(PLACES)} | {count - 1}
    memory, begin = [], time.process_time()
    first: tuple[float, int, int] | None = None
    for number, image in endless(pictures, count):
        update(image, number)
        if number in marks:
            now = held()
            first = first or now
            memory.append(round(now[0], 2))
    assert first is not None
    last = held()
    return {
        "object": name,
        "frames": count,
        "memory_mb": memory,
        "grown": max(memory) / memory[0] - 1.0,
        "descriptors": [first[1], last[1]],
        "threads": [first[2], last[2]],
        "ms_a_frame": 1e3 * (time.process_time() - begin) / count,
    }


def faults(found: dict[str, Any]) -> list[str]:
    """Say what is wrong with one object, a line each."""
    name, said = found["object"], []
    if found["grown"] > MARGIN:
        said.append(f"{name}: memory grew by {100 * found['grown']:.2f} %, expected at most {100 * MARGIN:g} %")
    for what in ("descriptors", "threads"):
        before, after = found[what]
        if after > before:
            said.append(f"{name}: {after} {what} at the end, {before} after the first twentieth")
    return said


def in_process(name: str, count: int) -> dict[str, Any]:
    """Soak one object in a process of its own."""
    run = [sys.executable, __file__, "--one", name, "--frames", str(count)]
    return dict(json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE, text=True).stdout))


def main() -> int:
    """Print a line an object; 1 where something grew or was left."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--only", choices=sorted(objects()), action="append")
    parser.add_argument("--jobs", type=int, default=1, help="objects at the same time (default 1)")
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.frames < 200:
        parser.error(f"--frames: got {args.frames}, expected at least 200")
    rsflow.set_num_threads(1)
    if args.one is not None:
        print(json.dumps(soak(args.one, args.frames)))
        return 0
    rows, wrong = [], []
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        for found in pool.map(lambda name: in_process(name, args.frames), args.only or list(objects())):
            rows.append(found)
            wrong += faults(found)
            least, most = min(found["memory_mb"]), max(found["memory_mb"])
            print(
                f"{found['object']:32s} {found['frames']} frames, {found['ms_a_frame']:.3f} ms each: "
                f"{least:.1f} to {most:.1f} MB ({100 * found['grown']:+.2f} %), "
                f"descriptors {found['descriptors'][1]}, threads {found['threads'][1]}",
                flush=True,
            )
    if args.json is not None:
        Path(args.json).write_text(json.dumps(rows, indent=1) + "\n")
    print("\n".join(wrong) or "flat")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
