"""``rsflow velocity --check-scale``: what is wrong with a set-up, from a short clip."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import mask_of, source_of

if TYPE_CHECKING:
    from argparse import _MutuallyExclusiveGroup

__all__ = ["add_check_scale", "expect_none", "run"]

# Options that say what the clip is held against, besides --rates.
_KNOWN = ("known_speed", "known_distance", "known_velocity", "known_std")


class _CheckScale(argparse.Action):
    """A flag with which no height is needed."""

    def __init__(
        self, option_strings: Sequence[str], dest: str, *, heights: _MutuallyExclusiveGroup, help: str | None = None
    ) -> None:
        super().__init__(option_strings, dest, nargs=0, default=False, help=help)
        self._heights = heights

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Set the flag."""
        setattr(namespace, self.dest, True)
        self._heights.required = False


def add_check_scale(parser: argparse.ArgumentParser, heights: _MutuallyExclusiveGroup) -> None:
    """Add --check-scale and what it takes; `heights` are the options of which it needs none."""
    group = parser.add_argument_group("check of the set-up, in place of a measurement")
    group.add_argument(
        "--check-scale",
        action=_CheckScale,
        heights=heights,
        help="hold the clip against --rates (turning in place), or against a known speed, velocity or way at a known "
        "height: focal length, axes, mounting, delay, rolling shutter, and what is wrong in words",
    )
    known = group.add_mutually_exclusive_group()
    known.add_argument("--known-speed", type=float, metavar="M_S", help="constant speed over the ground")
    known.add_argument("--known-distance", type=float, metavar="M", help="length of the way of the whole clip")
    known.add_argument(
        "--known-velocity", metavar="FILE", help="CSV: t_s,vx_m_s,vy_m_s in the body's axes, or t_s,speed_m_s"
    )
    group.add_argument("--known-std", type=float, metavar="X", help="standard deviation of that, shared by all frames")


def expect_none(args: argparse.Namespace) -> None:
    """Refuse what only --check-scale takes."""
    from rsflow.errors import OptionError

    for name in _KNOWN:
        if getattr(args, name) is not None:
            option = f"--{name.replace('_', '-')}"
            raise OptionError(f"{option}: got {getattr(args, name)}, expected it together with --check-scale")


def run(args: argparse.Namespace) -> int:
    """Check the set-up and print what was found."""
    import rsflow
    from rsflow.capture.masks import expect_size
    from rsflow.capture.too_few import expect_range
    from rsflow.extraction.metric import fitting_camera
    from rsflow.extraction.summary import as_json
    from rsflow.velocity import mounting

    against = _against(args)
    mask = mask_of(args.mask)
    with rsflow.frames(
        source_of(args.source),
        frame_rate=args.rate,
        times=args.times,
        start=args.start,
        stop=args.stop,
        stride=args.stride,
    ) as clip:
        expect_range(clip)
        camera, note = fitting_camera(rsflow.Camera.load(args.camera), clip, None)
        if mask is not None:
            expect_size(f"--mask {args.mask}", mask, camera.size)
        check = rsflow.check_scale(
            clip,
            camera,
            **against,
            readout_s=args.readout or None,
            R_body_from_camera=None if args.mount is None else mounting(args.mount),
            mask=mask,
        )
        notes = [text for text in (note, *clip.notes) if text]
    if args.json or args.json_lines:
        row = check.to_dict() | {"findings": list(check.findings), "untold": list(check.untold), "notes": notes}
        print(json.dumps(as_json(row), indent=2 if args.json else None))
        return 0
    for text in notes:
        print(f"rsflow velocity: {text}", file=sys.stderr)
    print(check.report())
    return 0


def _against(args: argparse.Namespace) -> dict[str, Any]:
    """Give what the clip is held against, as `check_scale` takes it."""
    from rsflow.errors import OptionError
    from rsflow.velocity import Rates

    given = [name for name in ("rates", *_KNOWN[:3]) if getattr(args, name) is not None]
    names = "--rates, --known-speed, --known-distance, --known-velocity"
    if len(given) != 1:
        got = " and ".join(f"--{name.replace('_', '-')}" for name in given) if given else "--check-scale alone"
        raise OptionError(f"{names}: got {got}, expected one of them, to hold the clip against")
    # From the clock of the logs to that of the source.
    earlier = args.log_start + args.rate_delay
    if given == ["rates"]:
        rates = Rates.read(args.rates)
        return {"t_s": rates.t_s - earlier, "rate_rad_s": rates.rate_rad_s}
    found: dict[str, Any] = {"height_std_m": args.height_std, "known_std": args.known_std, **_height(args)}
    if given == ["known_speed"]:
        return found | {"speed_m_s": args.known_speed}
    if given == ["known_distance"]:
        return found | {"distance_m": args.known_distance}
    times, name, values = _series(args.known_velocity)
    return found | {"t_s": times - args.log_start, name: values}


def _height(args: argparse.Namespace) -> dict[str, Any]:
    from rsflow.errors import OptionError
    from rsflow.velocity import Heights

    if args.range_csv is not None:
        raise OptionError(f"--range-csv: got {args.range_csv}, expected --height or --height-csv with --check-scale")
    if args.height_csv is None:
        if args.height is None:
            raise OptionError(
                "--height: got none, expected the height over the ground, or --rates of a camera that turns"
            )
        return {"height_m": args.height}
    heights = Heights.read(args.height_csv)
    if heights.by != "t_s" or heights.kind != "height":
        raise OptionError(
            f"--height-csv: got {args.height_csv} with {heights.kind}s by {heights.by}, expected heights by t_s"
        )
    known = heights.height_m == heights.height_m
    return {"height_m": heights.height_m[known], "height_t_s": heights.keys[known] - args.log_start}


def _series(path: str) -> tuple[Any, str, Any]:
    """Read known velocities or speeds: times, which of them it is, values."""
    import numpy as np

    from rsflow.errors import FormatError
    from rsflow.io.time_series import TIME_COLUMNS, read_table

    columns = "one of t_s, t_ms, t_us, t_ns, and vx_m_s,vy_m_s or speed_m_s"
    table = read_table(path, columns=columns)
    clock = next((name for name in TIME_COLUMNS if name in table.names), None)
    names = [name for name in ("vx_m_s", "vy_m_s", "vz_m_s") if name in table.names]
    single = "speed_m_s" in table.names and len(names) < 2
    if clock is None or not (single or len(names) >= 2):
        raise FormatError(f"{path}: got the columns {', '.join(table.names)[:80]}, expected {columns}")
    times = table.times(table.names.index(clock), clock)
    if single:
        return times, "speed_m_s", table.numbers(table.names.index("speed_m_s"), "speed_m_s", empty=np.nan)
    values = [table.numbers(table.names.index(name), name, empty=np.nan) for name in names]
    return times, "velocity_m_s", np.column_stack(values)
