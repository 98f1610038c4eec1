"""What is decided once, from the first frames: whether the camera moves, and the scale of the arrows."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from .rows import flow_samples

if TYPE_CHECKING:
    from ..capture.stream import Frame
    from ..flow.field import FlowField
    from ..plotting import QuiverStyle
    from ..shift import Shift

__all__ = ["STILL_PX", "CameraDecision", "arrow_style", "camera_motion", "enough"]

# Pairs of frames that are looked at, and the memory that the frames kept meanwhile may take: enough pairs to see a
# hand-held camera tremble, few enough that large frames fit.
_PAIRS = 12
_BYTES = 256_000_000

# A camera on a tripod stays below this, compression and noise included; a hand-held one is above it in most pairs.
STILL_PX = 0.15

# Arrows longer than so many of their distances are cut: a clip that becomes faster than its first frames stays legible.
_LONGEST_STEPS = 4.0


@dataclass(frozen=True)
class CameraDecision:
    """Whether the camera moves, and the sentence that says why."""

    motion: Literal["moving", "static"]
    reason: str


def enough(held: Sequence[tuple[Frame, Shift | None, FlowField | None]]) -> bool:
    """Whether so many frames as are `held`, with what was measured of them, are what the decisions are made from."""
    frame, _, flow = held[-1]
    pictures = frame.image.nbytes + (0 if frame.color is None else frame.color.nbytes)
    size = pictures + (0 if flow is None else flow.uv.nbytes)
    return len(held) > min(_PAIRS, max(2, _BYTES // max(size, 1)))


def _displacement(shift: Shift | None, flow: FlowField | None) -> float:
    """How far a pair moved as a whole, in pixels; NaN where neither estimator can tell."""
    if shift is not None and shift.valid:
        return float(np.hypot(shift.dx, shift.dy))
    if flow is not None and flow.valid.any():
        return float(np.hypot(*np.median(flow.uv[flow.valid], axis=0)))
    return float("nan")


def camera_motion(pairs: Sequence[tuple[Shift | None, FlowField | None]]) -> CameraDecision:
    """Decide from (shift, flow) of the first pairs.

    A camera rests when three quarters of the pairs moved by less than `STILL_PX` as a whole. Where nothing can be
    told, a moving camera is assumed: its estimate of the motion finds a camera at rest too.
    """
    moved = np.array([_displacement(*pair) for pair in pairs], np.float64)
    moved = moved[np.isfinite(moved)]
    if len(moved) == 0:
        return CameraDecision("moving", "taken as moving, since the first frames do not tell")
    pairs_text = f"the first {len(moved)} pairs of frames" if len(moved) > 1 else "the first pair of frames"
    high = float(np.quantile(moved, 0.75))
    if high < STILL_PX:
        return CameraDecision("static", f"found at rest: {pairs_text} moved by less than {STILL_PX} px as a whole")
    return CameraDecision(
        "moving", f"found moving: {pairs_text} moved by {float(np.median(moved)):.2f} px (median) as a whole"
    )


def arrow_style(flows: Sequence[FlowField | None], width: int) -> QuiverStyle:
    """Give the `QuiverStyle` of the whole clip, fitted to its first flows."""
    from ..plotting import QuiverStyle
    from ..plotting.drawing import size_for

    samples = [np.stack(flow_samples(flow), axis=1) for flow in flows if flow is not None]
    known = [vectors for vectors in samples if len(vectors)]
    if not known:
        known = [np.zeros((1, 2), np.float32)]
    style = QuiverStyle.fitted(known, width=width)
    return dataclasses.replace(
        style, max_length=_LONGEST_STEPS * style.step, line_width=round(size_for((width, width)))
    )
