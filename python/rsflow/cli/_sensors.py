"""Arguments for metres per second that commands share: camera, height, logs of sensors, clocks."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from argparse import _ActionsContainer as Arguments
    from argparse import _MutuallyExclusiveGroup

    from rsflow.velocity import Sensors

__all__ = ["FILES", "add_ground", "height_of", "sensors_of"]

# Options that are files: their content counts, and nothing is written over them.
FILES = ("camera", "height_csv", "range_csv", "rates", "attitude", "mask", "times")


def add_ground(parser: Arguments, *, required: bool = False) -> _MutuallyExclusiveGroup:
    """Add what a velocity over the ground needs; `required` where the command gives nothing else.

    Gives the options of the height, of which one is then required.
    """
    number: dict[str, Any] = {"type": float, "metavar": "S"}
    parser.add_argument(
        "--camera", metavar="FILE", required=required, help="calibrated camera: ROS, OpenCV, kalibr YAML or JSON"
    )
    height = parser.add_mutually_exclusive_group(required=required)
    height.add_argument("--height", type=float, metavar="M", help="perpendicular distance from the ground in metres")
    height.add_argument(
        "--height-csv", metavar="FILE", help="heights: columns t_s,height_m or frame,height_m, and height_std_m"
    )
    height.add_argument("--range-csv", metavar="FILE", help="distances along the optical axis instead: t_s,range_m")
    parser.add_argument(
        "--height-std", type=float, metavar="M", help="standard deviation of height or range, 0 where it is exact"
    )
    parser.add_argument("--rates", metavar="FILE", help="log of a gyro: t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s")
    parser.add_argument(
        "--rate-std",
        type=float,
        metavar="RAD_S",
        help="standard deviation of each axis of the rates",
    )
    parser.add_argument("--rate-delay", default=0.0, **number, help="how much later than it happened a rate is logged")
    parser.add_argument("--rate-delay-std", **number, help="standard deviation of that delay")
    parser.add_argument(
        "--attitude",
        metavar="FILE",
        help="log of attitudes: down_x,down_y,down_z or qw,qx,qy,qz or roll_rad,pitch_rad",
    )
    parser.add_argument(
        "--earth",
        choices=("ned", "enu"),
        default="ned",
        help="the earth's axes of quaternions (default ned)",
    )
    parser.add_argument("--down-std", type=float, metavar="RAD", help="standard deviation of where straight down is")
    parser.add_argument("--dt-std", **number, help="standard deviation of the time between two frames")
    parser.add_argument("--readout", **number, help="of a rolling shutter: time from first to last row")
    parser.add_argument("--max-height-gap", **number, help="how long to carry a height on by the pictures (default 1)")
    parser.add_argument("--max-speed", type=float, metavar="M_S", help="highest speed that is possible, over tiles say")
    parser.add_argument(
        "--mount",
        metavar="HOW",
        help="where the picture's axes point on the body: x-right for a camera that looks down, the top of its picture "
        "to the front; x-right,z-forward; yaw=90 in degrees; or 9 numbers, a rotation row by row",
    )
    parser.add_argument(
        "--log-start", default=0.0, **number, help="what the clock of the logs shows at the source's time 0"
    )
    return height


def height_of(args: argparse.Namespace) -> float | str | None:
    """Give the height or the file of heights or ranges, of the kind that its option says.

    Raises
    ------
    OptionError
        If the file has the other kind.
    """
    from rsflow.errors import OptionError

    for kind, path in (("height", args.height_csv), ("range", args.range_csv)):
        if path is not None:
            from rsflow.velocity import Heights

            found = Heights.read(path).kind
            if found != kind:
                raise OptionError(f"--{kind}-csv: got {path}, which has {found}s, expected {kind}s: use --{found}-csv")
            return str(path)
    return None if args.height is None else float(args.height)


def sensors_of(args: argparse.Namespace) -> Sensors | None:
    """Give what the options say of sensors; None where they say nothing."""
    from rsflow.velocity import Sensors

    sensors = Sensors(
        rates=args.rates,
        rate_std_rad_s=args.rate_std,
        rate_delay_s=args.rate_delay,
        rate_delay_std_s=args.rate_delay_std,
        attitude=args.attitude,
        earth=args.earth,
        down_std_rad=args.down_std,
        dt_std_s=args.dt_std,
        readout_s=args.readout,
        max_height_gap_s=args.max_height_gap,
        max_speed_m_s=args.max_speed,
        mount=args.mount,
        log_start_s=args.log_start,
    )
    nothing = Sensors()
    return None if vars(sensors) == vars(nothing) else sensors
