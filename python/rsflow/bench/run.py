"""Accuracy and time of rsflow beside OpenCV, on scenes whose motion is known exactly.

All methods of a subject take turns in every round of one run, with the same number of threads, so that what else the
machine does meets them alike; times are medians over the rounds. The scenes are those of `rsflow.synthetic`.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._core import __version__, build_info
from ..camera.model import Camera
from ..synthetic import Lighting, flight_with_object, gain, shifted_pair
from ..tracking import detect_corners
from ._threads import threads as threads_of
from .methods import Method, dense_methods, point_methods, shift_methods
from .tables import Bench, Row

__all__ = ["measure"]


# Displacement of the pairs for points and dense flow, in pixels.
DISPLACEMENT = (7.25, -3.5)
# The longest component of the displacements for `estimate_shift`, in pixels: a sixth of the small window.
LONGEST = 10.0
POINTS = 400
LIGHTS: tuple[tuple[str, Lighting | None], ...] = (("steady light", None), ("gain 0.7, plus 20", gain(0.7, 20)))

Array = NDArray[Any]


@dataclass(frozen=True)
class _Scene:
    """Pairs (prev, next, motion); the motion is NaN where it leads out of the picture."""

    name: str
    pairs: tuple[tuple[Array, Array, Array], ...]


def measure(*, threads: int = 1, rounds: int = 9, quick: bool = False) -> Bench:
    """Measure rsflow and OpenCV in turns, on the same scenes with the same number of threads.

    Parameters
    ----------
    threads : int
        For rsflow and for OpenCV.
    rounds : int
        How often each method runs on each pair. One more round, not timed, comes first and gives the errors.
    quick : bool
        A quarter of the pixels and fewer pairs: to see that it works, not to quote.

    Returns
    -------
    Bench

    Raises
    ------
    OptionError
        If `threads` or `rounds` is below 1.

    Examples
    --------
    >>> from rsflow.bench import measure
    >>> found = measure(rounds=1, quick=True)
    >>> sorted({row.subject for row in found.rows})
    ['dense flow', 'displacement', 'points']
    """
    import cv2

    threads = _checks.integer("threads", threads, least=1, most=1024)
    rounds = _checks.integer("rounds", rounds, least=1, most=10_000)
    quick = _checks.flag("quick", quick)
    size = (320, 240) if quick else (640, 480)
    rows: list[Row] = []
    with threads_of(threads):
        for scene in (*_shifted(size), _flown(size)):
            rows += _turns("dense flow", scene, dense_methods(), rounds)
        for scene in _shifted(size):
            prev, _, motion = scene.pairs[0]
            points = detect_corners(prev, max_corners=POINTS)
            x, y = np.rint(points).astype(int).T
            scene = _Scene(scene.name, ((*scene.pairs[0][:2], motion[y, x]),))
            rows += _turns("points", scene, point_methods(points), rounds)
        for window, pairs in (((60, 60), 8 if quick else 20), (size, 2 if quick else 5)):
            for scene in _displaced(window, pairs):
                rows += _turns("displacement", scene, shift_methods(window), rounds)
    versions = {
        "rsflow": __version__, "OpenCV": cv2.__version__, "numpy": np.__version__, "Python": platform.python_version(),
    }  # fmt: skip
    return Bench(tuple(rows), str(build_info()["cpu_level"]), threads, rounds, versions)


def _turns(subject: str, scene: _Scene, methods: Sequence[Method], rounds: int) -> list[Row]:
    errors: list[list[Array]] = [[] for _ in methods]
    times: list[list[float]] = [[] for _ in methods]
    for prev, after, motion in scene.pairs:
        known = np.isfinite(motion).all(axis=-1)
        for method, found in zip(methods, errors, strict=True):
            measured = np.asarray(method.motion(method.call(prev, after)), np.float64)
            found.append(np.linalg.norm(measured - motion, axis=-1)[known])
    for _ in range(rounds):
        for prev, after, _ in scene.pairs:
            for method, taken in zip(methods, times, strict=True):
                begin = time.perf_counter()
                method.call(prev, after)
                taken.append(1000.0 * (time.perf_counter() - begin))
    rows = []
    for method, found, taken in zip(methods, errors, times, strict=True):
        every = np.concatenate(found)
        error = every[np.isfinite(every)]
        median, p95 = np.percentile(error, (50, 95)) if error.size else (np.nan, np.nan)
        share = error.size / max(every.size, 1)
        rows.append(Row(subject, scene.name, method.name, float(median), float(p95), share, statistics.median(taken)))
    return rows


def _within(motion: Array) -> Array:
    """Put NaN where `motion` (height, width, 2) leads out of the picture."""
    height, width = motion.shape[:2]
    y, x = np.indices((height, width))
    to_x, to_y = x + motion[..., 0], y + motion[..., 1]
    inside = (to_x >= 0) & (to_x <= width - 1) & (to_y >= 0) & (to_y <= height - 1)
    return np.where(inside[..., None], motion, np.nan)


def _shifted(size: tuple[int, int]) -> Iterator[_Scene]:
    width, height = size
    for light, lighting in LIGHTS:
        pair = shifted_pair(*DISPLACEMENT, size=size, lighting=lighting, seed=1)
        motion = _within(np.broadcast_to(np.array(DISPLACEMENT), (height, width, 2)))
        yield _Scene(f"{width} x {height}, {light}", ((pair.prev, pair.next, motion),))


def _flown(size: tuple[int, int]) -> _Scene:
    """Fly over ground on which something crosses the camera's way, about 6 pixels a frame each."""
    width, height = size
    camera = Camera(width, width, (width - 1) / 2, (height - 1) / 2, width=width, height=height)
    # Focal length = width: the ground seen is 0.2 m wide, and 6 px are 0.2 * 6 / width metres in 1/30 s.
    speed = 0.2 * 6.0 / width * 30.0
    flight = flight_with_object(camera, frames=2, velocity_m_s=(speed, 0.3 * speed, 0.0), seed=1)
    prev, after = (frame.image for frame in flight)
    return _Scene(f"{width} x {height}, flight with an object", ((prev, after, _within(flight.flow(1))),))


def _displaced(size: tuple[int, int], count: int) -> Iterator[_Scene]:
    displacements = np.random.default_rng(1).uniform(-LONGEST, LONGEST, (count, 2))
    for light, lighting in LIGHTS:
        pairs = [shifted_pair(dx, dy, size=size, lighting=lighting, seed=k) for k, (dx, dy) in enumerate(displacements)]
        yield _Scene(
            f"{size[0]} x {size[1]}, {light}", tuple((p.prev, p.next, np.array([[p.dx, p.dy]])) for p in pairs)
        )
