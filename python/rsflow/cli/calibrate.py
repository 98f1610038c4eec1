"""``rsflow calibrate``: a camera from pictures of a board, or from a live camera."""

from __future__ import annotations

import argparse
import json
import math
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import add_overwrite, identity_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rsflow._results.folder import ResultFolder
    from rsflow.calibration.views import View

# A tilt of this makes a speed wrong by a thousandth at most, where it is not told.
_LEVEL_RAD = 0.03

DESCRIPTION = """\
Calibrate a camera from pictures of a chessboard or ChArUco board.

Print a board (--print-board draws one in its exact size), glue it to something flat, and take 15 or more pictures: near
and far, tilted by 20 to 45 degrees to every side, the board in each corner of the picture, focus and zoom as later in
use. What comes out is the camera file that `rsflow velocity` and `rsflow extract` need for metres per second, with the
deviation of each parameter, the error of each view, and advice on what to drop and what to add.

examples:
  rsflow calibrate --print-board board.pdf                          9x6 corners, squares of 25 mm, on A4
  rsflow calibrate 'pictures/*.jpg' --board 9x6 --square 0.025 -o camera.yaml
  rsflow calibrate board.mp4 --board 9x6 --square 0.025 -o camera.json --pictures corners
  rsflow calibrate 0 --board 9x6 --square 0.025 -o camera.yaml      live: says where to hold the board
  rsflow calibrate wide.mp4 --board 9x6 --square 0.025 --model fisheye -o camera.yaml
  rsflow calibrate floor.png --board 9x6 --square 0.025 --height-with camera.yaml     the board on the ground
  rsflow calibrate shots --pattern charuco --board 8x5 --square 0.03 --marker 0.022 -o camera.yaml

--board counts inner corners of a chessboard (10 x 7 squares have 9x6), squares of a ChArUco board."""


