"""``rsflow grid``: displacement, strain and vorticity of windows on a grid, of two pictures or a sequence."""

from __future__ import annotations

import argparse
import csv
import json
import math
import re
import sys
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import (
    add_illumination,
    add_mask,
    add_max_displacement,
    add_overwrite,
    add_range,
    add_rate,
    identity_of,
    mask_of,
    source_of,
    tell_notes,
)

if TYPE_CHECKING:
    from rsflow.grid import Grid, GridProbes, GridSequence

DESCRIPTION = """\
Measure displacement, its gradient and their covariance on a grid of windows: particles in a fluid, speckle on a
material. Two pictures, or a sequence: each picture is compared with the one before (fluids), or with --reference first
with the first one (materials), with a new reference where the correlation falls. Writes into the folder OUT:

  grid_000001.csv   the grid of each pair, by the number of its newer picture: x, y, u, v, their deviations and
                    covariance, gradient, light, status; its first line says where the axes point (--format parquet,
                    txt, which OpenPIV reads, nc, vtu)
  grid_000001.png   a map with arrows, with --plot (needs rsflow-motion[plot])
  probes.csv        with --probe, --line or --extensometer: those places over time; and probes.png with --plot
  grids.csv         a row for each pair: how much of it was measured, medians of displacement, small strain, vorticity

examples:
  rsflow grid a.tif b.tif -o out
  rsflow grid a.tif b.tif -o out --shape quadratic --robust --scale 0.05mm/px --dt 1ms --y-up --plot vorticity
  rsflow grid 'load/*.tif' -o out --reference first --window 41 --step 10 --plot xx
  rsflow grid 'load/*.tif' -o out --reference first --polygon 120,80,900,80,900,700,120,700
  rsflow grid piv.mp4 -o out --stride 2 --format txt --y-up
"""

