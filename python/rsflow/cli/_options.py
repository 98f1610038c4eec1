"""Arguments that commands share, so that the same word means the same in each of them."""

from __future__ import annotations

import argparse
import math
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    # A parser, or a group of one.
    from argparse import _ActionsContainer as Arguments

    from rsflow._results.folder import Identity
    from rsflow.capture import Frame, Frames

__all__ = [
    "above_zero",
    "add_illumination",
    "add_mask",
    "add_max_displacement",
    "add_overwrite",
    "add_preset",
    "add_range",
    "add_rate",
    "add_roi",
    "add_times",
    "frame_count",
    "identity_of",
    "mask_of",
    "settle_range",
    "source_of",
    "tell_notes",
    "two_pictures",
]

# Options that do not change what a result is.
_ELSEWHERE = (
    *("source", "output", "json", "quiet", "overwrite", "resume", "picture", "pictures", "more"),
    *("mavlink", "ros2_bag", "forward"),
)


def tell_notes(command: str, source: Frames) -> None:
    """Say on standard error what is peculiar about a source, lost frames say, after it was read."""
    for note in source.notes:
        print(f"rsflow {command}: {note}", file=sys.stderr)


def source_of(text: str) -> int | str:
    """Give a camera's number as int, anything else as it is."""
    return int(text) if text.isdecimal() else text


def identity_of(source: Any, args: argparse.Namespace, *, files: tuple[str, ...] = ()) -> Identity:
    """Sum up what the results of a command are of: its source and its options, those in `files` by their content."""
    from rsflow._results.folder import Identity

    options = {name: value for name, value in vars(args).items() if name not in _ELSEWHERE}
    return Identity.of(source, options, files=files)


def add_mask(parser: Arguments) -> None:
    """Add --mask, of every frame."""
    parser.add_argument(
        "--mask",
        metavar="FILE",
        help="picture of the frames' size: what is black in it does not count in any frame, such as letters over the "
        "picture or a part of the own vehicle",
    )


def add_lines(parser: Arguments) -> None:
    """Add --line and --scale, of things that move."""
    parser.add_argument(
        "--line",
        action="append",
        type=line_of,
        default=[],
        metavar="X0,Y0,X1,Y1",
        help="count the things that cross this line, in pixels of the first frame; may be given again",
    )
    parser.add_argument(
        "--scale", type=above_zero, metavar="M_PER_PX", help="metres on the ground for each pixel: speeds in m/s too"
    )


def line_of(text: str) -> tuple[float, float, float, float]:
    """Read ``X0,Y0,X1,Y1``."""
    try:
        x0, y0, x1, y1 = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected four numbers X0,Y0,X1,Y1") from None
    if not all(map(math.isfinite, (x0, y0, x1, y1))) or (x0, y0) == (x1, y1):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected X0,Y0,X1,Y1: two ends at different places, in pixels")
    return x0, y0, x1, y1


def above_zero(text: str) -> float:
    """Read a number above 0, of an option that has no other check."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a number above 0")
    return value


def mask_of(path: str | None, *, option: str = "--mask", size: tuple[int, int] | None = None) -> Any:
    """Read the mask that an option names, held to the width and height of the frames where they are known."""
    from rsflow.capture.masks import expect_size, read_mask

    if path is None:
        return None
    mask = read_mask(path)
    expect_size(f"{option} {path}", mask, size)
    return mask


def two_pictures(prev: str, following: str, *, color: bool = False) -> tuple[Frame, Frame]:
    """Read the two pictures of a pair, of one size and type; anything else is refused by the name of its file."""
    from rsflow.capture import frames

    with frames([prev, following], color=color) as source:
        first, second = source
    return first, second


def add_overwrite(parser: Arguments, *, where: str = "OUT") -> None:
    """Add --overwrite; `where` names the folder that it is about."""
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help=f"replace what {where} holds of another source or of other settings",
    )


def add_range(parser: Arguments, *, stride: int | None = 1) -> None:
    """Add --start, --stop or --frames, and --stride; `stride` is what the last one is where it is not given."""
    parser.add_argument("--start", type=int, metavar="N", help="first frame (counted from 0)")
    end = parser.add_mutually_exclusive_group()
    end.add_argument("--stop", type=int, metavar="N", help="end before this frame (counted from 0)")
    end.add_argument("--frames", type=frame_count, metavar="N", help="end after N frames, as of rsflow live")
    parser.add_argument("--stride", type=int, default=stride, metavar="N", help="take every Nth frame (default: 1)")


def frame_count(text: str) -> int:
    """Read how many frames to take."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number of at least 1")
    return number


def settle_range(args: argparse.Namespace) -> None:
    """Make the stop of what `add_range` read as a number of frames: one range is one result, however it was given."""
    if not {"start", "stop", "stride", "frames"} <= vars(args).keys():
        return
    if args.frames is not None:
        args.stop = (args.start or 0) + args.frames * (args.stride or 1)
    del args.frames


def add_rate(parser: Arguments) -> None:
    """Add --rate."""
    parser.add_argument(
        "--rate", "--frame-rate", type=float, metavar="HZ", help="frames per second, for pictures or slow motion"
    )


def add_times(parser: Arguments) -> None:
    """Add --times, of each frame."""
    parser.add_argument(
        "--times", metavar="FILE", help="CSV with the time of each frame in t_s, t_ms, t_us or t_ns, for pictures"
    )


def add_roi(parser: Arguments, *, of: str = "only this part of the picture, in pixels") -> None:
    """Add --roi; `of` says what it is a region of."""
    parser.add_argument("--roi", type=_region, metavar="X,Y,W,H", help=of)


def _region(text: str) -> tuple[int, int, int, int]:
    try:
        x, y, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"got {text!r}, expected x,y,width,height in pixels, as 0,80,640,400"
        ) from None
    return x, y, width, height


def add_preset(parser: Arguments, *, default: str) -> None:
    """Add --preset, of dense flow."""
    parser.add_argument(
        "--preset",
        choices=("ultrafast", "fast", "balanced", "accurate"),
        default=default,
        help=f"of the dense flow (default: {default})",
    )


def add_camera_motion(parser: Arguments) -> None:
    """Add --camera-motion, where it may be left to the first frames."""
    parser.add_argument(
        "--camera-motion",
        choices=("auto", "moving", "static"),
        default="auto",
        help="does the camera move? (default auto: decided from the first frames)",
    )


def add_illumination(parser: Arguments) -> None:
    """Add --illumination."""
    parser.add_argument(
        "--illumination",
        choices=("none", "offset", "gain_offset"),
        default="gain_offset",
        help="how light may change between two frames (default: gain_offset)",
    )


def add_max_displacement(parser: Arguments, *, default: str = "") -> None:
    """Add --max-displacement; `default` says what it is otherwise, if that can be said."""
    parser.add_argument(
        "--max-displacement",
        type=float,
        metavar="PX",
        help="longest displacement from frame to frame to look for: longer ones are not sought, and none is valid"
        + (f" (default: {default})" if default else ""),
    )