def board_size(text: str) -> tuple[int, int]:
    """Read ``9x6``."""
    parts = text.lower().replace("×", "x").replace(",", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected columns and rows, 9x6 say")
    return int(parts[0]), int(parts[1])


def length_m(text: str) -> float:
    """Read a length in metres."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a length in metres above 0, 0.025 say")
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "source",
        nargs="?",
        metavar="SOURCE",
        help="pictures (folder, glob, one of them), a video, a URL, or a camera's index",
    )
    parser.add_argument("more", nargs="*", help=argparse.SUPPRESS)
    parser.add_argument("--board", type=board_size, metavar="COLSxROWS", help="size of the board")
    parser.add_argument("--square", type=length_m, metavar="M", help="side of a square in metres")
    parser.add_argument("-o", "--output", metavar="FILE", help="camera file: .yaml (ROS), .yml/.xml (OpenCV), .json")
    parser.add_argument("--format", choices=("json", "opencv", "ros", "kalibr"), help="overrules the file's suffix")
    parser.add_argument("--pictures", metavar="DIR", help="write a picture of each view with its corners")
    add_overwrite(parser, where="DIR")
    parser.add_argument("--json", action="store_true", help="print the whole result as JSON")
    parser.add_argument("--pattern", choices=("chessboard", "charuco"), default="chessboard", help="what is printed")
    parser.add_argument("--marker", type=length_m, metavar="M", help="ChArUco: side of a marker in metres")
    parser.add_argument("--dictionary", default="DICT_4X4_50", metavar="NAME", help="ChArUco: ArUco dictionary")
    parser.add_argument("--legacy", action="store_true", help="ChArUco: board made by OpenCV before 4.6")
    parser.add_argument(
        "--model", choices=("pinhole", "fisheye"), default="pinhole", help="of the lens (default: pinhole)"
    )
    parser.add_argument(
        "--coefficients",
        type=int,
        choices=(0, 4, 5, 8, 12),
        help="distortion terms (default 5: k1 k2 p1 p2 k3; fisheye 4: k1 to k4)",
    )
    parser.add_argument("--square-pixels", action="store_true", help="hold fx = fy")
    parser.add_argument("--time-budget", type=float, default=120.0, metavar="S", help="for all searches (default 120)")
    parser.add_argument("--view-time-budget", type=float, default=5.0, metavar="S", help="for one picture (default 5)")
    parser.add_argument("--max-views", type=int, default=60, metavar="N", help="enough is enough (default 60)")
    parser.add_argument(
        "--print-board",
        metavar="FILE",
        help="draw the board on a page to be printed (.pdf, .svg or .png) and calibrate nothing; "
        "without --board and --square 9x6 and 0.025",
    )
    parser.add_argument(
        "--page", choices=("A4", "A3", "Letter"), help="of --print-board: size of the paper (default A4)"
    )
    parser.add_argument(
        "--height-with",
        metavar="CAMERA",
        help="calibrate nothing: measure with this camera file how high the camera is over the board of each picture",
    )
    parser.add_argument(
        "--square-std", type=length_m, metavar="M", help="with --height-with: standard deviation of a square's side"
    )


def check(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    """Leave with exit code 2 where arguments do not go together."""
    given = {"-o/--output": args.output, "--pictures": args.pictures, "--format": args.format}
    if args.print_board is not None:
        given |= {"SOURCE": args.source, "--height-with": args.height_with}
        _expect_alone(parser, "--print-board", given)
        return
    needed = {"SOURCE": args.source, "--board": args.board, "--square": args.square}
    missing = [name for name, value in needed.items() if value is None]
    if missing:
        parser.error(f"the following arguments are required: {', '.join(missing)}")
    if args.page is not None:
        parser.error("argument --page: not allowed without argument --print-board")
    if args.height_with is not None:
        _expect_alone(parser, "--height-with", given)
    elif args.square_std is not None:
        parser.error("argument --square-std: not allowed without argument --height-with")


def _expect_alone(parser: argparse.ArgumentParser, option: str, others: dict[str, object]) -> None:
    for name, value in others.items():
        if value is not None:
            parser.error(f"argument {name}: not allowed with argument {option}")


def run(args: argparse.Namespace) -> int:
    """Calibrate, print, and write what was asked for."""
    if args.print_board is not None:
        return _print_board(args)
    if args.height_with is not None:
        return _height(args)
    from rsflow.calibration import calibrate
    from rsflow.camera.formats import format_of
    from rsflow.capture import frames

    if args.output is not None:
        # Before the work, not after it.
        format_of(args.output, args.format)
    given = [args.source, *args.more] if args.more else args.source
    source = frames(given)
    folder = _writable(args, given)
    calibration = calibrate(
        source,
        board=args.board,
        square_size_m=args.square,
        pattern=args.pattern,
        marker_size_m=args.marker,
        dictionary=args.dictionary,
        legacy_pattern=args.legacy,
        model=args.model,
        coefficients=args.coefficients,
        square_pixels=args.square_pixels,
        time_budget_s=args.time_budget,
        view_time_budget_s=args.view_time_budget,
        max_views=args.max_views,
        on_view=_progress(source) if sys.stderr.isatty() or source.live else None,
    )
    if args.output is not None:
        calibration.save(args.output, format=args.format)
    pictures = []
    if folder is not None:
        with folder:
            folder.record()
            pictures = calibration.draw(args.pictures)
            folder.finish(pictures)
    if args.json:
        json.dump(calibration.to_dict(), sys.stdout, indent=2, allow_nan=False)
        print()
        return 0
    print("\n".join(_wrapped(line) for line in calibration.summary().splitlines()))
    if args.output is not None:
        print(f"wrote {args.output}")
    if pictures:
        print(f"wrote {len(pictures)} pictures to {Path(args.pictures)}")
    return 0


def _print_board(args: argparse.Namespace) -> int:
    """Draw the board, and say what to do with it."""
    from rsflow.calibration import print_board

    lines = print_board(
        args.print_board,
        board=args.board or (9, 6),
        square_size_m=args.square or 0.025,
        page=args.page or "A4",
        pattern=args.pattern,
        marker_size_m=args.marker,
        dictionary=args.dictionary,
        legacy_pattern=args.legacy,
    )
    if args.json:
        print(json.dumps({"file": args.print_board, "instructions": lines}, indent=2))
        return 0
    print("\n".join(lines))
    print(f"wrote {args.print_board}")
    return 0


def _height(args: argparse.Namespace) -> int:
    """Measure how high the camera is over the board of each picture."""
    import rsflow
    from rsflow.calibration import Board, height_over_board
    from rsflow.extraction.metric import fitting_camera

    board = Board(args.board, args.square, args.pattern, args.marker, args.dictionary, args.legacy)
    stated = rsflow.Camera.load(args.height_with)
    found = []
    with rsflow.frames([args.source, *args.more] if args.more else args.source) as sequence:
        for frame in sequence:
            camera, scaled = fitting_camera(stated, sequence, None)
            try:
                height = height_over_board(frame.image, camera, board=board, square_std_m=args.square_std)
            except rsflow.CalibrationError as error:
                print(f"rsflow calibrate: picture {frame.index}: {error}", file=sys.stderr)
                continue
            found.append((frame.index, height, scaled))
    if not found:
        raise rsflow.CalibrationError(f"{args.source}: no picture shows the board so that a height can be told")
    if args.json:
        rows = [{"picture": index, **height.to_dict(), "note": scaled} for index, height, scaled in found]
        json.dump(rows, sys.stdout, indent=2, allow_nan=False)
        print()
        return 0
    for index, height, scaled in found:
        print(f"picture {index}: {height}" + (f" ({scaled})" if scaled else ""))
    last = found[-1][1]
    std = "" if last.unstated else f" --height-std {last.height_std_m:.2g}"
    if "squares" in last.unstated:
        print("Say how well the squares are known: with --square-std; 0.2 mm over ten of them are 0.00002.")
    print(f"Over the board: add its thickness.\n"
          f"rsflow velocity SOURCE --camera {args.height_with} --height {last.height_m:.5g}{std}")  # fmt: skip
    if last.tilt_rad > _LEVEL_RAD:
        print(f"The camera is tilted: straight down is {', '.join(f'{value:.5f}' for value in last.down)} in its axes.")
    return 0


def _writable(args: argparse.Namespace, given: str | list[str]) -> ResultFolder | None:
    """Find out whether the files may be written, before the work; give the folder of the pictures."""
    from rsflow._results.folder import ResultFolder
    from rsflow._results.inputs import Inputs, expect_apart

    expect_apart({"-o": args.output, "--pictures": args.pictures})
    names = ("coverage.png", "*.corners.png")
    outputs = [] if args.output is None else [Path(args.output)]
    if args.pictures is not None:
        outputs += [Path(args.pictures) / names[0], *Path(args.pictures).glob(names[1])]
    Inputs(given).refuse(outputs)
    if args.pictures is None:
        return None
    identity = identity_of(given, args)
    return ResultFolder(Path(args.pictures), "calibrate", names, identity, overwrite=args.overwrite)


def _wrapped(line: str) -> str:
    if len(line) <= 120 or line.startswith(" "):
        return line
    return textwrap.fill(line, 118, subsequent_indent="  " if line.startswith("- ") else "")


def _progress(source: Any) -> Callable[[View, int], bool | None]:
    """Say of each view whether the board was found, and where it has not been yet."""
    import numpy as np

    from rsflow.calibration.figures import add_coverage
    from rsflow.calibration.report import empty_places

    counts: NDArray[np.int64] = np.zeros((6, 8), np.int64)

    def say(view: View, usable: int) -> None:
        if view.used:
            add_coverage(counts, view.corners, source.size)
        if source.live and not view.used:
            return
        places = empty_places(counts)
        hint = ""
        if source.live:
            hint = f"; hold the board in the {places[0]}" if places else "; tilt it, come nearer; Ctrl-C when done"
        result = f"{len(view.corners)} corners" if view.used else view.reason
        print(f"{view.name}: {result} ({usable} views){hint}", file=sys.stderr, flush=True)

    return say
