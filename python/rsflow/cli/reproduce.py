"""``rsflow reproduce``: the report's tables 4-1, 4-2 and 4-3 beside what rsflow measures."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import add_overwrite, identity_of

if TYPE_CHECKING:
    from rsflow.reproduce import RealMotion, SyntheticMotion

DESCRIPTION = """\
Repeat the experiments of the report that rsflow grew out of, and print its tables beside what rsflow measures.

  table 4-1   39 known displacements between 60 x 60 windows of a photograph, the second one brighter
  table 4-2   the same without compensating the light
  and more    steady light, a gain, a ramp, noise
  table 4-3   a webcam flown over the ground at 10 and 20 cm, 1 and 2 cm/s, 30 and 15 frames/s: rendered with known
              truth, with the lens, noise and drifting exposure of a webcam
  f           the focal length that the report's printed velocities follow from

Photographs are those that scikit-image ships (pip install 'rsflow-motion[reproduce]'), or your own; without either,
textures that rsflow makes.

examples:
  rsflow reproduce
  rsflow reproduce photo.jpg floor.png
  rsflow reproduce --json -o out
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow reproduce``."""
    parser.add_argument("pictures", metavar="PICTURE", nargs="*", help="photographs for tables 4-1 and 4-2")
    parser.add_argument("-o", "--output", metavar="OUT", help="folder for reproduce.txt and reproduce.json")
    parser.add_argument("--frames", type=int, default=8, metavar="N", help="frames of each flight (default 8)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of grounds, directions and noise (default 0)")
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(args: argparse.Namespace) -> int:
    """Measure and print."""
    from rsflow import reproduce
    from rsflow._results.folder import ResultFolder
    from rsflow._results.inputs import Inputs
    from rsflow.io.atomic import writing

    pictures, origin = _pictures(args.pictures)
    names = ("reproduce.txt", "reproduce.json")
    folder = None
    if args.output is not None:
        Inputs(args.pictures).refuse(Path(args.output) / name for name in names)
        identity = identity_of(args.pictures, args)
        folder = ResultFolder(Path(args.output), "reproduce", names, identity, overwrite=args.overwrite)
    progress = _progress if sys.stderr.isatty() else None
    tables = [reproduce.synthetic_motion(pictures, condition, seed=args.seed) for condition in reproduce.CONDITIONS]
    flights = reproduce.real_motion(frames=args.frames, seed=args.seed, progress=progress)
    text = "\n\n".join([
        _displacements(tables, origin), _conditions(tables), _focal_length(), _velocities(flights), _groups(flights)
    ])  # fmt: skip
    figures = json.dumps(_figures(tables, flights, origin), indent=1)
    print(figures if args.json else text)
    if folder is not None:
        with folder:
            folder.record()
            for name, content in zip(names, (text, figures), strict=True):
                with writing(folder.folder / name) as partial:
                    partial.write_text(content + "\n", encoding="utf-8")
    return 0


def _pictures(paths: list[str]) -> tuple[Mapping[str, Any], str]:
    """Find the pictures to crop windows from, and a sentence that says which they are."""
    from rsflow import reproduce
    from rsflow.errors import CaptureError, MissingExtraError

    if paths:
        import rsflow

        found = {}
        for path in paths:
            with rsflow.frames([path]) as source:
                found[Path(path).name] = next(iter(source)).image
        if not found:
            raise CaptureError(f"{paths}: no picture")
        return found, f"pictures: {', '.join(found)}"
    try:
        found = reproduce.photographs()
        return found, f"photographs of scikit-image: {', '.join(found)}"
    except MissingExtraError as error:
        return reproduce.textures(), f"textures of rsflow, not photographs: {error}"


def _progress(done: int, count: int) -> None:
    print(f"\rflights {done}/{count}", end="\n" if done == count else "", file=sys.stderr, flush=True)


def _displacements(tables: list[SyntheticMotion], origin: str) -> str:
    import numpy as np

    compensated, plain = tables[0], tables[1]
    lines = [
        "Tables 4-1 and 4-2: known displacements of a 60 x 60 window, the second one brighter; pixels",
        f"({origin};",
        " rsflow: mean over the pictures and largest error; '-': none of the pictures gave a valid displacement)",
        "",
        f"{'':10}{'with compensation of the light':^46}{'without (illumination=none)':^46}".rstrip(),
        f"{'actual':>10}" + 2 * f"{'report 4-x':>18}{'rsflow':>18}{'error':>10}",
    ]
    lines[-1] = lines[-1].replace("4-x", "4-1", 1).replace("4-x", "4-2", 1)
    for j, (dx, dy) in enumerate(compensated.actual_px):
        line = f"{f'{dx:.0f}, {dy:.0f}':>10}"
        for table in (compensated, plain):
            printed = np.full(2, np.nan) if table.report_px is None else table.report_px[j]
            known = np.isfinite(table.measured_px[:, j, 0])
            line += f"{_pair(printed):>18}"
            line += f"{_pair(table.measured_px[known, j].mean(axis=0) if known.any() else printed * np.nan):>18}"
            line += f"{table.errors_px[known, j].max():10.4f}" if known.any() else f"{'-':>10}"
        lines.append(line)
    return "\n".join(lines)


def _pair(values: Any) -> str:
    # Adding zero turns -0.0 into 0.0.
    return "-" if values[0] != values[0] else ", ".join(f"{round(float(value), 4) + 0.0:.4f}" for value in values)


def _conditions(tables: list[SyntheticMotion]) -> str:
    import numpy as np

    lines = [
        "The same 39 displacements in other light: length of the error in pixels",
        f"{'condition':<28}{'measured':>12}{'median':>10}{'largest':>10}{'report: median':>18}{'largest':>10}",
    ]
    for table in tables:
        error = table.errors_px[np.isfinite(table.errors_px)]
        line = f"{table.condition:<28}{f'{error.size}/{table.errors_px.size}':>12}"
        line += f"{np.median(error):10.4f}{error.max():10.4f}" if error.size else f"{'-':>10}{'-':>10}"
        known = table.report_errors_px[np.isfinite(table.report_errors_px)]
        line += f"{np.median(known):18.4f}{known.max():10.4f}" if known.size else ""
        lines.append(line)
    return "\n".join(lines)


def _focal_length() -> str:
    from rsflow.reproduce import implied_focal_length

    f = implied_focal_length()
    return "\n".join([
        "The report's velocities follow from its equation 2.11, V = height x flow x frame rate / f. Solved for f,",
        f"its 24 rows give f = {f.mean_px:.1f} px, the same in each: they lie between {f.rows_px.min():.2f} and "
        f"{f.rows_px.max():.2f}, deviation {f.spread_px:.2f} px.",
        f"Its calibration says {f.calibrated_px:.1f} px at 640 x 480, so {f.calibrated_px * 176 / 640:.1f} px "
        "at the 176 x 144 of table 4-3 if these",
        f"are resized, {f.calibrated_px:.1f} px if they are cropped. With {f.calibrated_px:.1f} px the printed "
        f"velocities would be {f.mean_px / f.calibrated_px:.2f} times as large.",
    ])  # fmt: skip


def _velocities(rows: tuple[RealMotion, ...]) -> str:
    from rsflow.reproduce import implied_focal_length

    f = implied_focal_length().mean_px
    lines = [
        f"Table 4-3: flights over flat ground; the report flew a webcam, rsflow a rendered one with f = {f:.1f} px, so",
        "that the flow is as long as the report's. rsflow: in the report's 60 x 60 window, and in the whole 176 x 144",
        "",
        f"{'cm':>4}{'1/s':>5}{'cm/s':>6}{'flow, px':>10}{'report':>9}{'window':>9}{'frame':>9}"
        f"{'V, cm/s: report':>18}{'error':>9}{'window':>9}{'error':>9}{'frame':>9}{'error':>9}",
    ]
    lines += [
        f"{row.height_cm:4.0f}{row.frames_per_second:5.0f}{row.actual_cm_s:6.0f}{row.true_flow_px:10.3f}"
        f"{row.report_flow_px:9.3f}{row.window_flow_px:9.3f}{row.frame_flow_px:9.3f}{row.report_cm_s:18.4f}"
        f"{100 * row.report_error:8.2f}%{row.window_cm_s:9.4f}{100 * row.window_error:8.2f}%"
        f"{row.frame_cm_s:9.4f}{100 * row.frame_error:8.2f}%"
        for row in rows
    ]
    return "\n".join(lines)


def _groups(rows: tuple[RealMotion, ...]) -> str:
    from rsflow.reproduce import groups

    lines = [
        "Mean of the three runs, as in the last columns of table 4-3 (the report prints the errors at 2 cm/s only)",
        f"{'cm':>4}{'1/s':>5}{'cm/s':>6}{'error: report':>15}{'window':>10}{'frame':>10}",
    ]
    lines += [
        f"{g.height_cm:4.0f}{g.frames_per_second:5.0f}{g.actual_cm_s:6.0f}{100 * abs(g.report_error):14.2f}%"
        f"{100 * abs(g.window_error):9.2f}%{100 * abs(g.frame_error):9.2f}%"
        for g in groups(rows)
    ]
    worst = [max(abs(getattr(r, name)) for r in rows) for name in ("report_error", "window_error", "frame_error")]
    lines.append(f"largest in any row: report {100 * worst[0]:.2f} %, window {100 * worst[1]:.2f} %, "
                 f"frame {100 * worst[2]:.2f} %")  # fmt: skip
    lines.append(
        f"largest error vector of a single pair of frames: window {100 * max(r.window_worst for r in rows):.2f} %, "
        f"frame {100 * max(r.frame_worst for r in rows):.2f} % of the speed"
    )
    missed = sum(r.missed for r in rows)
    if missed:
        lines.append(f"{missed} pairs of frames gave no velocity")
    return "\n".join(lines)


def _figures(tables: list[SyntheticMotion], rows: tuple[RealMotion, ...], origin: str) -> dict[str, Any]:
    from dataclasses import asdict

    from rsflow.reproduce import implied_focal_length

    def numbers(values: Any) -> Any:
        """As lists, None where there is no number: JSON has no NaN."""
        if hasattr(values, "tolist"):
            values = values.tolist()
        if isinstance(values, (list, tuple)):
            return [numbers(value) for value in values]
        return None if isinstance(values, float) and values != values else values

    f = implied_focal_length()
    return {
        "pictures": origin,
        "synthetic_motion": [
            {
                "condition": table.condition,
                "pictures": list(table.pictures),
                "actual_px": numbers(table.actual_px),
                "report_px": None if table.report_px is None else numbers(table.report_px),
                "measured_px": numbers(table.measured_px),
            }
            for table in tables
        ],
        "real_motion": [
            {name: numbers(value) for name, value in asdict(row).items()}
            | {name: numbers(getattr(row, name)) for name in ("report_error", "window_error", "frame_error")}
            for row in rows
        ],
        "implied_focal_length_px": {"mean": f.mean_px, "deviation": f.spread_px, "rows": numbers(f.rows_px)},
        "calibrated_focal_length_px": f.calibrated_px,
    }
