"""The question that users ask: is the focal length right, are a gyro's axes, its mounting and its times."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from ..camera import Camera
from ..capture import Frames, FrameSource, frames
from ..errors import OptionError, ShapeError
from .gyro_check import GyroQuestion, check_against_gyro
from .pairs import follow_clip
from .rate_log import RateLog
from .result import ScaleCheck
from .speed_check import SpeedQuestion, check_against_distance, check_against_speed
from .travel import Travel, measure_travel

__all__ = ["check_scale"]

F64 = NDArray[np.float64]

# Larger numbers are not rates or speeds of anything.
_MOST = 1e6


def check_scale(
    source: FrameSource,
    camera: Camera,
    *,
    t_s: ArrayLike | None = None,
    rate_rad_s: ArrayLike | None = None,
    velocity_m_s: ArrayLike | None = None,
    speed_m_s: ArrayLike | None = None,
    distance_m: float | None = None,
    known_std: float | None = None,
    height_m: ArrayLike | None = None,
    height_t_s: ArrayLike | None = None,
    height_std_m: float | None = None,
    readout_s: float | None = None,
    bias_std_rad_s: float = 0.02,
    max_delay_s: float = 0.5,
    R_body_from_camera: ArrayLike | None = None,
    mask: NDArray[np.bool_] | None = None,
) -> ScaleCheck:
    """Check a set-up from a short clip: focal length, axes, mounting, time offset, rolling shutter.

    Give one of these, and what is wrong comes back in words and figures with 95 % intervals:

    - `rate_rad_s`: turn the camera in place by hand, to and fro about all of its axes, for some five to twenty
      seconds before a scene that stands still, and give the gyro's log. The camera should turn about its own centre:
      each centimetre that its centre is away from the axis, seen from a scene one metre away, is 1 % of the focal
      length. The gyro's scale is taken for right.
    - `velocity_m_s` or `speed_m_s`: travel over flat ground at a known height and speed.
    - `distance_m`: travel a known way over flat ground at a known height.

    What the clip cannot tell is NaN with an infinite deviation, and is said in `untold`: nothing about the focal
    length without a turn about the camera's x or y axis, nothing about the delay at a steady rate.

    Parameters
    ----------
    source : anything that `rsflow.frames` takes
        The clip; its frames need times.
    camera : Camera
        As it is believed to be.
    t_s : (M,) array_like, optional
        Times of the log in seconds, increasing, by the clock of the frames but for the delay that is sought.
    rate_rad_s : (M, 3) array_like, optional
        Angular rates of the body at these times, right-handed; rows with NaN are left out. Degrees a second are
        found out and told.
    velocity_m_s : (M, 3) or (M, 2) array_like, optional
        Velocity of the body at these times, in its axes.
    speed_m_s : float or (M,) array_like, optional
        Speed over the ground: constant, or at these times.
    distance_m : float, optional
        Length of the camera's way from the first frame to the last one.
    known_std : float, optional
        Standard deviation of velocity, speed or distance that all of the clip shares, in their unit.
    height_m : float or (H,) array_like, optional
        Perpendicular distance from the ground; needed but for a gyro. With `height_t_s` (H,) read between these times.
    height_std_m : float, optional
        Its standard deviation.
    readout_s : float, optional
        Time from the first row of a picture to the last one as stated by the maker, 0 for a global shutter; against
        a gyro it is measured, and held against this or 0.
    bias_std_rad_s : float, optional
        Standard deviation of a gyro's bias before it is known.
    max_delay_s : float, optional
        How late or early the log may be.
    R_body_from_camera : (3, 3) array_like, optional
        Rotation from the camera's axes to the body's as it is believed to be; by default the same axes.
    mask : (height, width) ndarray of bool, optional
        True where a pixel counts.

    Returns
    -------
    ScaleCheck

    Raises
    ------
    OptionError, ShapeError, DTypeError
        If arguments do not fit together; the message says which and how.

    Notes
    -----
    Points are followed from each frame to the next, and each pair gives a rotation with its derivatives by focal length
    and readout time. Focal length, the gyro's axes, delay, bias and readout are then fitted together to the integral of
    the gyro's rates; intervals are the larger of what the noise says and of a jackknife over blocks of the clip [1]_.

    References
    ----------
    .. [1] B. Efron and R. Tibshirani, "An introduction to the bootstrap", Chapman & Hall 1993, chapter 11.

    Examples
    --------
    A gyro whose y axis has the wrong sign, and a camera file whose focal length is 5 % too long:

    >>> import dataclasses, numpy as np, rsflow
    >>> turn = lambda t: 0.5 * np.stack([np.sin(9 * t), np.cos(7 * t), np.sin(5 * t + 1)], axis=-1)
    >>> flight = rsflow.synthetic.flight(frames=41, velocity_m_s=(0, 0, 0), rate_rad_s=turn, seed=1)
    >>> camera = dataclasses.replace(flight.camera, fx=189.0, fy=189.0)
    >>> t = np.arange(-5, 145) / 100
    >>> check = rsflow.check_scale(flight, camera, t_s=t, rate_rad_s=turn(t) * (1, -1, 1))
    >>> check.axes, round(check.focal_px.value)
    (('+x', '-y', '+z'), 180)
    >>> print(check.findings[0])
    the sign of y is wrong
    """
    camera = _checks.instance("camera", camera, Camera, "an rsflow.Camera")
    given = {
        "rate_rad_s": rate_rad_s,
        "velocity_m_s": velocity_m_s,
        "speed_m_s": speed_m_s,
        "distance_m": distance_m,
    }
    names = [name for name, value in given.items() if value is not None]
    if len(names) != 1:
        got = " and ".join(names) if names else "none"
        raise OptionError(f"{', '.join(given)}: got {got}, expected one of them, to hold the clip against")
    body = np.eye(3) if R_body_from_camera is None else _rotation(R_body_from_camera)
    readout = _checks.number_or_none("readout_s", readout_s, least=-1, most=1, of="seconds")
    bias_std = _checks.number("bias_std_rad_s", bias_std_rad_s, least=1e-6, most=10, of="radians a second")
    max_delay = _checks.number("max_delay_s", max_delay_s, least=0.01, most=60, of="seconds")
    height_std = _checks.number_or_none("height_std_m", height_std_m, least=0, most=1e9, of="metres")
    known = _checks.number_or_none("known_std", known_std, least=0, most=1e9)
    times = None if t_s is None else _times("t_s", t_s)
    columns = {"rate_rad_s": (3,), "velocity_m_s": (2, 3), "speed_m_s": (), "distance_m": ()}[names[0]]
    value = _values(names[0], given[names[0]], times, columns)
    heights = None if height_m is None else _heights(height_m, height_t_s)
    if names[0] == "rate_rad_s":
        log = RateLog.of(*_finite(times, value, names[0]))
        question = GyroQuestion(body.T, readout or 0.0, bias_std, max_delay)
        pairs, count = _followed(source, camera, mask)
        return check_against_gyro(pairs, camera, log, question, count)
    if heights is None:
        raise OptionError("height_m: got None, expected the height over the ground: a speed in pixels needs one")
    middle = float(np.median(heights[1]))
    size = float(np.sqrt(np.nanmean(value**2) * (value.shape[1] if value.ndim == 2 else 1)))
    asked = SpeedQuestion(
        None if height_std is None else height_std / middle,
        None if known is None else known / max(size, 1e-12),
        readout,
        max_delay,
    )
    travel = _travelled(source, camera, heights, mask)
    if names[0] == "distance_m":
        return check_against_distance(travel, camera, float(value), asked)
    if value.ndim == 0:
        return check_against_speed(travel, camera, None, float(value), False, asked)
    vector = value.ndim == 2
    wide = np.zeros((len(value), 3))
    if vector:
        wide[:, : value.shape[1]] = value
        wide = wide @ body
    else:
        wide[:, 0] = value
    return check_against_speed(travel, camera, RateLog.of(*_finite(times, wide, names[0])), np.nan, vector, asked)


def _followed(source: Any, camera: Camera, mask: Any) -> tuple[list[Any], int]:
    """Follow points through the clip, whose pictures have to be the camera's."""
    with _opened(source) as clip:
        pairs, size, count = follow_clip(clip, _mask(mask))
    _expect_size(size, camera, count)
    return pairs, count


