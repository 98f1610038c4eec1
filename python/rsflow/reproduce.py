"""The report's experiments again: its tables 4-1, 4-2 and 4-3 beside what rsflow measures.

The report, "Extract motion from picture sequence", crops two windows of 60 x 60 pixels from a photograph, brightens the
second and compares known with calculated displacement, with and without compensation of the light (tables 4-1 and
4-2); then it flies a webcam over the ground and compares velocities (table 4-3). Its figures are data of this package.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera.model import Camera
from .errors import OptionError
from .shift import estimate_shift
from .synthetic import Flight, Lighting, Sensor, auto_exposure, flight, gain, offset, ramp, texture
from .synthetic.textures import CONTRAST_LEVELS, MEAN_LEVEL
from .velocity import VelocityEstimator

__all__ = [
    "CONDITIONS",
    "FocalLength",
    "RealMotion",
    "SyntheticMotion",
    "implied_focal_length",
    "photographs",
    "real_motion",
    "report",
    "synthetic_motion",
    "textures",
]

# Side of the report's windows, in pixels.
WINDOW = 60
# The report's crop of the frames of table 4-3 (appendix A: imcrop at [60 20], counted from 1).
CROP = (59, 19, WINDOW, WINDOW)
# The frame size of table 4-3.
FRAME = (176, 144)
# The report's second window is brighter; it does not say by how much. A tenth of the full scale.
RISE = 25.0


@lru_cache(maxsize=1)
def report() -> Mapping[str, Any]:
    """Read the report's calibration and tables, as they are printed.

    Examples
    --------
    >>> len(report()["table_4_1_with_illumination_correction"])
    39
    """
    text = resources.files("rsflow").joinpath("data/report.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def photographs() -> dict[str, NDArray[np.uint8]]:
    """Photographs that scikit-image ships, by name.

    Raises
    ------
    MissingExtraError
        If scikit-image is not installed.
    """
    from ._extras import require

    data = require("skimage.data", extra="reproduce", purpose="reproducing tables 4-1 and 4-2 on photographs")
    return {name: getattr(data, name)() for name in ("brick", "grass", "gravel", "camera")}


def textures() -> dict[str, NDArray[np.uint8]]:
    """Textures of rsflow's own, for where there are no photographs."""
    found = {}
    for name, kind in (("fine texture", "fine"), ("smooth texture", "smooth"), ("ground texture", "ground")):
        levels = MEAN_LEVEL + CONTRAST_LEVELS * texture((256, 256), kind, seed=7)
        found[name] = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return found


@dataclass(frozen=True)
class Condition:
    """What happens to the second window: light, noise in both windows, and whether the light is compensated."""

    name: str
    light: Lighting | None = None
    noise: float = 0.0
    illumination: str = "gain_offset"


# The first two are the report's tables 4-1 and 4-2.
CONDITIONS: tuple[Condition, ...] = (
    Condition("brighter, compensated", offset(RISE)),
    Condition("brighter, not compensated", offset(RISE), illumination="none"),
    Condition("steady light", None),
    Condition("gain 0.8", gain(0.8)),
    Condition("ramp 0.7 to 1.0", ramp(0.7, 1.0)),
    Condition("brighter, noise 2 levels", offset(RISE), noise=2.0),
)


@dataclass(frozen=True)
class SyntheticMotion:
    """Tables 4-1 and 4-2 again, in one condition.

    Attributes
    ----------
    condition : str
    pictures : tuple of str
    actual_px : (39, 2) float64
        The displacements of table 4-1, in its order.
    report_px : (39, 2) float64 or None
        What the report calculated, where it has this condition; NaN where it left a row out.
    measured_px : (pictures, 39, 2) float64
        What rsflow measured; NaN where it says that it cannot.
    """

    condition: str
    pictures: tuple[str, ...]
    actual_px: NDArray[np.float64]
    report_px: NDArray[np.float64] | None
    measured_px: NDArray[np.float64]

    @property
    def errors_px(self) -> NDArray[np.float64]:
        """Length of the error of each measurement, (pictures, 39)."""
        return np.asarray(np.linalg.norm(self.measured_px - self.actual_px, axis=2), dtype=np.float64)

    @property
    def report_errors_px(self) -> NDArray[np.float64]:
        """Length of the report's errors, (39,); NaN where it has none."""
        if self.report_px is None:
            return np.full(len(self.actual_px), np.nan)
        return np.asarray(np.linalg.norm(self.report_px - self.actual_px, axis=1), dtype=np.float64)


