"""``rsflow live``: figures from a running camera, seen in a viewer, recorded, in tables, or as lines."""

from __future__ import annotations

import argparse
import importlib.util
import json
import shutil
import sys
import time
from typing import TYPE_CHECKING, Any

from rsflow.cli._export import add_exports, exports
from rsflow.cli._live_lines import Lines, Status
from rsflow.cli._options import (
    above_zero,
    add_camera_motion,
    add_illumination,
    add_mask,
    add_max_displacement,
    add_overwrite,
    add_preset,
    add_rate,
    add_roi,
    frame_count,
    source_of,
)
from rsflow.cli._sensors import add_ground, height_of, sensors_of
from rsflow.errors import RsflowError

if TYPE_CHECKING:
    from rsflow.cli._export import Exports
    from rsflow.live import LiveFrame, LiveReading, LiveSummary

DESCRIPTION = """\
Measure while a camera runs, always its newest frame, and see it: the picture with arrows, what moves, things with their
paths and speeds, brightness and gain, how late the figures are; with --camera and --height also the velocity over the
ground. Ctrl-C ends it, with everything closed.

On a terminal of a machine with a screen a window opens (the viewer is an extra: pip install 'rsflow-motion[viewer]').
Elsewhere --serve shows the same in a browser, --record keeps it in a file, and -o keeps the tables; without any of
these it prints a line a frame.

examples:
  rsflow live                                          camera 0
  rsflow live 1 --camera cam.yaml --height 0.2         with metres per second
  rsflow live 0 --serve                                look at it in a browser of any machine, at port 9090
  rsflow live 0 --record run.rrd -o out                a recording for the viewer, and out/motion.csv, objects.csv
  rsflow live rtsp://host/stream --no-view             lines alone
  rsflow live 0 --json | while read line; do ...       a JSON object a line, for a program
  rsflow live 0 --window                               a plain picture; needs an OpenCV that has windows
  rsflow live 0 --camera cam.yaml --height 1 --mavlink px4:/dev/ttyUSB0,115200       to an autopilot
  rsflow live clip.mp4 --real-time                     rehearse on a video, at its own pace

exit codes: 0 done (a video's end, --frames, --seconds), 1 failed, 2 wrong usage, 130 ended by Ctrl-C."""

# How long a camera that went away is waited for.
_RECONNECT_S = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow live``."""
    parser.add_argument(
        "source", nargs="?", default="0", metavar="SOURCE", help="camera number, stream URL or video (default 0)"
    )
    seen = parser.add_argument_group("where it is seen and kept")
    seen.add_argument("--view", action="store_true", help="open the viewer's window (by default where there is one)")
    seen.add_argument("--no-view", action="store_true", help="open no window")
    seen.add_argument(
        "--serve",
        nargs="?",
        const=9090,
        type=_served,
        metavar="PORT",
        help="show it to browsers at this port (9090) and the next one; HOST:PORT listens to that address alone",
    )
    seen.add_argument("--record", metavar="FILE.rrd", help="record what is seen, for the viewer")
    seen.add_argument("-o", "--output", metavar="OUT", help="folder for motion.csv, objects.csv and velocity.csv")
    seen.add_argument(
        "--view-rate",
        type=above_zero,
        default=30.0,
        metavar="HZ",
        help="pictures a second to show, at most (default 30)",
    )
    seen.add_argument("--window", action="store_true", help="show the picture with the displacement as an arrow")
    seen.add_argument("--json", "--json-lines", action="store_true", help="a JSON object a line")
    add_overwrite(seen, where="OUT, the recording, the log or the bag")
    metric = parser.add_argument_group("metres per second")
    add_ground(metric)
    metric.add_argument("--scale", type=above_zero, metavar="M_PER_PX", help="metres for each pixel: things in m/s")
    how = parser.add_argument_group("how to measure")
    add_roi(how)
    add_mask(how)
    add_preset(how, default="fast")
    add_camera_motion(how)
    add_illumination(how)
    add_max_displacement(how)
    until = parser.add_argument_group("how long, and how patient")
    until.add_argument(
        "--frames",
        "--stop",
        type=frame_count,
        metavar="N",
        help="end after N lines, one for each frame after the first",
    )
    until.add_argument("--seconds", type=above_zero, metavar="S", help="end after S seconds")
    until.add_argument("--real-time", action="store_true", help="play a video at its own pace, as a camera would")
    add_rate(until)
    until.add_argument(
        "--timeout",
        type=float,
        metavar="S",
        help=f"give up a silent camera (default 5 s; {_RECONNECT_S:.0f} s for one that went away)",
    )
    add_exports(parser.add_argument_group("where it is sent"))


def _served(text: str) -> int | str:
    """Read ``PORT`` or ``HOST:PORT``."""
    port = text.rpartition(":")[2]
    if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65534) or text.startswith(":"):
        raise argparse.ArgumentTypeError(
            f"got {text!r}, expected a port from 1 to 65534, or HOST:PORT (the source stands before --serve)"
        )
    return int(text) if text == port else text


def check(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    """Say which options do not go together."""
    if args.view and args.no_view:
        parser.error("argument --no-view: not allowed with argument --view")
    if args.window and (args.view or args.serve is not None or args.record or args.output):
        parser.error("argument --window: not allowed with --view, --serve, --record or -o, which show more")


def run(args: argparse.Namespace) -> int:
    """Show and print readings until the end."""
    whole = args.view or args.serve is not None or args.record is not None or args.output is not None
    if not whole and _view_by_default(args):
        args.view = whole = True
    return _watch(args) if whole else _print(args)


def _view_by_default(args: argparse.Namespace) -> bool:
    """Whether a window is opened though nobody asked for one; where it cannot be, say what can be done."""
    if args.no_view or args.json or args.window or not sys.stdout.isatty():
        return False
    from rsflow.live.viewing.outputs import has_screen

    missing = importlib.util.find_spec("rerun") is None
    if missing or not has_screen():
        what = (
            "the viewer is not installed (pip install 'rsflow-motion[viewer]')"
            if missing
            else "no screen here: --serve shows it in a browser, --record FILE.rrd keeps it for the viewer"
        )
        print(f"note: {what}; lines instead (--no-view: without this note)", file=sys.stderr)
        return False
    return True


def _common(args: argparse.Namespace) -> dict[str, Any]:
    return {
        "camera": args.camera,
        "height_m": height_of(args),
        "height_std_m": args.height_std,
        "sensors": sensors_of(args),
        "roi": args.roi,
        "mask": args.mask,
        "illumination": args.illumination,
        "max_displacement": args.max_displacement,
        "timeout_s": 5.0 if args.timeout is None else args.timeout,
        "reconnect_s": _RECONNECT_S if args.timeout is None else args.timeout,
        "real_time": args.real_time,
        "frame_rate": args.rate,
    }


def _columns() -> int | None:
    """Width of the terminal that lines go to; None where they go elsewhere."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


