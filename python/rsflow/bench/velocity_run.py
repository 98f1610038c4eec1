"""Accuracy and latency of velocities: each condition flown, measured and judged against the exact truth."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._core import __version__, build_info
from ..velocity import Velocity, VelocityEstimator
from ._threads import threads
from .velocity_conditions import Condition, conditions
from .velocity_latency import latencies
from .velocity_tables import ConditionRow, VelocityBench

__all__ = ["measure_velocity"]

F64 = NDArray[np.float64]

# A velocity is a false answer where it is off by more deviations than this, and by more than this share of the speed.
FALSE_DEVIATIONS = 5.0
FALSE_SHARE = 0.02


def measure_velocity(
    *,
    only: Sequence[str] | None = None,
    flights: int = 3,
    rounds: int = 60,
    quick: bool = False,
    progress: Callable[[str], object] | None = None,
) -> VelocityBench:
    """Measure how exact velocities are under each condition, how far their deviations hold, and how long a frame takes.

    Made flights of 320 x 240 pixels at 60 frames per second, 0.6 m over rough ground, at 1 m/s where the condition says
    nothing else. The time from frame to velocity is taken in turns with that of OpenCV's corners, pyramidal
    Lucas-Kanade and RANSAC, on the same frames, each on one thread.

    Parameters
    ----------
    only : sequence of str, optional
        Conditions whose name begins with one of these; an empty sequence measures none. By default all.
    flights : int
        How many flights, over different ground and in different directions, each condition has.
    rounds : int
        How many frames are timed for each size; 0 times nothing.
    quick : bool
        A quarter of the frames of each flight, and one flight: to see that it works, not to quote.
    progress : callable, optional
        Called with the name of each condition before it is flown.

    Returns
    -------
    VelocityBench

    Raises
    ------
    OptionError
        If a number is below 1 (`rounds`: 0), or nothing is called as in `only`.

    Examples
    --------
    >>> from rsflow.bench import measure_velocity
    >>> found = measure_velocity(only=["level flight"], rounds=0, quick=True)
    >>> row = found.conditions[0]
    >>> row.condition, row.valid, row.false, row.rms_percent < 1
    ('level flight', 1.0, 0.0, True)
    """
    import cv2

    flights = _checks.integer("flights", flights, least=1, most=1000)
    rounds = _checks.integer("rounds", rounds, least=0, most=100_000)
    quick = _checks.flag("quick", quick)
    told = (lambda name: None) if progress is None else _checks.function("progress", progress, 1)
    rows = []
    with threads(1):
        for condition in _chosen(only):
            told(condition.name)
            rows.append(_measured(condition, 1 if quick else flights, quick))
        times = latencies(min(rounds, 5) if quick else rounds) if rounds else ()
    versions = {
        "rsflow": __version__, "OpenCV": cv2.__version__, "numpy": np.__version__, "Python": platform.python_version(),
    }  # fmt: skip
    return VelocityBench(tuple(rows), times, str(build_info()["cpu_level"]), 1 if quick else flights, versions)


def _chosen(only: Sequence[str] | None) -> list[Condition]:
    every = list(conditions())
    if only is None:
        return every
    if isinstance(only, str):
        raise _checks.refused("only", only, "a sequence of names, or of their beginnings")
    begins = [_checks.text("only", name) for name in _checks.iterable("only", only, "names of conditions")]
    for begin in begins:
        if not any(condition.name.startswith(begin) for condition in every):
            raise _checks.refused("only", begin, f"the beginning of one of: {'; '.join(c.name for c in every)}")
    return [condition for condition in every if any(condition.name.startswith(begin) for begin in begins)]


def _measured(condition: Condition, flights: int, quick: bool) -> ConditionRow:
    # What only shows late in a flight must not be cut off.
    frames = condition.frames // 4 if quick and not condition.after_s else condition.frames
    errors, deviations, truths, speeds, intervals = [], [], [], [], 0
    for seed in range(flights):
        flown = condition.fly(seed, max(frames, 8))
        told = condition.tell(flown, seed)
        estimator = VelocityEstimator(flown.camera, **condition.options)
        for k, (image, row) in enumerate(zip(flown.images, told.rows, strict=True)):
            v = estimator.update(image, float(told.t_s[k]), **row)
            if k == 0 or flown.t_s[k] < condition.after_s:
                continue
            truth = _truth(flown.path.means, flown.t_s, told.t_s, k, v)
            intervals += 1
            speeds.append(float(np.linalg.norm(truth)))
            if v.valid:
                errors.append(np.array([v.vx_m_s, v.vy_m_s]) - truth)
                deviations.append(v.covariance[:2, :2])
                truths.append(truth)
    return scored(condition.name, intervals, float(np.median(speeds)), errors, deviations, truths)


def _truth(means: Callable[[F64, F64], Any], taken_s: F64, told_s: F64, k: int, v: Velocity) -> F64:
    """Mean velocity (vx, vy) over the interval of which `v` speaks, by the times at which its frames were taken."""
    start = k - 1
    if np.isfinite(v.dt_s):
        start = min(int(np.argmin(np.abs(told_s[:k] - (told_s[k] - v.dt_s)))), k - 1)
    return np.asarray(means(taken_s[start : start + 1], taken_s[k : k + 1])[0][0, :2])


def scored(
    name: str, intervals: int, speed: float, errors: Sequence[F64], covariances: Sequence[F64], truths: Sequence[F64]
) -> ConditionRow:
    """Make the row of a condition of errors (vx, vy), their covariances and the true velocities."""
    if not len(errors):
        return ConditionRow(name, intervals, np.nan, np.nan, 0.0, 0.0, np.nan, np.nan)
    error, truth, covariance = np.array(errors), np.array(truths), np.array(covariances)
    length, true = np.linalg.norm(error, axis=1), np.linalg.norm(truth, axis=1)
    along = np.einsum("ij,ij->i", error, truth) / np.maximum(true, 1e-12)
    spread = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 1e-300))
    inverse = np.linalg.pinv(np.where(np.isfinite(covariance), covariance, 0.0), hermitian=True)
    # Of an infinite deviation nothing is far off.
    off = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", error, inverse, error), 0.0))
    off[~np.isfinite(covariance).all(axis=(1, 2))] = 0.0
    false = (off > FALSE_DEVIATIONS) & (length > FALSE_SHARE * np.maximum(true, speed))
    share = 100.0 / max(speed, 1e-12)
    return ConditionRow(
        condition=name,
        frames=intervals,
        rms_percent=share * float(np.sqrt(np.mean(length**2))),
        bias_percent=share * float(along.mean()),
        valid=len(errors) / intervals,
        false=float(false.sum()) / intervals,
        within_1=float((np.abs(error) < spread).mean()),
        within_2=float((np.abs(error) < 2 * spread).mean()),
    )
