"""How long it takes from frame to velocity, stage by stage, beside OpenCV's corners, Lucas-Kanade and RANSAC."""

from __future__ import annotations

import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera.model import Camera
from ..synthetic import Flight, Sensor, flight
from ..velocity import VelocityEstimator
from ..velocity.chain import plane as _plane
from .velocity_conditions import HEIGHT_M, RATE_HZ
from .velocity_tables import LatencyRow

__all__ = ["WHOLE", "latencies", "stages"]

F64 = NDArray[np.float64]

SIZES = ((64, 64), (320, 240), (640, 480))
WHOLE = "frame to velocity"
CORNERS = 400


def stages(estimator: VelocityEstimator) -> dict[str, tuple[Any, str]]:
    """Give the steps of `update` that are worth a line: a name, and the object and attribute that is called for it."""
    del estimator
    return {
        "frame taken: levels of its pyramid": (_plane.Follower, "push"),
        "motion over the plane from tiles": (_plane.Follower, "motion"),
        "rotation known and learned, covariance": (_plane.Motion, "known"),
    }


def latencies(frames: int) -> tuple[LatencyRow, ...]:
    """Time the chain for each size, in turns with OpenCV's on the same frames."""
    return tuple(row for size in SIZES for row in _of_size(size, frames))


def _flown(size: tuple[int, int], frames: int) -> Flight:
    """Fly level at 1 m/s: 8 pixels a frame at 320 x 240."""
    width, height = size
    focal = 0.94 * width
    camera = Camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width=width, height=height,
                    distortion=(-0.2, 0.05, 0.0, 0.0))  # fmt: skip
    return flight(camera, frames=frames + 1, rate_hz=RATE_HZ, height_m=HEIGHT_M, velocity_m_s=(0.92, 0.39, 0.0),
                  sensor=Sensor(noise=1.2, blur_px=0.6), seed=1)  # fmt: skip


def _of_size(size: tuple[int, int], frames: int) -> Iterator[LatencyRow]:
    flown = _flown(size, frames)
    ours = VelocityEstimator(flown.camera, height_m=HEIGHT_M, height_std_m=0.0, rate_std_rad_s=0.0)
    theirs = _Rival(flown.camera)
    times: dict[tuple[str, str], list[float]] = defaultdict(list)
    errors: dict[str, list[float]] = defaultdict(list)
    speed = float(np.linalg.norm(flown.velocity_m_s[1]))
    for k, frame in enumerate(flown):
        began = time.perf_counter()
        v = ours.update(frame.image, frame.t_s, rate_rad_s=None if k == 0 else np.zeros(3))
        taken = time.perf_counter() - began
        velocity, steps = theirs.update(frame.image, frame.t_s)
        if k == 0:
            continue
        times["rsflow", WHOLE].append(taken)
        for stage, seconds in steps.items():
            times["OpenCV", stage].append(seconds)
        truth = flown.velocity_m_s[k, :2]
        errors["rsflow"].append(float(np.linalg.norm(np.array([v.vx_m_s, v.vy_m_s]) - truth)) / speed)
        errors["OpenCV"].append(float(np.linalg.norm(velocity - truth)) / speed)
    # In a pass of its own, so that the clocks do not count for the whole.
    for stage, each in _by_stage(flown).items():
        times["rsflow", stage] = each
    for (method, stage), taken_s in sorted(times.items(), key=lambda item: item[0][0], reverse=True):
        off = np.array(errors[method])
        off = off[np.isfinite(off)]
        rms = 100 * float(np.sqrt(np.mean(off**2))) if stage == WHOLE and off.size else float("nan")
        yield LatencyRow(size, method, stage, 1000 * statistics.median(taken_s), rms)


def _by_stage(flown: Flight) -> dict[str, list[float]]:
    """Give the seconds that each stage takes in each frame, however often it is called for it."""
    estimator = VelocityEstimator(flown.camera, height_m=HEIGHT_M, height_std_m=0.0, rate_std_rad_s=0.0)
    found: dict[str, list[float]] = defaultdict(list)
    spent: dict[str, float] = defaultdict(float)
    with _clocked(stages(estimator), spent):
        for k, frame in enumerate(flown):
            spent.clear()
            estimator.update(frame.image, frame.t_s, rate_rad_s=None if k == 0 else np.zeros(3))
            for stage, seconds in spent.items() if k else ():
                found[stage].append(seconds)
    return found


@contextmanager
def _clocked(hooks: dict[str, tuple[Any, str]], spent: dict[str, float]) -> Iterator[None]:
    """Add up the seconds that calls take, while it lasts."""
    kept = {stage: (owner, name, getattr(owner, name)) for stage, (owner, name) in hooks.items()}

    def clock(stage: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def called(*args: Any, **options: Any) -> Any:
            began = time.perf_counter()
            try:
                return call(*args, **options)
            finally:
                spent[stage] += time.perf_counter() - began

        return called

    try:
        for stage, (owner, name, call) in kept.items():
            setattr(owner, name, clock(stage, call))
        yield
    finally:
        for owner, name, call in kept.values():
            setattr(owner, name, call)


class _Rival:
    """What engineers write with OpenCV: corners, pyramidal Lucas-Kanade, a similarity by RANSAC, metres per second."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
        self.prev: NDArray[Any] | None = None
        self.prev_t_s = np.nan

    def update(self, image: NDArray[Any], t_s: float) -> tuple[F64, dict[str, float]]:
        """Give the velocity (vx, vy), NaN where there is none, and the seconds of each step."""
        import cv2

        prev, before = self.prev, self.prev_t_s
        self.prev, self.prev_t_s = image, t_s
        if prev is None:
            return np.full(2, np.nan), {}
        clock = [time.perf_counter()]
        points: Any = cv2.goodFeaturesToTrack(prev, CORNERS, 0.01, 4)
        clock.append(time.perf_counter())
        if points is None:
            return np.full(2, np.nan), {}
        empty: Any = None
        moved, status, _ = cv2.calcOpticalFlowPyrLK(prev, image, points, empty, winSize=(21, 21), maxLevel=3)
        clock.append(time.perf_counter())
        kept = status.ravel() == 1
        lens = np.array(self.camera.distortion)
        rays = (cv2.undistortPoints(p[kept], self.matrix, lens) for p in (points, moved))
        start, stop = rays
        found, _ = cv2.estimateAffinePartial2D(
            start, stop, method=cv2.RANSAC, ransacReprojThreshold=1.0 / self.camera.fx
        )
        velocity = np.full(2, np.nan) if found is None else -found[:, 2] * HEIGHT_M / (t_s - before)
        clock.append(time.perf_counter())
        names = ("goodFeaturesToTrack", "calcOpticalFlowPyrLK", "undistortPoints, RANSAC")
        return np.asarray(velocity), {WHOLE: clock[-1] - clock[0], **dict(zip(names, np.diff(clock), strict=True))}