class _Told:
    """Print readings as lines or as JSON, and each note once."""

    def __init__(self, args: argparse.Namespace) -> None:
        self._json = args.json
        self._lines = Lines(args.camera is not None, _columns())
        self._notes: set[str] = set()
        self._begun = False

    def notes(self, reading: LiveReading) -> None:
        """Print the notes that are new."""
        for note in () if self._json else reading.notes:
            if note not in self._notes:
                print(f"note: {note}", file=sys.stderr)
        self._notes.update(reading.notes)

    def line(self, reading: LiveReading) -> None:
        """Print the line of a reading."""
        if not self._begun and not self._json:
            print(self._lines.header())
        self._begun = True
        self.notes(reading)
        print(json.dumps(reading.to_dict()) if self._json else self._lines.line(reading), flush=True)


def _print(args: argparse.Namespace) -> int:
    """Displacement and velocity alone, a line a frame."""
    from rsflow.live import readings

    window = _Window() if args.window else None
    stream = readings(source_of(args.source), **_common(args))
    begin, told = time.monotonic(), _Told(args)
    with exports(args, overwrite=args.overwrite) as sent:
        try:
            for count, reading in enumerate(stream, 1):
                _send(sent, reading)
                told.line(reading)
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


def _send(sent: Exports, reading: LiveReading) -> None:
    if reading.velocity is not None:
        sent.write(reading.velocity, **reading.known)


def _watch(args: argparse.Namespace) -> int:
    """Every estimator, seen and kept."""
    from rsflow.live import watch

    told = _Told(args)
    status = Status() if sys.stdout.isatty() and sys.stderr.isatty() and not args.json else None
    source = f"camera {args.source}" if args.source.isdigit() else args.source

    def on_frame(frame: LiveFrame) -> None:
        if status is not None:
            status.frame = frame
        elif frame.reading is not None:
            told.line(frame.reading)
        if frame.reading is not None:
            _send(sent, frame.reading)

    seen_by: list[Any] = []
    noted: list[str] = []

    def on_open(showing: Any) -> None:
        seen_by.append(showing)
        if showing.pages:
            print(f"look at {' or '.join(showing.pages)}", file=sys.stderr, flush=True)

    def on_wait(waited_s: float) -> None:
        for note in seen_by[0].notes[len(noted) :]:
            if status is not None:
                status.end()
            print(f"note: {note}", file=sys.stderr, flush=True)
            noted.append(note)
        if status is not None:
            status.show(waited_s, source)

    with exports(args, overwrite=args.overwrite) as sent:
        try:
            summary = watch(
                source_of(args.source),
                **_common(args),
                scale_m_per_px=args.scale,
                preset=args.preset,
                camera_motion=args.camera_motion,
                view=args.view,
                serve=args.serve,
                record=args.record,
                out=args.output,
                overwrite=args.overwrite,
                view_rate_hz=args.view_rate,
                frames=args.frames,
                seconds=args.seconds,
                linger=True,
                on_frame=on_frame,
                on_wait=on_wait,
                on_open=on_open,
            )
        except BrokenPipeError:
            # Who read the lines went away: what was sent is kept.
            sent.close()
            raise
        except (KeyboardInterrupt, RsflowError):
            sent.close()
            raise
        finally:
            if status is not None:
                status.end()
    _tell(summary, noted)
    if summary.ended == "interrupted":
        raise KeyboardInterrupt("ended by Ctrl-C")
    return 0


def _tell(summary: LiveSummary, noted: list[str]) -> None:
    """Say on standard error what the run comes to, without the notes that were told already."""
    print(summary.text(), file=sys.stderr)
    for note in summary.notes:
        if note in noted:
            continue
        print(f"note: {note}", file=sys.stderr)
    if summary.files:
        print(f"see {', '.join(str(path) for path in summary.files.values())}", file=sys.stderr)
    if "recording" in summary.files:
        print(f"look at it with: rerun {summary.files['recording']}", file=sys.stderr)


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