_SCALE_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
_TIME_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_FORMATS = ("csv", "parquet", "txt", "nc", "vtu")
_SUMMARY = (
    *("frame", "t_s", "nodes", "measured", "u_px", "v_px", "std_px", "strain_xx", "strain_yy", "strain_xy"),
    *("vorticity", "divergence", "correlation"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow grid``."""
    from rsflow.grid.plot import QUANTITIES

    parser.add_argument(
        "source", metavar="SOURCE", nargs="+", help="two pictures; or a video, folder, glob, camera, URL"
    )
    parser.add_argument("-o", "--output", default=".", metavar="OUT", help="folder for the files (default: this one)")
    parser.add_argument("--window", type=int, default=32, metavar="PX", help="side of the windows (default: 32)")
    parser.add_argument("--step", type=int, default=16, metavar="PX", help="from one node to the next (default: 16)")
    parser.add_argument(
        "--shape",
        choices=("translation", "affine", "quadratic"),
        default="affine",
        help="how the displacement may vary over a window (default: affine)",
    )
    parser.add_argument("--robust", action="store_true", help="pixels that do not follow the others lose their weight")
    parser.add_argument(
        "--reference",
        choices=("previous", "first"),
        default="previous",
        help="what each picture of a sequence is compared with (default: previous)",
    )
    add_illumination(parser)
    add_max_displacement(parser)
    add_mask(parser)
    parser.add_argument(
        "--polygon",
        action="append",
        metavar="X,Y,X,Y,X,Y",
        help="corners of what counts, in pixels, or a .json or .csv file of them; again for another part",
    )
    for option, ends, words in (
        ("--probe", "X,Y", "a place to follow over the pictures, in pixels"),
        ("--line", "X,Y,X,Y", "a line of places to follow, from end to end"),
        ("--extensometer", "X,Y,X,Y", "two places whose distance is followed"),
    ):
        kind = _place if option == "--probe" else _line
        parser.add_argument(option, type=kind, action="append", metavar=ends, help=f"{words}; again for another")
    parser.add_argument("--scale", type=_scale, metavar="0.05mm/px", help="length of a pixel: m, cm, mm, um or nm a px")
    parser.add_argument("--dt", type=_time, metavar="1ms", help="time from one picture to the next: s, ms, us or ns")
    parser.add_argument("--y-up", action="store_true", help="y and v run up in files, as in fluid mechanics; not down")
    parser.add_argument("--format", choices=_FORMATS, default="csv", help="of the grids (default: csv)")
    parser.add_argument(
        "--plot", choices=QUANTITIES, metavar="WHAT", help=f"a map for each pair: {', '.join(QUANTITIES)}"
    )
    add_rate(parser)
    add_range(parser)
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print a summary as JSON")


def _scale(text: str) -> float:
    """Take a length a pixel in metres."""
    return _quantity(text, _SCALE_M, "a length a pixel above 0, as 0.05mm/px", per="/px")


def _time(text: str) -> float:
    """Take a time in seconds."""
    return _quantity(text, _TIME_S, "a time above 0, as 1ms")


def _place(text: str) -> tuple[float, ...]:
    """Take x and y."""
    return _coordinates(text, 2)


def _line(text: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Take two places."""
    found = _coordinates(text, 4)
    if found[:2] == found[2:]:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected ends at different places")
    return found[:2], found[2:]


def _coordinates(text: str, count: int) -> tuple[float, ...]:
    try:
        found = tuple(float(word) for word in text.split(","))
    except ValueError:
        found = ()
    if len(found) != count or not all(abs(value) <= 1e5 for value in found):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected {count} numbers in pixels with commas between them")
    return found


def _quantity(text: str, units: dict[str, float], expected: str, *, per: str = "") -> float:
    found = re.fullmatch(r"([0-9.]+(?:e[-+]?[0-9]+)?) ?([a-z]+)", text.removesuffix(per).replace("µ", "u"))
    try:
        value = float(found[1]) * units[found[2]] if found else math.nan
    except (KeyError, ValueError):
        value = math.nan
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected {expected}")
    return value


def check(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    """Refuse more than two sources."""
    if len(args.source) > 2:
        parser.error(f"got {len(args.source)} sources, expected two pictures, or one sequence in quotes")


def run(args: argparse.Namespace) -> int:
    """Measure each pair, write its grid, print a summary."""
    import rsflow
    from rsflow._results.folder import ResultFolder
    from rsflow._results.inputs import Inputs
    from rsflow.capture.masks import expect_size, read_polygon
    from rsflow.capture.too_few import expect_range, too_few

    folder = Path(args.output)
    given: Any = source_of(args.source[0]) if len(args.source) == 1 else args.source
    mask = mask_of(args.mask)
    given_by = args.polygon or []
    args = argparse.Namespace(**{**vars(args), "polygon": [read_polygon(text) for text in given_by]})
    sequence = _sequence(args, mask)
    probes = _probes(args)
    table = folder / "grids.csv"
    rows: list[dict[str, Any]] = []
    statuses: Counter[str] = Counter()
    written: list[Path] = []
    frames, interrupted = 0, False
    with ExitStack() as stack:
        ranged = {"start": args.start, "stop": args.stop, "stride": args.stride, "frame_rate": args.rate}
        source = stack.enter_context(rsflow.frames(given, **ranged))
        stack.callback(tell_notes, "grid", source)
        expect_range(source)
        read = Inputs(None if isinstance(given, list) else given, files=(*args.source, args.mask, *given_by))
        read.refuse([table])
        identity = identity_of(given, args, files=("mask",))
        names = ("grids.csv", "grid_[0-9]*.*", "probes.csv", "probes.png")
        result = stack.enter_context(ResultFolder(folder, "grid", names, identity, overwrite=args.overwrite))
        before: Any = None
        try:
            for frame in source:
                if frames == 0:
                    _expect_within(args, frame.image.shape[::-1])
                if frames == 0 and mask is not None:
                    expect_size(f"--mask {args.mask}", mask, frame.image.shape[::-1])
                if frames == 0 and args.polygon:
                    sequence = _sequence(args, _drawn(args.polygon, mask, frame.image.shape[::-1]))
                frames += 1
                grid = sequence.update(frame.image)
                if grid is not None:
                    files = _files(args, folder, frame.index)
                    read.refuse(files)
                    result.record()
                    _write(args, grid, files, before)
                    written += files
                    time = _time_of(args, frame, frames)
                    if probes is not None:
                        probes.add(grid, time)
                    rows.append(_row(grid, frame.index, math.nan if time is None else time, y_up=args.y_up))
                    statuses.update(grid.status_names.ravel().tolist())
                if before is None or args.reference == "previous":
                    before = frame.image.copy()
        except KeyboardInterrupt:
            interrupted = True
        if frames < 2 and not interrupted:
            raise too_few(source, frames)
        result.record()
        _save_rows(table, rows)
        if probes is not None and rows:
            written += _save_probes(args, probes, folder, read)
        result.finish([table, *written])
    _tell(args, rows, statuses, table)
    if interrupted:
        print("rsflow grid: interrupted; what was measured until then is written", file=sys.stderr)
        return 130
    return 0


def _sequence(args: argparse.Namespace, mask: Any) -> GridSequence:
    from rsflow.grid import GridSequence

    return GridSequence(
        reference=args.reference,
        window_size=args.window,
        step=args.step,
        shape=args.shape,
        robust=args.robust,
        mask=mask,
        illumination=args.illumination,
        max_displacement=args.max_displacement,
        scale_m_px=args.scale,
        dt_s=args.dt,
    )


def _probes(args: argparse.Namespace) -> GridProbes | None:
    from rsflow.grid import GridProbes

    places = args.probe or [], args.line or [], args.extensometer or []
    return GridProbes(places[0], lines=places[1], extensometers=places[2]) if any(places) else None


def _expect_within(args: argparse.Namespace, size: tuple[int, int]) -> None:
    """Refuse windows that are larger than the frames, and places that are outside of them."""
    from rsflow.errors import OptionError

    frames = f"the frames, {size[0]} x {size[1]}"
    if args.window > min(size):
        raise OptionError(f"--window: got {args.window} pixels, expected windows that fit into {frames}")
    for option in ("probe", "line", "extensometer"):
        for given in getattr(args, option) or []:
            for x, y in [given] if option == "probe" else given:
                if not (-0.5 <= x <= size[0] - 0.5 and -0.5 <= y <= size[1] - 0.5):
                    raise OptionError(f"--{option}: got ({x:g}, {y:g}), expected a place within {frames}")


def _time_of(args: argparse.Namespace, frame: Any, frames: int) -> float | None:
    """Give the time of a picture; None where nothing says it, as of files without --dt or --rate."""
    if args.dt is not None:
        return float(args.dt * (frames - 1))
    return frame.t_s if math.isfinite(frame.t_s) else None


def _save_probes(args: argparse.Namespace, probes: GridProbes, folder: Path, read: Any) -> list[Path]:
    """Write places over time, and with --plot draw them: u where the map has no such quantity."""
    from rsflow.grid.probes import PROBE_QUANTITIES

    files = [folder / "probes.csv", *([folder / "probes.png"] if args.plot else [])]
    read.refuse(files)
    probes.save(files[0], y_up=args.y_up)
    if args.plot:
        probes.plot(args.plot if args.plot in PROBE_QUANTITIES else "u", path=files[1])
    return files


def _drawn(polygons: list[list[tuple[float, float]]], mask: Any, size: tuple[int, int]) -> Any:
    """Give what is in any of the polygons, and in the mask if there is one."""
    from functools import reduce

    from rsflow.capture.masks import polygon_mask

    inside = reduce(lambda a, b: a | b, (polygon_mask(corners, size) for corners in polygons))
    return inside if mask is None else inside & mask


def _files(args: argparse.Namespace, folder: Path, index: int) -> list[Path]:
    """Name the files of one pair: the grid, and its map."""
    stem = f"grid_{index:06d}"
    return [folder / f"{stem}.{args.format}", *([folder / f"{stem}.png"] if args.plot else [])]


def _write(args: argparse.Namespace, grid: Grid, files: list[Path], before: Any) -> None:
    grid.save(files[0], y_up=args.y_up)
    if args.plot:
        grid.plot(args.plot, picture=before, path=files[1])


def _row(grid: Grid, frame: int, t_s: float, *, y_up: bool) -> dict[str, Any]:
    """Sum up one pair in medians over what was measured."""
    import numpy as np

    sign = -1.0 if y_up else 1.0
    strain = grid.strain()
    valid = grid.valid

    def middle(values: Any) -> float:
        return float(np.median(values[valid])) if valid.any() else math.nan

    values = (
        *(frame, t_s, valid.size, int(valid.sum())),
        *(middle(grid.u), sign * middle(grid.v), middle(np.hypot(grid.std[..., 0], grid.std[..., 1]))),
        *(middle(strain.xx), middle(strain.yy), sign * middle(strain.xy)),
        *(sign * middle(grid.vorticity), middle(grid.divergence), middle(grid.correlation)),
    )
    return dict(zip(_SUMMARY, values, strict=True))


def _save_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    from rsflow.io.atomic import writing

    with writing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_SUMMARY)
        for row in rows:
            writer.writerow(f"{value:.7g}" if isinstance(value, float) else value for value in row.values())


def _tell(args: argparse.Namespace, rows: list[dict[str, Any]], statuses: Counter[str], table: Path) -> None:
    """Print what was measured, and why the rest was not."""
    from rsflow.grid import GridStatus

    nodes, measured = (sum(row[name] for row in rows) for name in ("nodes", "measured"))
    summary = {"pairs": len(rows), "nodes": nodes, "measured": measured, "table": str(table)}
    if args.json:
        print(json.dumps(summary))
        return
    print(f"{len(rows)} pair{'' if len(rows) == 1 else 's'}, {measured} of {nodes} nodes measured")
    for name, count in statuses.most_common():
        if not GridStatus[name].valid:
            print(f"  {count} {GridStatus[name].word}: {GridStatus[name].explanation}")
    print(table)