def _travelled(source: Any, camera: Camera, heights: tuple[F64, F64], mask: Any) -> Travel:
    with _opened(source) as clip:
        return measure_travel(clip, camera, heights, _mask(mask))


def _opened(source: Any) -> Frames:
    return source if isinstance(source, Frames) else frames(source)


def _mask(mask: Any) -> NDArray[np.bool_] | None:
    return None if mask is None else _checks.mask("mask", mask)


def _expect_size(size: tuple[int, int], camera: Camera, count: int) -> None:
    if count and size != (camera.width, camera.height):
        raise ShapeError(
            f"source: got frames of {size[0]} x {size[1]} pixels, expected those of the camera, "
            f"{camera.width} x {camera.height}: see Camera.scaled and Camera.cropped"
        )


def _times(name: str, value: object) -> F64:
    expected = "finite times in seconds, each later than the one before"
    times = _checks.array(name, value, ("M",), expected, finite=True).astype(np.float64)
    if (np.diff(times) <= 0).any():
        at = int(np.argmax(np.diff(times) <= 0)) + 1
        raise OptionError(f"{name}[{at}]: got {times[at]:g} after {times[at - 1]:g}, expected {expected}")
    return times


def _values(name: str, value: Any, times: F64 | None, columns: tuple[int, ...]) -> F64:
    """Take a series of the log, or one number where that may be."""
    if not columns:
        single = _checks.array(name, value, ..., "a number, or one for each time of t_s")
        if single.ndim == 0 or name == "distance_m":
            of = "metres" if name == "distance_m" else "metres a second"
            return np.asarray(_checks.number(name, value, above=0, most=_MOST, of=of))
    if times is None:
        raise OptionError(f"t_s: got None, expected the times of {name}")
    shapes = [f"({len(times)}, {c})" for c in columns] or [f"({len(times)},)"]
    expected = f"one for each of the {len(times)} times of t_s: {_checks.any_of(shapes)}"
    found = _checks.array(name, value, ..., expected).astype(np.float64)
    if found.ndim != (2 if columns else 1) or len(found) != len(times) or (columns and found.shape[1] not in columns):
        raise ShapeError(f"{name}: got shape {found.shape}, expected {expected}")
    if (np.abs(found[np.isfinite(found)]) > _MOST).any():
        raise OptionError(f"{name}: got {np.nanmax(np.abs(found)):g}, expected numbers up to {_MOST:g}")
    return np.where(np.isfinite(found), found, np.nan)


