"""Whether the installed rsflow is whole: it measures a known motion, and its kernels use the CPU's wide instructions.

Needs numpy alone, so that it runs where OpenCV has no wheels.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import rsflow
from rsflow import synthetic

# Of a library with its kernels objdump shows thousands; of one without them, none or the few of the standard library.
LEAST = 1000
# What stands in the disassembly of each instruction set.
REGISTERS = {"x86_64": {"avx2": "%ymm", "avx512": "%zmm"}, "arm64": {"neon": ".4s"}}


def results() -> str:
    """Measure a known motion by each estimator; a digest of the results, bit by bit."""
    true = (3.25, -1.5)
    pair = synthetic.shifted_pair(*true, size=(320, 240), seed=1)
    shift = rsflow.estimate_shift(pair.prev, pair.next)
    field = rsflow.dense_flow(pair.prev, pair.next)
    points = rsflow.detect_corners(pair.prev, max_corners=200)
    tracks = rsflow.track_points(pair.prev, pair.next, points)
    measured = {
        "shift": (shift.dx, shift.dy),
        "dense flow": np.median(field.uv[field.valid], axis=0),
        "points": np.median((tracks.points - points)[tracks.valid], axis=0),
    }
    for name, found in measured.items():
        error = float(np.hypot(*np.subtract(found, true)))
        if not error < 0.05:
            raise SystemExit(f"{name}: off by {error:.3f} px, expected less than 0.05 px")
    digest = hashlib.sha256(np.array([shift.dx, shift.dy]).tobytes())
    for array in (field.uv, field.valid, points, tracks.points):
        digest.update(array.tobytes())
    return digest.hexdigest()


def instructions(library: Path) -> dict[str, int] | None:
    """How many lines of the disassembly name each set's registers; None where there is no disassembler."""
    tool = shutil.which("objdump") or shutil.which("llvm-objdump")
    machine = {"amd64": "x86_64", "aarch64": "arm64"}.get(platform.machine().lower(), platform.machine().lower())
    if tool is None or machine not in REGISTERS:
        return None
    counts = dict.fromkeys(REGISTERS[machine], 0)
    with subprocess.Popen([tool, "-d", str(library)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            for name, register in REGISTERS[machine].items():
                counts[name] += register in line
    if process.returncode:
        raise SystemExit(f"{tool} ended with {process.returncode}")
    return counts


def main() -> int:
    """Print what was found; raise SystemExit where something is missing."""
    if sys.argv[1:] == ["--results"]:
        print(results())
        return 0
    info = rsflow.build_info()
    print(info)
    if info["profile"] != "release":
        raise SystemExit(f"profile: got {info['profile']}, expected release")
    digests = {}
    for level in info["cpu_levels"]:
        run = [sys.executable, __file__, "--results"]
        digests[level] = subprocess.run(
            run, env=os.environ | {"RSFLOW_CPU": level}, check=True, capture_output=True, text=True
        ).stdout
    if len(set(digests.values())) != 1:
        raise SystemExit(f"the CPU levels give different bits: {digests}")
    print("same bits on", ", ".join(digests))
    counts = instructions(Path(rsflow._core.__file__))
    print("instructions:", counts if counts is not None else "no disassembler here")
    if counts is not None and min(counts.values()) < LEAST:
        raise SystemExit(f"instructions: got {counts}, expected at least {LEAST} of each set")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
