"""``rsflow doctor``: what is installed, whether it fits together, and whether it measures right."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import statistics
import sys
import time
from pathlib import Path
from typing import Any

from rsflow._extras import DISTRIBUTION

DESCRIPTION = """\
Say what is installed and whether it works: versions, processor level, threads, OpenCV wheels that overwrite each other
or this package, optional parts, and a self-test against a known motion, with times.

examples:
  rsflow doctor
  rsflow doctor --json | python -m json.tool

exit codes: 0 all is well, 1 something is wrong (the line begins with 'wrong')."""

# Another's program of the package index, which has the name of our import.
OTHER = "rsflow"

# The wheels that all install the folder cv2: the last one installed overwrites the others, and removing one breaks all.
CV2_WHEELS = (
    "opencv-python",
    "opencv-python-headless",
    "opencv-contrib-python",
    "opencv-contrib-python-headless",
)

# Extra -> (distribution it brings, what is missing without it).
EXTRAS = {
    "plot": ("matplotlib", "plots as PNG"),
    "yaml": ("PyYAML", "camera files in YAML"),
    "progress": ("tqdm", "the progress bar; a plain line stands in"),
    "video": ("av", "exact frame times and H.264 video that browsers play"),
    "parquet": ("pyarrow", "Parquet tables"),
    "dask": ("distributed", "batches on a Dask cluster"),
    "fsspec": ("fsspec", "videos and results in object storage"),
    "mavlink": ("pymavlink", "velocities for PX4 and ArduPilot"),
    "ros": ("rosbags", "ROS 2 bags"),
    "viewer": ("rerun-sdk", "`rsflow live` in the Rerun viewer"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``rsflow doctor``."""
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def _version(distribution: str) -> str | None:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def _other() -> dict[str, Any] | None:
    """Tell of the other distribution: its version, and what of ours it overwrites; None where it is not installed."""
    try:
        other = importlib.metadata.distribution(OTHER)
    except importlib.metadata.PackageNotFoundError:
        return None
    ours = Path(__file__).resolve().parent.parent
    shared = []
    if any(ours in Path(str(other.locate_file(path))).resolve().parents for path in other.files or ()):
        shared.append(f"the package in {ours}")
    if any(entry.name == "rsflow" for entry in other.entry_points.select(group="console_scripts")):
        shared.append("the command rsflow")
    return {"version": other.version, "overwrites": shared}


def _opencv() -> dict[str, Any]:
    """Which wheel of OpenCV stands here, from where, and whether several share one folder."""
    wheels = {name: version for name in CV2_WHEELS if (version := _version(name)) is not None}
    found: dict[str, Any] = {"wheels": wheels, "clash": len(wheels) > 1}
    try:
        import cv2

        found |= {
            "version": cv2.__version__,
            "path": str(cv2.__file__),
            "windows": opencv_windows() != "NONE",
            "threads": cv2.getNumThreads(),
        }
    except Exception as error:
        found["error"] = f"{type(error).__name__}: {error}"
    return found


def opencv_windows() -> str:
    """Name of the window system that OpenCV was built with; NONE in the headless wheels."""
    import cv2

    for line in cv2.getBuildInformation().splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "GUI":
            return value.strip() or "NONE"
    return "NONE"


def self_test() -> dict[str, Any]:
    """Measure a known motion by each estimator; give errors in pixels and median times in milliseconds."""
    import numpy as np

    import rsflow
    from rsflow import synthetic

    true = (3.25, -1.5)
    pair = synthetic.shifted_pair(*true, size=(320, 240), seed=1)
    prev, after = pair.prev, pair.next
    points = rsflow.detect_corners(prev, max_corners=200)

    def shift() -> tuple[float, float]:
        result = rsflow.estimate_shift(prev, after)
        return float(result.dx), float(result.dy)

    def dense() -> tuple[float, float]:
        field = rsflow.dense_flow(prev, after)
        u, v = np.median(field.uv[field.valid], axis=0)
        return float(u), float(v)

    def track() -> tuple[float, float]:
        tracks = rsflow.track_points(prev, after, points)
        u, v = np.median((tracks.points - points)[tracks.valid], axis=0)
        return float(u), float(v)

    checks: dict[str, Any] = {}
    for name, run in (("shift", shift), ("dense flow", dense), ("points", track)):
        times = []
        measured = (float("nan"), float("nan"))
        for _ in range(5):
            begin = time.perf_counter()
            measured = run()
            times.append(1000.0 * (time.perf_counter() - begin))
        error = float(np.hypot(measured[0] - true[0], measured[1] - true[1]))
        # A twentieth of a pixel is far above what any of the three leaves on this pair, far below a wrong answer.
        checks[name] = {"error_px": error, "time_ms": statistics.median(times), "passed": bool(error < 0.05)}
    return checks


