"""A clip of a camera that travels at a known height against what is known of its way: figures and words."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from . import words
from .axes import ordered
from .estimate import UNKNOWN, Estimate, estimated, in_unit
from .rate_log import RateLog
from .result import ScaleCheck, ScaleStatus, corrected
from .speed_fit import DELAY, LOG_RATIO, ROWS, YAW, SpeedFit, fit_speed
from .travel import Travel

__all__ = ["SpeedQuestion", "check_against_distance", "check_against_speed"]

F64 = NDArray[np.float64]

_LEAST_PAIRS = 6
# Pixels a frame below which a clip counts as still.
_LEAST_MOVE_PX = 0.2
# Errors that all points share, of a frame's displacement, in pixels.
_COMMON_PX = 0.01
_RATIO_KNOWN, _YAW_KNOWN, _DELAY_KNOWN, _READOUT_KNOWN = 0.2, 0.1, 0.7, 0.3
# What is left of the velocity after the fit, above which measured and known do not belong together.
_MOST_LEFT = 0.25
# Power of one axis apart from the other, over the noise's, from which it counts as seen.
_SEEN = 50.0


@dataclass(frozen=True)
class SpeedQuestion:
    """What was stated; deviations relative to the figure, None where nobody said."""

    height_std: float | None
    known_std: float | None
    readout_s: float | None
    max_delay_s: float


def _begun(travel: Travel, against: str) -> ScaleCheck:
    """Give what there is before any fit: nothing, or why there will be nothing."""
    empty = ScaleCheck(ScaleStatus.CHECKED, against, frames=travel.frames, n_pairs=len(travel))
    if len(travel) < _LEAST_PAIRS:
        lost = f"the velocity could not be measured: {travel.lost.replace('_', ' ')}"
        return replace(empty, status=ScaleStatus.TOO_FEW_FRAMES, findings=(lost,) if travel.lost else ())
    if float(np.median(travel.move_px)) < _LEAST_MOVE_PX:
        return replace(empty, status=ScaleStatus.NO_MOTION)
    return empty


def _readout_before(question: SpeedQuestion, travel: Travel) -> tuple[float, float]:
    """Say what is known of the readout time: what was stated, or that it is up to the time between frames."""
    if question.readout_s is not None:
        return question.readout_s, 1e-9
    return 0.0, 0.5 * float(np.median(travel.dt_s))


def _ratio(
    apparent: float, std: float, travel: Travel, camera: Camera, question: SpeedQuestion, blocks: int
) -> Estimate:
    """Ratio of the focal lengths, from that of the speeds, with all that adds to its deviation."""
    value = _without_distortion(apparent, camera, travel.velocity_m_s.mean(axis=0))
    common = _COMMON_PX / float(np.sqrt((travel.move_px**2).mean()))
    parts = (std, common, question.height_std or 0.0, question.known_std or 0.0)
    total = float(np.sqrt(sum(part**2 for part in parts)))
    return estimated(value, value * total, blocks=blocks, most_std=_RATIO_KNOWN)


def _shared(travel: Travel, readout_s: float) -> F64:
    """Give deviations of the unknowns from errors that all pairs share; that of the ratio stands elsewhere."""
    share = _COMMON_PX / float(np.sqrt((travel.move_px**2).mean()))
    speed = float(np.sqrt((travel.velocity_m_s**2).sum(axis=1).mean()))
    change = np.diff(travel.velocity_m_s, axis=0) / travel.dt_s[1:, None]
    rows = float(np.sqrt((travel.rows_1_s**2).mean()))
    shared = np.zeros(4)
    shared[YAW] = share
    shared[DELAY] = share * speed / max(float(np.sqrt((change**2).sum(axis=1).mean())), 1e-12)
    shared[ROWS] = np.hypot(share / max(rows, 1e-12), 0.01 * readout_s)
    return shared


def _without_distortion(apparent: float, camera: Camera, way: F64) -> float:
    """Ratio of the focal lengths where speeds have the ratio `apparent`.

    They are one and the same without lens distortion. With it, a wrong focal length also takes distortion away at the
    wrong places: what that does to a small motion is worked out over the picture.
    """
    if not any(camera.distortion) or not 0.2 < apparent < 5:
        return apparent
    x, y = np.meshgrid(
        np.linspace(0.08, 0.92, 12) * (camera.width - 1), np.linspace(0.08, 0.92, 9) * (camera.height - 1)
    )
    pixels = np.column_stack([x.ravel(), y.ravel()])
    step = 1e-3 * way / max(float(np.linalg.norm(way)), 1e-12)
    ratio = apparent
    for _ in range(5):
        true = replace(camera, fx=camera.fx * ratio, fy=camera.fy * ratio, std={})
        moved = true.distort_points(true.undistort_points(pixels, normalized=True) + step, normalized=True)
        seen = camera.undistort_points(moved, normalized=True) - camera.undistort_points(pixels, normalized=True)
        found = float(np.nanmean(seen @ step)) / float(step @ step)
        if not np.isfinite(found) or found <= 0:
            return apparent
        ratio *= apparent / found
    return ratio


def _told(ratio: Estimate, camera: Camera, question: SpeedQuestion, known: str) -> tuple[list[str], list[str]]:
    """Say what is wrong with the scale, and what was not stated."""
    less, more = ("small", "large") if ratio.value < 1 else ("large", "small")
    percent = 100 * abs(ratio.value - 1)
    or_else = f"; or the height is {percent:.2g} % too {less}, or the {known} as much too {more}"
    found = words.focal_words(ratio, in_unit(ratio, camera.fx, "px"), camera.fx, or_else=or_else)
    stated = (("height", question.height_std), (known, question.known_std))
    untold = [
        f"how exact the {name} is was not stated: the interval leaves it out" for name, std in stated if std is None
    ]
    if not ratio.known:
        untold.append("the focal length: the ratio of measured to known speed is too uncertain")
    return found, untold


def check_against_distance(travel: Travel, camera: Camera, distance_m: float, question: SpeedQuestion) -> ScaleCheck:
    """Hold the length of the camera's way against a known one."""
    empty = _begun(travel, "distance")
    if not empty.status.valid or empty.findings or len(travel) < _LEAST_PAIRS:
        return empty
    length = travel.along() * travel.dt_s
    whole = travel.last_s - travel.first_s
    seen = float(travel.dt_s.sum())
    if seen < 0.5 * whole:
        lost = f"half of the way could not be measured: {travel.lost.replace('_', ' ')}"
        return replace(empty, status=ScaleStatus.TOO_FEW_FRAMES, findings=(lost,))
    # Where a pair could not be measured, the speed of those around it is taken.
    middle = 0.5 * (travel.start_s + travel.stop_s)
    edges = np.concatenate([[travel.first_s], travel.stop_s, [travel.last_s]])
    begin = np.concatenate([travel.start_s, [travel.last_s]])
    gaps = np.maximum(begin - edges[:-1], 0)
    missing = float((gaps * np.interp(0.5 * (edges[:-1] + begin), middle, travel.along())).sum())
    way = float(length.sum()) + missing
    blocks = int(np.clip(len(travel) // 3, 2, 20))
    noise = float(np.sqrt((np.trace(travel.covariance, axis1=1, axis2=2) / 2 * travel.dt_s**2).sum()))
    center, spread = _readout_before(question, travel)
    rows = float((travel.rows_1_s * length).sum() / max(way, 1e-12))
    std = float(np.hypot(noise / max(way, 1e-12), 0.3 * missing / max(way, 1e-12)))
    ratio = _ratio(
        way / (1 + center * rows) / distance_m, float(np.hypot(std, spread * rows)), travel, camera, question, blocks
    )
    findings, untold = _told(ratio, camera, question, "distance")
    if spread * abs(rows) > 0.003:
        untold.append(
            f"the readout time: a rolling shutter changes the way by up to {200 * spread * abs(rows):.1f} %: state it, "
            "or move along the rows"
        )
    untold.append("axes, mounting and delay: a distance alone says nothing of them")
    focal = in_unit(ratio, camera.fx, "px")
    return replace(
        empty,
        focal_px=focal,
        focal_ratio=ratio,
        findings=tuple(findings),
        untold=tuple(untold),
        camera=corrected(camera, ratio),
    )


def check_against_speed(
    travel: Travel, camera: Camera, log: RateLog | None, speed_m_s: float, vector: bool, question: SpeedQuestion
) -> ScaleCheck:
    """Hold the measured velocity against a known one, over time or constant."""
    against = "velocity" if vector else "speed"
    empty = _begun(travel, against)
    if not empty.status.valid:
        return empty
    before = _readout_before(question, travel)
    fit = fit_speed(
        travel, log=log, speed_m_s=speed_m_s, vector=vector, readout=before, max_delay_s=question.max_delay_s
    )
    if fit is None:
        return replace(empty, status=ScaleStatus.NO_OVERLAP)
    measured = travel.velocity_m_s if vector else travel.along()[:, None]
    if float((fit.residual**2).sum()) > _MOST_LEFT**2 * float((measured**2).sum()):
        return replace(empty, status=ScaleStatus.NO_MATCH)
    std = np.hypot(np.sqrt(np.diag(fit.covariance)), _shared(travel, float(fit.value[ROWS])))
    dt = float(np.median(travel.dt_s))
    ratio = _ratio(float(np.exp(fit.value[LOG_RATIO])), float(std[LOG_RATIO]), travel, camera, question, fit.blocks)
    findings, untold = _told(ratio, camera, question, against)
    delay = UNKNOWN
    if log is not None and not fit.rivals:
        delay = estimated(fit.value[DELAY], float(std[DELAY]), blocks=fit.blocks, unit="s", most_std=_DELAY_KNOWN * dt)
    if not delay.known:
        untold.append("the delay: the speed hardly changes: speed up and slow down, irregularly")
    readout = UNKNOWN
    if question.readout_s is None:
        most = min(_READOUT_KNOWN * dt, 0.6 * before[1])
        readout = estimated(fit.value[ROWS], float(std[ROWS]), blocks=fit.blocks, unit="s", most_std=most)
        if not readout.known:
            untold.append("the readout time: move up and down the picture as well as along its rows, or state it")
    axes, mounting = _axes(fit, vector)
    yaw = estimated(mounting, float(std[YAW]) if vector else np.inf, blocks=fit.blocks, unit="rad", most_std=_YAW_KNOWN)
    if "?" in axes[:2]:
        more = "move along another direction as well" if vector else f"a {against} alone does not say"
        untold.append(
            f"which axis of the log is {' and '.join(a for a, b in zip('xy', axes, strict=False) if b == '?')}: {more}"
        )
    findings += words.axes_words(axes)
    findings += words.mounting_words((UNKNOWN, UNKNOWN, yaw), "known velocity")
    findings += words.delay_words(delay, f"log of the {against}")
    findings += words.readout_words(readout, 0.0)
    return replace(
        empty,
        focal_px=in_unit(ratio, camera.fx, "px"),
        focal_ratio=ratio,
        axes=axes,
        mounting_rad=(UNKNOWN, UNKNOWN, yaw),
        delay_s=delay,
        readout_s=readout,
        findings=tuple(findings),
        untold=tuple(untold),
        camera=corrected(camera, ratio),
    )


def _axes(fit: SpeedFit, vector: bool) -> tuple[tuple[str, str, str], float]:
    """Which axis of the log is which of the camera, and the yaw that is left."""
    if not vector:
        return ("?", "?", "?"), np.nan
    whole = np.eye(3)
    whole[:2, :2] = fit.order
    order, rest = ordered(whole)
    noise = float(np.median(fit.residual**2)) / 0.455 + 1e-12
    power = fit.known.T @ fit.known
    seen = 1 / np.diag(np.linalg.inv(power + 1e-12 * np.trace(power) * np.eye(2))) > _SEEN * noise
    names = []
    for row in order[:2, :2]:
        at = int(np.argmax(np.abs(row)))
        names.append(f"{'+' if row[at] > 0 else '-'}{'xy'[at]}" if seen[at] else "?")
    return (names[0], names[1], "?"), float(rest[2])
