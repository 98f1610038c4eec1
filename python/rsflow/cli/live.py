"""``rsflow live``: numbers from a running camera, a line a frame."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from typing import TYPE_CHECKING, Any

from rsflow.cli._export import add_exports, exports
from rsflow.cli._options import add_mask, add_max_displacement, add_overwrite, add_roi, source_of
from rsflow.cli._sensors import add_ground, height_of, sensors_of
from rsflow.errors import RsflowError

if TYPE_CHECKING:
    from rsflow.live import LiveReading

DESCRIPTION = """\
Measure while a camera runs: one line for each frame, always the newest one. With --camera and --height also the
velocity over the ground. Ctrl-C ends it.

examples:
  rsflow live                                          camera 0
  rsflow live 1 --camera cam.yaml --height 0.2         with metres per second
  rsflow live 0 --json | while read line; do ...       a JSON object a line, for a program
  rsflow live 0 --window                               with a picture; needs an OpenCV that has windows
  rsflow live 0 --camera cam.yaml --height 1 --mavlink px4:/dev/ttyUSB0,115200       to an autopilot
  rsflow live clip.mp4 --frames 20                     rehearse on a video

exit codes: 0 done (a video's end, --frames, --seconds), 1 failed, 2 wrong usage, 130 ended by Ctrl-C."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow live``."""
    parser.add_argument(
        "source", nargs="?", default="0", metavar="INDEX", help="camera number, stream URL or video (default 0)"
    )
    add_ground(parser)
    add_roi(parser)
    add_mask(parser)
    add_max_displacement(parser)
    parser.add_argument("--frames", type=int, metavar="N", help="end after N lines")
    parser.add_argument("--seconds", type=float, metavar="S", help="end after S seconds")
    parser.add_argument("--timeout", type=float, default=5.0, metavar="S", help="give up a silent camera (default 5 s)")
    parser.add_argument("--window", action="store_true", help="show the picture with the displacement as an arrow")
    add_exports(parser)
    add_overwrite(parser, where="the log or the bag")
    parser.add_argument("--json", "--json-lines", action="store_true", help="a JSON object a line")


def run(args: argparse.Namespace) -> int:
    """Print a line for each reading until the end."""
    from rsflow.live import readings

    window = _Window() if args.window else None
    stream = readings(
        source_of(args.source),
        camera=args.camera,
        height_m=height_of(args),
        height_std_m=args.height_std,
        sensors=sensors_of(args),
        roi=args.roi,
        mask=args.mask,
        max_displacement=args.max_displacement,
        timeout_s=args.timeout,
    )
    begin = time.monotonic()
    told: set[str] = set()
    with exports(args, overwrite=args.overwrite) as sent:
        try:
            for count, reading in enumerate(stream, 1):
                if reading.velocity is not None:
                    sent.write(reading.velocity, **reading.known)
                if count == 1 and not args.json:
                    print(_header(args.camera is not None))
                for note in () if args.json else reading.notes:
                    if note not in told:
                        print(f"note: {note}", file=sys.stderr)
                told.update(reading.notes)
                print(json.dumps(reading.to_dict()) if args.json else _line(reading), flush=True)
                if window is not None and not window.show(reading):
                    break
                if args.frames is not None and count >= args.frames:
                    break
                if args.seconds is not None and time.monotonic() - begin >= args.seconds:
                    break
        except (KeyboardInterrupt, RsflowError):
            # As it is ended, or a camera goes away: what was sent is kept.
            sent.close()
            raise
    return 0


def _header(with_velocity: bool) -> str:
    text = f"{'frame':>7} {'t_s':>10} {'dx_px':>9} {'dy_px':>9} {'std_px':>8}"
    return text + (f" {'vx_m_s':>9} {'vy_m_s':>9} {'vz_m_s':>9}" if with_velocity else "") + "  status"


def _line(reading: LiveReading) -> str:
    std = math.hypot(reading.dx_std_px, reading.dy_std_px) / math.sqrt(2.0)
    text = f"{reading.frame:>7} {reading.t_s:>10.3f} {reading.dx_px:>9.3f} {reading.dy_px:>9.3f} {std:>8.4f}"
    status = reading.status
    if reading.velocity_status is not None:
        text += "".join(f" {value:>9.4f}" for value in (reading.vx_m_s, reading.vy_m_s, reading.vz_m_s))
        if reading.velocity_status != "ok":
            status += f", velocity {reading.velocity_status}"
    return f"{text}  {status}"


class _Window:
    """A window with the picture and the displacement, ten times as long as it is; q or Escape closes it."""

    def __init__(self) -> None:
        import cv2

        from rsflow.cli.doctor import opencv_windows

        if opencv_windows() == "NONE":
            raise RsflowError(
                f"--window: the installed OpenCV {cv2.__version__} is headless and has no windows: leave --window "
                "away, or replace it: pip uninstall opencv-python-headless, then pip install opencv-python"
            )
        self._cv2: Any = cv2

    def show(self, reading: LiveReading) -> bool:
        from rsflow.plotting import quiver

        image = reading.image
        height, width = image.shape[:2]
        drawn = quiver(
            [[reading.dx_px, reading.dy_px]], picture=image, points=[[width / 2, height / 2]], scale=10.0, line_width=2
        )
        self._cv2.imshow("rsflow live", drawn)
        return self._cv2.waitKey(1) & 0xFF not in (27, ord("q"))