def _finite(times: F64 | None, value: F64, name: str) -> tuple[F64, F64]:
    """Take a log of which enough is known."""
    known = int(np.isfinite(value).all(axis=1).sum())
    if times is None or known < 8:
        raise OptionError(f"{name}: got {known} rows without NaN, expected at least 8")
    return times, value


def _heights(height_m: Any, height_t_s: Any) -> tuple[F64, F64]:
    found = _checks.array("height_m", height_m, ..., "metres above 0, or some for each time of height_t_s", finite=True)
    if height_t_s is None:
        height = _checks.number("height_m", height_m, above=0, most=1e9, of="metres")
        return np.zeros(1), np.array([height])
    times = _times("height_t_s", height_t_s)
    if found.shape != times.shape or not len(times):
        raise ShapeError(f"height_m: got shape {found.shape}, expected that of height_t_s, {times.shape}")
    if (found <= 0).any():
        raise OptionError(f"height_m: got {found.min():g}, expected metres above 0")
    return times, found.astype(np.float64)


def _rotation(value: object) -> F64:
    matrix = _checks.array("R_body_from_camera", value, (3, 3), "a rotation matrix (3, 3)", finite=True)
    matrix = matrix.astype(np.float64)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0:
        raise OptionError("R_body_from_camera: got a matrix that turns and stretches or mirrors, expected a rotation")
    return matrix