def diagnosis() -> dict[str, Any]:
    """Collect everything that ``rsflow doctor`` prints.

    Returns
    -------
    dict
        Serialisable as JSON; ``wrong`` lists what must be mended, ``advice`` what could be better.
    """
    import rsflow

    build = dict(rsflow.build_info())
    opencv = _opencv()
    wrong: list[str] = []
    advice: list[str] = []
    if "error" in opencv:
        wrong.append(f"OpenCV cannot be imported ({opencv['error']}): pip install opencv-python-headless")
    elif opencv["clash"]:
        names = ", ".join(opencv["wheels"])
        wrong.append(
            f"{len(opencv['wheels'])} OpenCV wheels overwrite each other in one folder ({names}): "
            f"pip uninstall -y {' '.join(opencv['wheels'])}, then install one of them"
        )
    other = _other()
    if other is not None and other["overwrites"]:
        wrong.append(
            f"the distribution {OTHER} {other['version']} is not this program and overwrites "
            f"{' and '.join(other['overwrites'])}: pip uninstall -y {OTHER}, then "
            f"pip install --force-reinstall {DISTRIBUTION}"
        )
    elif other is not None:
        advice.append(f"the distribution {OTHER} {other['version']} is not this program, which is {DISTRIBUTION}")
    extras = {extra: _version(distribution) for extra, (distribution, _) in EXTRAS.items()}
    advice += [
        f"without {EXTRAS[extra][0]} there is no support for {EXTRAS[extra][1]}: pip install '{DISTRIBUTION}[{extra}]'"
        for extra, version in extras.items()
        if version is None
    ]
    test: dict[str, Any] = {}
    try:
        test = self_test()
        wrong += [
            f"self-test of {name}: off by {check['error_px']:.3f} px"
            for name, check in test.items()
            if not check["passed"]
        ]
    except Exception as error:
        wrong.append(f"self-test: {type(error).__name__}: {error}")
    return {
        "rsflow": rsflow.__version__,
        "distribution": {"name": DISTRIBUTION, "version": _version(DISTRIBUTION), "other": other},
        "build": build,
        "python": platform.python_version(),
        "executable": sys.executable,
        "system": platform.platform(),
        "processors": os.cpu_count(),
        "threads": rsflow.get_num_threads(),
        "numpy": _version("numpy"),
        "opencv": opencv,
        "extras": extras,
        "self_test": test,
        "wrong": wrong,
        "advice": advice,
    }


def _words(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def _print(found: dict[str, Any]) -> None:
    opencv = found["opencv"]
    wheels = ", ".join(f"{name} {version}" for name, version in opencv["wheels"].items()) or "no known wheel"
    windows = "with windows" if opencv.get("windows") else "without windows (headless)"
    rows = [
        ("rsflow", found["rsflow"]),
        ("distribution", f"{DISTRIBUTION} {found['distribution']['version'] or 'not installed: runs from a folder'}"),
        ("build", ", ".join(f"{key} {_words(value)}" for key, value in found["build"].items() if key != "version")),
        ("python", f"{found['python']}, {found['executable']}"),
        ("system", found["system"]),
        ("processors", f"{found['processors']}, rsflow uses {found['threads']} threads"),
        ("numpy", found["numpy"]),
        ("opencv", f"{opencv.get('version', 'not importable')} ({wheels}), {windows}"),
    ]
    rows += [
        (f"extra {extra}", f"{EXTRAS[extra][0]} {version or 'not installed'}")
        for extra, version in found["extras"].items()
    ]
    rows += [
        (f"test {name}", f"off by {check['error_px']:.4f} px, {check['time_ms']:.2f} ms for 320 x 240")
        for name, check in found["self_test"].items()
    ]
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:<{width}}  {value}")
    for line in found["advice"]:
        print(f"advice: {line}")
    for line in found["wrong"]:
        print(f"wrong: {line}")
    if not found["wrong"]:
        print("all is well")


def run(args: argparse.Namespace) -> int:
    """Print the diagnosis; 1 where something is wrong."""
    found = diagnosis()
    if args.json:
        print(json.dumps(found, indent=2))
    else:
        _print(found)
    return 1 if found["wrong"] else 0
