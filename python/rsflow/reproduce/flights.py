"""Table 4-3: velocity of a webcam over the ground, flown again over rendered ground."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _checks
from ..camera.model import Camera
from ..synthetic import Flight, Sensor, auto_exposure, flight
from ..velocity import VelocityEstimator
from .printed import WINDOW, implied_focal_length, report

__all__ = ["Group", "RealMotion", "groups", "real_motion", "webcam_flight"]

# The report's crop of the frames of table 4-3 (appendix A: imcrop at [60 20], counted from 1).
CROP = (59, 19, WINDOW, WINDOW)
# The frame size of table 4-3.
FRAME = (176, 144)


@dataclass(frozen=True)
class RealMotion:
    """One row of table 4-3, rendered with known truth.

    Attributes
    ----------
    height_cm, frames_per_second, actual_cm_s : float
        As in the report.
    report_flow_px, report_cm_s : float
        What it printed.
    true_flow_px : float
        What the flow must be for the focal length that the printed velocities follow from.
    window_flow_px, window_cm_s : float
        What rsflow measured in the report's window of 60 x 60 pixels: means over the frames.
    frame_flow_px, frame_cm_s : float
        The same from the whole frame of 176 x 144.
    window_worst, frame_worst : float
        Length of the error vector of the worst pair of frames, relative to the speed.
    missed : int
        Pairs of frames for which either gave no velocity.

    Examples
    --------
    >>> from rsflow.reproduce import RealMotion, groups
    >>> row = RealMotion(10.0, 30.0, 2.0, 4.0, 2.1, 3.9, 3.9, 2.01, 3.9, 2.0, 0.01, 0.0, 0)
    >>> round(row.report_error, 3), round(row.window_error, 3), row.frame_error
    (0.05, 0.005, 0.0)
    """

    height_cm: float
    frames_per_second: float
    actual_cm_s: float
    report_flow_px: float
    report_cm_s: float
    true_flow_px: float
    window_flow_px: float
    window_cm_s: float
    frame_flow_px: float
    frame_cm_s: float
    window_worst: float
    frame_worst: float
    missed: int

    @property
    def report_error(self) -> float:
        """Relative error of the report's velocity."""
        return self.report_cm_s / self.actual_cm_s - 1.0

    @property
    def window_error(self) -> float:
        """Relative error of rsflow's velocity in the window."""
        return self.window_cm_s / self.actual_cm_s - 1.0

    @property
    def frame_error(self) -> float:
        """Relative error of rsflow's velocity from the whole frame."""
        return self.frame_cm_s / self.actual_cm_s - 1.0


def webcam_flight(row: Mapping[str, Any], *, frames: int, seed: int) -> Flight:
    """Render one row of table 4-3: what the report's webcam would have seen, had it flown exactly as said.

    The focal length is the one that the printed velocities follow from, so that the flow is as long as the report's
    (2 to 16 pixels, its own 1.6 to 10.5). The lens is soft, the sensor noisy, the exposure 10 ms, and the automatic
    exposure drifts by 20 % within a second and a half.

    Examples
    --------
    >>> from rsflow.reproduce import report
    >>> from rsflow.reproduce.flights import webcam_flight
    >>> flown = webcam_flight(report()["table_4_3_real_motion"][0], frames=2, seed=0)
    >>> flown.images.shape
    (2, 144, 176)
    """
    f = implied_focal_length().mean_px
    width, height = FRAME
    camera = Camera(f, f, (width - 1) / 2, (height - 1) / 2, width=width, height=height)
    # Flown in a direction of its own, so that x and y both count.
    angle = 2 * np.pi * np.random.default_rng([seed, 31]).random()
    speed = row["actual_velocity_cm_s"] / 100.0
    return flight(
        camera,
        frames=frames,
        rate_hz=row["frames_per_second"],
        height_m=row["height_cm"] / 100.0,
        velocity_m_s=(speed * np.cos(angle), speed * np.sin(angle), 0.0),
        sensor=Sensor(noise=2.0, blur_px=0.7),
        exposure_s=0.01,
        exposure_drift=auto_exposure(0.1, period_s=3.0, phase=float(seed)),
        seed=seed,
    )


