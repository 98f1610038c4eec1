"""``rsflow demo``: the main job on a made flight, held against the truth."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsflow.cli._options import add_overwrite

if TYPE_CHECKING:
    from rsflow.extraction import Measured
    from rsflow.synthetic import Flight

DESCRIPTION = """\
No input needed: make a flight over textured ground, with a thing that moves on it and light that changes; write it as a
video with its camera file; run the main job on them; compare what was measured with what is true.

examples:
  rsflow demo                      results in rsflow-demo
  rsflow demo -o out --json        the comparison for a program

Afterwards open report.html in the folder. The input stays beside it in input/, to try on:
  rsflow extract rsflow-demo/input/flight.avi -o again --camera rsflow-demo/input/camera.json --height 0.5

exit codes: 0 done, every figure as good as expected; 1 failed, or one is worse; 2 wrong usage; 130 interrupted."""

HEIGHT_M = 0.5
RATE_HZ = 30.0
FOCAL_PX = 330.0

# What the sensor's noise leaves, with room for other seeds: rms error in pixels, shares of the speed and of the way,
# and the median overlap of the moving mask.
EXPECTED = {
    "displacement": 0.01,
    "velocity": 0.002,
    "way": 0.002,
    "moving": 0.75,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``rsflow demo``."""
    parser.add_argument("-o", "--output", default="rsflow-demo", metavar="OUT", help="folder (default rsflow-demo)")
    parser.add_argument("--frames", type=_frames, default=90, metavar="N", help="length of the flight (default 90)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the ground and the noise (default 1)")
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def _frames(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 10:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number of at least 10")
    return number


def make_flight(frames: int, seed: int) -> Flight:
    """Make the flight: a closed loop at constant height, one thing that crosses, an exposure that drifts."""
    from rsflow import Camera, synthetic

    exact = dict.fromkeys(("fx", "fy", "cx", "cy"), 0.0)
    camera = Camera(FOCAL_PX, FOCAL_PX, 159.5, 119.5, width=320, height=240, std=exact)
    turn = 2 * np.pi * np.arange(frames - 1) / (frames - 1)
    velocity = np.stack([0.25 * np.cos(turn), 0.18 * np.sin(turn), np.zeros(frames - 1)], axis=1)
    thing = synthetic.MovingObject(center_m=(0.1, -0.1), size_m=(0.12, 0.09), velocity_m_s=(-0.1, 0.12))
    return synthetic.flight_with_object(
        camera,
        objects=[thing],
        frames=frames,
        rate_hz=RATE_HZ,
        height_m=HEIGHT_M,
        velocity_m_s=velocity,
        exposure_drift=synthetic.auto_exposure(0.15),
        lighting=synthetic.ramp(0.8, 1.2),
        seed=seed,
    )


class Comparison:
    """Gathers measured against true, frame by frame."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.displacement: list[tuple[float, float]] = []
        self.velocity: list[tuple[float, float]] = []
        self.overlap: list[float] = []

    def add(self, measured: Measured) -> None:
        """Take one frame of the extraction."""
        index = measured.frame.index
        if index == 0:
            return
        true = self.flight.flow(index)
        ground = self.flight.masks[index - 1] == 0
        row = measured.motion
        mean = true[ground & np.isfinite(true[..., 0])].mean(axis=0)
        self.displacement.append((row["dx_px"] - mean[0], row["dy_px"] - mean[1]))
        v = measured.velocity
        if v is not None:
            self.velocity.append(
                (v.vx_m_s - self.flight.velocity_m_s[index, 0], v.vy_m_s - self.flight.velocity_m_s[index, 1])
            )
        moving, thing = measured.segmentation.moving, self.flight.masks[index] > 0
        if thing.any():
            self.overlap.append(float((moving & thing).sum() / (moving | thing).sum()))

    def rows(self, summary: dict[str, Any]) -> list[dict[str, Any]]:
        """Give the table: what, unit, true, measured, error, and what is expected of it."""
        flight = self.flight
        true = flight.velocity_m_s[1:]
        speed = np.hypot(true[:, 0], true[:, 1])
        steps = np.diff(flight.t_s)
        way = float((speed * steps).sum())
        found = summary["distance_m"] if summary["distance_m"] is not None else float("nan")
        displacement, velocity = np.array(self.displacement), np.array(self.velocity)
        share = _rms(velocity) / float(np.sqrt((speed**2).mean()))
        return [
            _row("displacement a frame, rms error", "px", None, None, _rms(displacement), EXPECTED["displacement"]),
            _row("  measured frames", "", len(displacement), int(np.isfinite(displacement[:, 0]).sum()), None, None),
            _row("velocity, rms error", "m/s", None, None, _rms(velocity), share_of(speed, EXPECTED["velocity"])),
            _row("  the same, of the speed", "%", None, None, 100 * share, 100 * EXPECTED["velocity"]),
            _row("  median speed", "m/s", float(np.median(speed)), summary["speed_median_m_s"], None, None),
            _row(
                "way travelled",
                "m",
                way,
                found,
                abs(found - way),
                EXPECTED["way"] * way,
            ),
            _row(
                "moving mask, median overlap (IoU)", "", 1.0, float(np.median(self.overlap)), None, EXPECTED["moving"]
            ),
        ]


def share_of(speed: Any, share: float) -> float:
    """Give `share` of the root mean square speed, in m/s."""
    return share * float(np.sqrt((np.asarray(speed) ** 2).mean()))


def _rms(errors: Any) -> float:
    lengths = np.hypot(errors[:, 0], errors[:, 1])
    return float(np.sqrt(np.nanmean(lengths**2)))


def _row(
    what: str, unit: str, true: float | None, measured: float | None, error: float | None, expected: float | None
) -> dict[str, Any]:
    passed = True
    if expected is not None:
        passed = error <= expected if error is not None else measured is not None and measured >= expected
    return {
        "what": what, "unit": unit, "true": true, "measured": measured, "error": error, "expected": expected,
        "passed": bool(passed),
    }  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Make, extract, compare."""
    from rsflow._results.folder import Identity, ResultFolder
    from rsflow.extraction.file_names import NAMES

    identity = Identity.of([], {"frames": args.frames, "seed": args.seed})
    names = ("input/flight.avi", "input/camera.json", *NAMES.values())
    with ResultFolder(Path(args.output), "demo", names, identity, overwrite=args.overwrite) as folder:
        folder.record()
        return _made_and_measured(args, folder.folder)


def _made_and_measured(args: argparse.Namespace, folder: Path) -> int:
    from rsflow.extraction import extract

    entry = folder / "input"
    entry.mkdir(parents=True, exist_ok=True)
    watched = sys.stderr.isatty() and not args.json
    if watched:
        print("making the flight ...", file=sys.stderr)
    flight = make_flight(args.frames, args.seed)
    video, camera = entry / "flight.avi", entry / "camera.json"
    write_flight(flight, video, camera)
    comparison = Comparison(flight)
    done = extract(
        video,
        folder,
        camera=camera,
        height_m=HEIGHT_M,
        height_std_m=0.0,
        camera_motion="moving",
        overwrite=args.overwrite,
        progress=watched,
        on_frame=comparison.add,
    )
    rows = comparison.rows(done.summary)
    if args.json:
        print(json.dumps({"rows": rows, "report": str(done.files["report"]), "summary": done.summary}, indent=2))
    else:
        _print(rows, done.summary)
        print(f"\nlook at {done.files['report']}")
    return 0 if all(row["passed"] for row in rows) else 1


def write_flight(flight: Flight, video: Path, camera: Path) -> None:
    """Write the frames as a video without loss, and the camera as JSON.

    A video that loses detail, as H.264 does, costs more accuracy than all that is in the flight: 0.07 px a frame at
    high quality.
    """
    from rsflow.video import write_lossless

    write_lossless(video, flight.images, frame_rate=RATE_HZ)
    flight.camera.save(camera)


def _print(rows: list[dict[str, Any]], summary: dict[str, Any]) -> None:
    print(f"{summary['frames']} frames of a made flight at {summary['frames_per_second']:.1f} frames/s\n")
    header = ("", "unit", "true", "measured", "error", "expected")
    lines = [header]
    for row in rows:
        cells = [_number(row[name]) for name in ("true", "measured", "error")]
        sign = "" if row["expected"] is None else ("< " if row["error"] is not None else "> ")
        expected = sign + _number(row["expected"]) + ("" if row["passed"] else "  missed")
        lines.append((row["what"], row["unit"], *cells, expected))
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    for line in lines:
        print("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())


def _number(value: float | None) -> str:
    return "" if value is None else (str(value) if isinstance(value, int) else f"{value:.4g}")
