"""``rsflow shift PREV NEXT``: how far a window moved from one picture to the next."""

from __future__ import annotations

import argparse
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from rsflow.cli._options import add_illumination, add_max_displacement, add_roi, mask_of, two_pictures

if TYPE_CHECKING:
    from rsflow.shift import Shift

DESCRIPTION = """\
Measure how far the content of one window, or of the whole picture, moved from PREV to NEXT.

examples:
  rsflow shift a.png b.png                        the whole picture
  rsflow shift a.png b.png --roi 300,200,60,60    one window of 60 x 60, from column 300 and row 200
  rsflow shift a.png b.png --deformation affine   a window that turns, zooms or shears
  rsflow shift a.png b.png --mask m.png --next-mask m.png    without an overlay that is fixed to the sensor
  rsflow shift a.png b.png --json                 for a program to read

The displacement is in pixels, x to the right and y down. Exit code 1 if it could not be measured."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("prev", metavar="PREV", help="the first picture; colour is read as grey")
    parser.add_argument("next", metavar="NEXT", help="the second picture, of the same size")
    add_roi(parser, of="the window in PREV (default: the whole picture)")
    add_illumination(parser)
    add_max_displacement(parser, default="half the window, along each axis")
    parser.add_argument(
        "--deformation",
        choices=("none", "affine"),
        default="none",
        help="how the window may deform: not at all, or by a displacement that varies linearly (default: none)",
    )
    parser.add_argument("--mask", metavar="PICTURE", help="where it is not black a pixel of PREV counts")
    parser.add_argument("--next-mask", metavar="PICTURE", help="where it is not black a pixel of NEXT counts")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def _as_json(shift: Shift) -> dict[str, Any]:
    """Give the result as numbers that JSON can carry: null where not measured."""

    def number(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "dx": number(shift.dx),
        "dy": number(shift.dy),
        "covariance": [[number(float(value)) for value in row] for row in shift.covariance],
        "gain": number(shift.gain),
        "offset": number(shift.offset),
        "residual": number(shift.residual),
        "direction": [number(float(value)) for value in shift.direction],
        "direction_variance": number(shift.direction_variance),
        "gradient": [[number(float(value)) for value in row] for row in shift.gradient],
        "joint_covariance": [[number(float(value)) for value in row] for row in shift.joint_covariance],
        "status": shift.status.name,
        "valid": shift.valid,
    }


def _as_text(shift: Shift) -> str:
    if np.isfinite(shift.direction_variance):
        x, y = shift.direction
        return (
            f"measured across the structure alone ({shift.status.name}): {shift.dx * x + shift.dy * y:+.4f} px along "
            f"({x:+.4f}, {y:+.4f}), deviation {math.sqrt(shift.direction_variance):.4f} px"
        )
    if not shift.valid:
        return f"not measured ({shift.status.name}): {shift.status.explanation}"
    sigma_x, sigma_y = np.sqrt(np.diag(shift.covariance))
    deformation: tuple[str, ...] = ()
    if shift.gradient.any():
        (xx, xy), (yx, yy) = shift.gradient
        deformation = (
            f"gradient      du/dx = {xx:+.5f}, du/dy = {xy:+.5f}, dv/dx = {yx:+.5f}, dv/dy = {yy:+.5f} px per px",
        )
    return "\n".join(
        (
            f"displacement  dx = {shift.dx:+.4f} px (right), dy = {shift.dy:+.4f} px (down)",
            f"deviation     sigma_x = {sigma_x:.4f} px, sigma_y = {sigma_y:.4f} px "
            "(the truth is within 1 sigma in 68 %, within 2 in 95 % of cases)",
            *deformation,
            f"light         next = {shift.gain:.4f} * prev {shift.offset:+.2f} grey levels, on average",
            f"residual      {shift.residual:.3f} grey levels rms, after motion and light",
            f"status        {shift.status.name}: {shift.status.explanation}",
        )
    )


def run(args: argparse.Namespace) -> int:
    """Run the command: 0 if the displacement was measured, 1 if not."""
    from rsflow.shift import estimate_shift

    before, after = (frame.image for frame in two_pictures(args.prev, args.next))
    size = (before.shape[1], before.shape[0])
    shift = estimate_shift(
        before,
        after,
        roi=args.roi,
        mask=mask_of(args.mask, size=size),
        next_mask=mask_of(args.next_mask, option="--next-mask", size=size),
        illumination=args.illumination,
        deformation=args.deformation,
        max_displacement=args.max_displacement,
    )
    print(json.dumps(_as_json(shift)) if args.json else _as_text(shift))
    return 0 if shift.valid else 1