def synthetic_motion(pictures: Mapping[str, NDArray[Any]], condition: Condition, *, seed: int = 0) -> SyntheticMotion:
    """Measure the report's 39 displacements between windows cropped from pictures.

    Parameters
    ----------
    pictures : mapping of name to (height, width) uint8
        At least 81 pixels in each direction, so that the largest displacement fits.
    condition : Condition
        One of `CONDITIONS`.
    seed : int
        Of the noise.

    Raises
    ------
    OptionError
        If a picture is too small or not grey uint8.

    Notes
    -----
    Both windows are cropped, as in the report: what left the first one is not seen in the second.
    """
    with_light = report()["table_4_1_with_illumination_correction"]
    actual = np.array([row["actual_px"] for row in with_light], dtype=np.float64)
    least = WINDOW + 2 * int(np.abs(actual).max()) + 1
    found = np.full((len(pictures), len(actual), 2), np.nan)
    sensor = Sensor(noise=condition.noise)
    rng = np.random.default_rng(seed)
    for i, (name, picture) in enumerate(pictures.items()):
        if picture.ndim != 2 or picture.dtype != np.uint8 or min(picture.shape) < least:
            raise OptionError(
                f"reproduce: {name} is {picture.dtype} of shape {picture.shape}, "
                f"expected grey uint8 of at least {least} x {least} pixels"
            )
        y, x = ((side - WINDOW) // 2 for side in picture.shape)
        for j, (dx, dy) in enumerate(actual.astype(int)):
            # What is at (x, y) of the first window is at (x + dx, y + dy) of the second: that starts further up.
            first, second = (
                np.ascontiguousarray(picture[b : b + WINDOW, a : a + WINDOW])
                for a, b in ((x, y), (x - int(dx), y - int(dy)))
            )
            lit = second.astype(np.float64) if condition.light is None else condition.light(second.astype(np.float64))
            if condition.noise:
                first = sensor.expose(first.astype(np.float64), rng)
            second = sensor.expose(lit, rng)
            shift = estimate_shift(first, second, illumination=condition.illumination)
            found[i, j] = (shift.dx, shift.dy) if shift.valid else np.nan
    table = {
        "brighter, compensated": "table_4_1_with_illumination_correction",
        "brighter, not compensated": "table_4_2_without_illumination_correction",
    }.get(condition.name)
    printed = None
    if table is not None:
        rows = {tuple(row["actual_px"]): row["estimated_px"] for row in report()[table]}
        printed = np.array([rows.get((int(dx), int(dy)), (np.nan, np.nan)) for dx, dy in actual])
    return SyntheticMotion(condition.name, tuple(pictures), actual, printed, found)


@dataclass(frozen=True)
class FocalLength:
    """The focal length in pixels that the report's printed velocities follow from.

    Attributes
    ----------
    rows_px : (24,) float64
        Height x flow x frame rate / velocity of each row of table 4-3.
    mean_px, spread_px : float
        Their mean and standard deviation.
    calibrated_px : float
        What the report's own calibration says (figure 4-1), at 640 x 480.
    """

    rows_px: NDArray[np.float64]
    mean_px: float
    spread_px: float
    calibrated_px: float


def implied_focal_length() -> FocalLength:
    """Solve the report's equation 2.11 for the focal length in every row of its table 4-3.

    Examples
    --------
    >>> f = implied_focal_length()
    >>> round(f.mean_px, 1), round(f.spread_px, 2), round(f.calibrated_px, 1)
    (1217.3, 0.04, 657.8)
    """
    rows = np.array([
        row["height_cm"] * row["flow_px"] * row["frames_per_second"] / row["estimated_velocity_cm_s"]
        for row in report()["table_4_3_real_motion"]
    ])  # fmt: skip
    calibrated = float(np.mean(report()["calibration"]["focal_length_px"]))
    return FocalLength(rows, float(rows.mean()), float(rows.std(ddof=1)), calibrated)


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
    """
    if frames < 2:
        raise OptionError(f"reproduce: frames is {frames}, expected 2 or more")
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
    """The three runs of table 4-3 at one height, frame rate and speed: relative errors of the mean velocity."""

    height_cm: float
    frames_per_second: float
    actual_cm_s: float
    report_error: float
    window_error: float
    frame_error: float


def groups(rows: Sequence[RealMotion]) -> list[Group]:
    """Average the runs as the report does; its last column has the errors of the groups at 2 cm/s."""
    found: dict[tuple[float, float, float], list[RealMotion]] = {}
    for row in rows:
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