def real_motion(
    *, frames: int = 8, seed: int = 0, progress: Callable[[int, int], None] | None = None
) -> tuple[RealMotion, ...]:
    """Fly every row of table 4-3 over rendered ground and measure the velocity.

    Parameters
    ----------
    frames : int
        Frames of each flight.
    seed : int
        Of ground, direction and noise; each row has its own.
    progress : callable, optional
        Called with the rows done and the rows in all.

    Returns
    -------
    tuple of RealMotion
        In the order of the report.

    Examples
    --------
    >>> from rsflow.reproduce import real_motion
    >>> rows = real_motion(frames=2)
    >>> len(rows), max(abs(row.frame_error) for row in rows) < 0.01
    (24, True)
    """
    frames = _checks.integer("frames", frames, least=2, most=10_000)
    seed = _checks.integer("seed", seed, least=0)
    if progress is not None:
        _checks.function("progress", progress, 2)
    rows = report()["table_4_3_real_motion"]
    results = []
    for number, row in enumerate(rows):
        results.append(_flown(row, webcam_flight(row, frames=frames, seed=1000 * seed + number)))
        if progress is not None:
            progress(number + 1, len(rows))
    return tuple(results)


def _flown(row: Mapping[str, Any], flown: Flight) -> RealMotion:
    height_m = row["height_cm"] / 100.0
    x, y, width, height = CROP
    missed = np.zeros(len(flown), dtype=bool)
    measured: list[tuple[float, float, float]] = []
    for camera, images in (
        (flown.camera.cropped(CROP), flown.images[:, y : y + height, x : x + width]),
        (flown.camera, flown.images),
    ):
        estimator = VelocityEstimator(camera, height_m=height_m)
        speeds, flows, errors = [], [], []
        for k, (image, t_s) in enumerate(zip(images, flown.t_s, strict=True)):
            v = estimator.update(image, float(t_s))
            if v.valid:
                truth, found = flown.velocity_m_s[k, :2], np.array([v.vx_m_s, v.vy_m_s])
                speed_m_s = float(np.linalg.norm(truth))
                speeds.append(100.0 * float(truth @ found) / speed_m_s)
                errors.append(float(np.linalg.norm(found - truth)) / speed_m_s)
                flows.append(v.flow_px)
            else:
                missed[k] |= k > 0
        known = bool(speeds)
        measured.append(
            (
                float(np.mean(flows)) if known else np.nan,
                float(np.mean(speeds)) if known else np.nan,
                max(errors) if known else np.nan,
            )
        )
    (window_flow, window_speed, window_worst), (frame_flow, frame_speed, frame_worst) = measured
    speed, rate = row["actual_velocity_cm_s"], row["frames_per_second"]
    return RealMotion(
        height_cm=row["height_cm"],
        frames_per_second=rate,
        actual_cm_s=speed,
        report_flow_px=row["flow_px"],
        report_cm_s=row["estimated_velocity_cm_s"],
        true_flow_px=implied_focal_length().mean_px * speed / row["height_cm"] / rate,
        window_flow_px=window_flow,
        window_cm_s=window_speed,
        frame_flow_px=frame_flow,
        frame_cm_s=frame_speed,
        window_worst=window_worst,
        frame_worst=frame_worst,
        missed=int(missed.sum()),
    )


@dataclass(frozen=True)
class Group:
    """The three runs of table 4-3 at one height, frame rate and speed: relative errors of the mean velocity.

    Examples
    --------
    >>> from rsflow.reproduce import RealMotion, groups
    >>> row = RealMotion(10.0, 30.0, 2.0, 4.0, 2.1, 3.9, 3.9, 2.01, 3.9, 2.0, 0.01, 0.0, 0)
    >>> groups([row])[0].frame_error
    0.0
    """

    height_cm: float
    frames_per_second: float
    actual_cm_s: float
    report_error: float
    window_error: float
    frame_error: float


def groups(rows: Sequence[RealMotion]) -> list[Group]:
    """Average the runs as the report does; its last column has the errors of the groups at 2 cm/s.

    Parameters
    ----------
    rows : sequence of RealMotion
        From `real_motion`.

    Returns
    -------
    list of Group

    Examples
    --------
    >>> from rsflow.reproduce import RealMotion, groups
    >>> row = RealMotion(10.0, 30.0, 2.0, 4.0, 2.1, 3.9, 3.9, 2.01, 3.9, 2.0, 0.01, 0.0, 0)
    >>> [group] = groups([row, row])
    >>> group.actual_cm_s, round(group.report_error, 3)
    (2.0, 0.05)
    """
    found: dict[tuple[float, float, float], list[RealMotion]] = {}
    for row in _checks.iterable("rows", rows, "RealMotions"):
        _checks.instance("rows", row, RealMotion, "RealMotions")
        found.setdefault((row.height_cm, row.frames_per_second, row.actual_cm_s), []).append(row)
    return [
        Group(
            *key,
            *(
                float(np.mean([getattr(run, name) for run in runs])) / key[2] - 1.0
                for name in ("report_cm_s", "window_cm_s", "frame_cm_s")
            ),
        )
        for key, runs in found.items()
    ]
