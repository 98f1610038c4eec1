"""``rsflow flow``: where every pixel went, of two pictures or of a whole sequence."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsflow.cli._options import (
    add_illumination,
    add_max_displacement,
    add_overwrite,
    add_preset,
    add_range,
    add_rate,
    identity_of,
    mask_of,
    tell_notes,
    two_pictures,
)
from rsflow.errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rsflow.capture import Frame
    from rsflow.flow import DenseFlow, FlowField
    from rsflow.plotting import QuiverStyle

DESCRIPTION = """\
Measure where every pixel went: from PREV to NEXT, or from frame to frame of a SOURCE (a video, a folder or glob of
pictures, a camera's index, a URL).

examples:
  rsflow flow a.png b.png -o flow.flo               Middlebury's format
  rsflow flow a.png b.png -o kitti.png              KITTI's, 16 bits (.npy, .npz and .pfm are there as well)
  rsflow flow a.png b.png --picture arrows.svg      arrows over a.png, as vectors (.png and .jpg as pixels)
  rsflow flow a.png b.png --picture c.png --style color       Middlebury's colours, with their wheel
  rsflow flow a.png b.png --mask m.png --initial guess.flo -o flow.flo
  rsflow flow clip.mp4 --picture arrows.mp4         a video, with one scale for all of it
  rsflow flow clip.mp4 -o folder --format npz       a file for each pair: flow_000001.npz, with times

Motion is in pixels, x to the right and y down, at the pixels of the first picture of each pair."""

_STYLES = ("arrows", "color", "overlay")
# The scale of a clip is fitted to its first pairs.
_FITTED_PAIRS = 10
# The files of a sequence.
_FILES = "flow_[0-9][0-9][0-9][0-9][0-9][0-9]*.*"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("source", metavar="PREV|SOURCE", help="the first picture, or with nothing else a source")
    parser.add_argument("next", metavar="NEXT", nargs="?", help="the second picture, of the same size")
    parser.add_argument(
        "-o", "--output", metavar="FILE|FOLDER", help="where to write the flow: a file of a pair, a folder of a source"
    )
    parser.add_argument(
        "--format", choices=("flo", "png", "npy", "npz", "pfm"), help="of the files in the folder (flo)"
    )
    parser.add_argument("--picture", metavar="FILE", help="draw it: .png, .jpg or .svg of a pair, .mp4 of a source")
    parser.add_argument("--style", choices=_STYLES, default="arrows", help="how to draw it (arrows)")
    parser.add_argument("--step", type=int, metavar="PX", help="distance between arrows (a 40th of the width)")
    parser.add_argument("--scale", type=float, metavar="X", help="length of an arrow per pixel of motion (fitted)")
    parser.add_argument("--max-flow", type=float, metavar="PX", help="motion of full colour (fitted)")
    add_preset(parser, default="balanced")
    add_illumination(parser)
    add_max_displacement(parser, default="half the frame, along each axis")
    parser.add_argument("--initial", metavar="FILE", help="flow to start from, of the first pair: any flow file")
    parser.add_argument(
        "--mask", metavar="FILE", help="picture of the frames' size: what is black in it is not measured"
    )
    parser.add_argument(
        "--next-mask", metavar="FILE", help="the same of the second frame: what moves there is not valid"
    )
    add_range(parser, stride=None)
    add_rate(parser)
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print a line of JSON for each pair")


def run(args: argparse.Namespace) -> int:
    """Run the command: 0 done."""
    if args.picture and args.style != "arrows" and Path(args.picture).suffix.lower() == ".svg":
        raise OptionError(f"--style: got {args.style}, expected arrows: an .svg has arrows")
    if args.next is None:
        return _sequence(args)
    return _pair(args)


def _estimator(args: argparse.Namespace, size: tuple[int, int] | None) -> DenseFlow:
    from rsflow.flow import DenseFlow
    from rsflow.io.flow_files import read_flow

    return DenseFlow(
        preset=args.preset,
        illumination=args.illumination,
        max_displacement=args.max_displacement,
        initial=read_flow(args.initial) if args.initial else None,
        mask=mask_of(args.mask, size=size),
        next_mask=mask_of(args.next_mask, option="--next-mask", size=size),
    )


def _pair(args: argparse.Namespace) -> int:
    from rsflow._results.inputs import Inputs, expect_apart
    from rsflow.io.flow_files import expect_flow_name, write_flow
    from rsflow.plotting.drawing import expect_picture_name

    for name in ("start", "stop", "stride", "rate", "format"):
        if getattr(args, name) is not None:
            raise OptionError(f"--{name}: got one for two pictures, expected a source, which it is for")
    # What cannot be written is told before it is measured.
    if args.output:
        expect_flow_name(Path(args.output))
    if args.picture:
        expect_picture_name(Path(args.picture), vectors=args.style == "arrows")
    read = Inputs(files=(args.source, args.next, args.initial, args.mask, args.next_mask))
    read.refuse(path for path in (args.output, args.picture) if path)
    expect_apart({"-o": args.output, "--picture": args.picture})
    first, second = two_pictures(args.source, args.next, color=True)
    flow = _estimator(args, (first.image.shape[1], first.image.shape[0]))
    flow.update(first.image)
    field = flow.update(second.image)
    assert field is not None
    if args.output:
        write_flow(args.output, field)
    if args.picture:
        _draw(args, field, first, path=args.picture)
    print(_summary(field, 1, math.nan, math.nan, as_json=args.json))
    return 0


def _pairs(
    args: argparse.Namespace, source: Iterator[Frame], taken: list[int]
) -> Iterator[tuple[Frame, Frame, FlowField]]:
    """Measure pair after pair; `taken` counts the frames."""
    flow: DenseFlow | None = None
    before: Frame | None = None
    for frame in source:
        taken[0] += 1
        if flow is None:
            flow = _estimator(args, (frame.image.shape[1], frame.image.shape[0]))
        field = flow.update(frame.image)
        if field is not None and before is not None:
            yield before, frame, field
        before = frame


def _sequence(args: argparse.Namespace) -> int:
    from rsflow._results.folder import ResultFolder
    from rsflow.capture import frames
    from rsflow.capture.too_few import expect_range, too_few
    from rsflow.io.flow_files import FLOW_SUFFIXES, write_flow
    from rsflow.video import VideoWriter

    stride, suffix = 1 if args.stride is None else args.stride, args.format or "flo"
    if args.output:
        folder = Path(args.output)
        if folder.suffix.lower() in FLOW_SUFFIXES and not folder.is_dir():
            raise OptionError(
                f"-o: got {folder}, expected a folder, since a source has a flow for each pair; --format says which"
            )
    count = 0
    written: list[Path] = []
    taken = [0]
    with contextlib.ExitStack() as stack:
        source = stack.enter_context(
            frames(
                args.source,
                color=True,
                start=args.start,
                stop=args.stop,
                stride=stride,
                frame_rate=args.rate,
            )
        )
        stack.callback(tell_notes, "flow", source)
        expect_range(source)
        _refuse_inputs(args, suffix)
        result = None
        if args.output:
            identity = identity_of(args.source, args, files=("initial", "mask", "next_mask"))
            result = ResultFolder(Path(args.output), "flow", (_FILES,), identity, overwrite=args.overwrite)
            stack.enter_context(result)
        video = None
        if args.picture:
            rate = (source.frame_rate or 25.0) / stride
            video = stack.enter_context(VideoWriter(args.picture, frame_rate=rate))
        waiting: list[tuple[Frame, FlowField]] = []
        look: dict[str, Any] | None = None

        def drawn(all_of_them: bool) -> None:
            nonlocal look
            if video is None or not waiting or (look is None and not all_of_them and len(waiting) < _FITTED_PAIRS):
                return
            look = look or _fitted(args, [field for _, field in waiting])
            for frame, field in waiting:
                video.write(_draw(args, field, frame, **look), frame.t_s if math.isfinite(frame.t_s) else None)
            waiting.clear()

        try:
            for before, after, field in _pairs(args, source, taken):
                count += 1
                if result is not None:
                    result.record()
                    times = {} if math.isnan(before.t_s + after.t_s) else {"t0_s": before.t_s, "t1_s": after.t_s}
                    written.append(result.folder / f"flow_{after.index:06d}.{suffix}")
                    write_flow(written[-1], field, **times)
                if video is not None:
                    waiting.append((before, field))
                    drawn(all_of_them=False)
                print(_summary(field, after.index, before.t_s, after.t_s, as_json=args.json))
            drawn(all_of_them=True)
        except KeyboardInterrupt:
            # What is finished is kept.
            drawn(all_of_them=True)
            if video is not None:
                video.finish()
            raise
        if count == 0:
            raise too_few(source, taken[0])
        if result is not None:
            result.finish(written)
    return 0


def _refuse_inputs(args: argparse.Namespace, suffix: str) -> None:
    """Raise OptionError where a file would be written over that is read, or where the source would find it."""
    from rsflow._results.inputs import Inputs, expect_apart

    expect_apart({"-o": args.output, "--picture": args.picture})
    files = [Path(args.picture)] if args.picture else []
    if args.output:
        files += [Path(args.output) / f"flow_000000.{suffix}", *Path(args.output).glob(_FILES)]
    Inputs(args.source, files=(args.initial, args.mask, args.next_mask)).refuse(files)


def _fitted(args: argparse.Namespace, fields: list[FlowField]) -> dict[str, Any]:
    """Choose the scale of a clip once."""
    from rsflow.plotting import QuiverStyle, fitted_max_flow

    listed: list[Any] = list(fields)
    if args.style == "arrows":
        return {"style": QuiverStyle.fitted(listed, step=args.step, scale=args.scale)}
    return {"max_flow": args.max_flow or fitted_max_flow(listed)}


def _draw(
    args: argparse.Namespace,
    field: FlowField,
    frame: Frame,
    *,
    style: QuiverStyle | None = None,
    max_flow: float | None = None,
    path: str | None = None,
) -> np.ndarray[Any, np.dtype[np.uint8]]:
    from rsflow.plotting import flow_over_picture, flow_to_color, quiver

    picture = frame.image if frame.color is None else frame.color
    if args.style == "arrows":
        knobs = {} if style else {k: getattr(args, k) for k in ("step", "scale") if getattr(args, k) is not None}
        return quiver(field, picture=picture, style=style, path=path, **knobs)
    limit = max_flow or args.max_flow
    if args.style == "color":
        return flow_to_color(field, max_flow=limit, legend=True, path=path)
    return flow_over_picture(field, picture, max_flow=limit, path=path)


def _summary(field: FlowField, index: int, t0_s: float, t1_s: float, *, as_json: bool) -> str:
    known = field.uv[field.valid]
    share = float(field.valid.mean())
    mean = [float(n) for n in np.median(known, axis=0)] if len(known) else [math.nan, math.nan]
    largest = float(np.percentile(np.hypot(*known.T), 99)) if len(known) else math.nan
    if as_json:
        values = {"t0_s": t0_s, "t1_s": t1_s, "median_u_px": mean[0], "median_v_px": mean[1], "p99_px": largest}
        numbers = {name: value if math.isfinite(value) else None for name, value in values.items()}
        return json.dumps({"frame": index, **numbers, "valid_share": share})
    if not len(known):
        return f"frame {index}: nothing could be measured"
    return (
        f"frame {index}: median motion ({mean[0]:+.2f}, {mean[1]:+.2f}) px, 99 % below {largest:.2f} px, "
        f"{100 * share:.0f} % of the pixels valid"
    )
