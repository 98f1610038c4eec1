"""The estimator: frames in, velocities out.

docs/explanation/algorithms.md, section "Velocity over a plane: VelocityEstimator".
"""

from __future__ import annotations

import numbers
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import options
from .._shared import Shared, alone, anew
from ..camera.model import Camera
from ..errors import DTypeError, FormatError, OptionError, ShapeError
from .chain import Chain, GyroState, Settings, Told
from .result import Velocity

__all__ = ["VelocityEstimator"]

F64 = NDArray[np.float64]

# Beyond this a length in metres, or a rate, is no measurement, and its square no number.
_MOST = 1e12


class VelocityEstimator(Shared):
    """Velocity of a camera over flat ground, frame by frame.

    Points of the ground are followed from frame to frame, freed from distortion, turned by the measured rate, each by
    itself, and a plane's motion (`vx`, `vy`, and `vz` and yaw as far as the data demand them) is fitted to all of them
    at once, weighted by their covariances and robust against what moves by itself. It is the report's equations 2.10
    and 2.11 with the y row mended, with principal point, distortion, attitude and rotation.

    Threads that share one wait for each other. A copy, or a pickle read anywhere, goes on with the same bits.

    Without `rate_rad_s` a camera that rolls or pitches looks much like one that moves. The rotation is then solved for
    with the motion, as far as the field of view tells both apart, and what is left of it is in the covariance: of a
    rotation that nobody measures 0.3 rad/s are expected about each axis at first, later what was seen.

    Parameters
    ----------
    camera : Camera
        For pictures of the size that `update` gets; see `Camera.scaled` and `Camera.cropped`. Where it knows the
        deviations of its parameters (`Camera.std`), they enter the covariance.
    height_m : float, optional
        Perpendicular distance from the ground plane, where it is constant.
    height_std_m : float, optional
        Standard deviation of the heights or ranges; 0 says that they are exact. Without it the covariance holds for an
        exact height, and `Velocity.unstated` says that the height's share is missing: a velocity is only as exact as
        its height.
    rate_std_rad_s : float, optional
        Standard deviation of each axis of the rates that `update` gets, as means over an interval, or, without rates,
        of the rotation itself. Without it the deviation is learned from what the pictures show; 0 says that rates are
        exact. A deviation that the pictures clearly contradict is not believed.
    rate_delay_std_s : float, optional
        How well it is known that rates and frames belong to the same time: 10 ms by default, 0 where it is exact. Bias
        and delay of the rates are learned, see `gyro`.
    dt_std_s : float, optional
        Standard deviation of the time between two frames. Without it, times that do not fit a steady flow are told and
        widen the covariance.
    readout_s : float, optional
        Time from the first row of a frame to its last one, of a rolling shutter; the time of a frame is that of its
        middle row. 0: all rows at once. Without it, it is learned and told where rows contradict each other: where the
        camera turns. A steady way over level ground does not show it, and is wrong by the share of the picture's height
        that it moves on during the readout.
    down_std_rad : float, optional
        Standard deviation of the direction straight down about two axes. Without it, what `update` gets is exact, and
        so is level ground where it gets none.
    max_height_gap_s : float
        For how long a missing height is carried on by the vertical velocity that the pictures show.
    max_speed_m_s : float, optional
        The highest speed over the ground that is possible. On ground that repeats, such as tiles, it tells which of
        several motions it was; 7.5 heights a second by default.
    R_body_from_camera : (3, 3) array_like
        Rotation from the camera's axes to the body's.
    lever_arm_m : (3,) array_like
        Position of the camera in the body frame; only `Velocity.origin_velocity_m_s` depends on it.
    mask : (height, width) ndarray of bool, optional
        True where a pixel counts, in every frame: False where the picture shows what goes with the camera, such as a
        part of the vehicle or letters over the picture.

    Raises
    ------
    OptionError, ShapeError, DTypeError
        If a height is not above 0, a deviation below 0, the matrix not a rotation, or an argument of another kind.

    Examples
    --------
    >>> from rsflow import Camera, VelocityEstimator, synthetic
    >>> flight = synthetic.flight(frames=2, height_m=0.2, velocity_m_s=(0.02, 0.01, 0.0), seed=1)
    >>> estimator = VelocityEstimator(flight.camera, height_m=0.2)
    >>> estimator.update(flight.images[0], flight.t_s[0]).status.name
    'FIRST_FRAME'
    >>> v = estimator.update(flight.images[1], flight.t_s[1], rate_rad_s=(0, 0, 0))
    >>> v.valid, bool(abs(v.vx_m_s - 0.02) < 2e-3), bool(abs(v.vy_m_s - 0.01) < 2e-3)
    (True, True, True)
    """

    _state_version = 2
    _state_types: ClassVar = {
        "camera": (Camera,),
        **dict.fromkeys(
            (
                "height_m",
                "height_std_m",
                "rate_std_rad_s",
                "rate_delay_std_s",
                "dt_std_s",
                "readout_s",
                "down_std_rad",
                "max_speed_m_s",
            ),
            (numbers.Real, type(None)),
        ),
        "max_height_gap_s": (numbers.Real,),
        "R_body_from_camera": (np.ndarray,),
        "lever_arm_m": (np.ndarray,),
        "mask": (np.ndarray, type(None)),
        "_chain": (Chain,),
    }

    def __init__(
        self,
        camera: Camera,
        *,
        height_m: float | None = None,
        height_std_m: float | None = None,
        rate_std_rad_s: float | None = None,
        rate_delay_std_s: float | None = None,
        dt_std_s: float | None = None,
        readout_s: float | None = None,
        down_std_rad: float | None = None,
        max_height_gap_s: float = 1.0,
        max_speed_m_s: float | None = None,
        R_body_from_camera: ArrayLike | None = None,
        lever_arm_m: ArrayLike = (0.0, 0.0, 0.0),
        mask: NDArray[np.bool_] | None = None,
    ) -> None:
        self.camera = _checks.instance("camera", camera, Camera, "an rsflow.Camera")
        self.height_m = _checks.number_or_none("height_m", height_m, least=1 / _MOST, most=_MOST, of="metres")
        std = partial(_checks.number_or_none, least=0, most=_MOST)
        self.height_std_m = std("height_std_m", height_std_m, of="metres")
        self.rate_std_rad_s = std("rate_std_rad_s", rate_std_rad_s, of="rad/s")
        self.rate_delay_std_s = std("rate_delay_std_s", rate_delay_std_s, of="seconds")
        self.dt_std_s = std("dt_std_s", dt_std_s, of="seconds")
        self.readout_s = _checks.number_or_none("readout_s", readout_s, least=-10, most=10, of="seconds")
        self.down_std_rad = std("down_std_rad", down_std_rad, of="radians")
        self.max_height_gap_s = _checks.number("max_height_gap_s", max_height_gap_s, least=0, most=_MOST, of="seconds")
        self.max_speed_m_s = _checks.number_or_none("max_speed_m_s", max_speed_m_s, above=0, most=_MOST, of="m/s")
        rotation = "a rotation, (3, 3): orthonormal rows, determinant 1"
        turn = np.eye(3)
        if R_body_from_camera is not None:
            given = _checks.array("R_body_from_camera", R_body_from_camera, (3, 3), rotation, finite=True)
            turn = given.astype(np.float64)
            orthonormal = np.abs(turn).max() < 2 and np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
            if not orthonormal or np.linalg.det(turn) < 0:
                raise OptionError(f"R_body_from_camera: got {turn.tolist()}, expected {rotation}")
        self.R_body_from_camera = turn
        self.lever_arm_m = _vector("lever_arm_m", lever_arm_m)
        given_mask = _checks.mask_or_none("mask", mask, self.camera.size[::-1], "the camera's pictures")
        self.mask = None if given_mask is None else given_mask.copy()
        self._chain = self._begin()

    def _begin(self) -> Chain:
        return Chain(Settings(**{name: getattr(self, name) for name in Settings.__dataclass_fields__}))

    def __repr__(self) -> str:
        knobs = {name: getattr(self, name) for name in ("height_m", "height_std_m", "rate_std_rad_s")}
        told = options(**knobs, mask=self.mask is not None)
        camera = f"{self.camera.width} x {self.camera.height} camera"
        chain = self._chain
        before = "no frame yet" if chain.prev is None else f"last frame at {chain.prev_t_s:.6g} s"
        return f"VelocityEstimator({camera}{', ' if told else ''}{told}): {before}"

    @property
    def gyro(self) -> GyroState:
        """What the pictures told of the bias and the delay of the rates, in the body's axes."""
        return self._chain.rotation.gyro

    @anew
    def reset(self) -> None:
        """Forget the frame before and what was learned: the next one is a first frame."""
        self._chain = self._begin()

    @alone
    def update(
        self,
        image: NDArray[Any],
        t_s: float,
        *,
        height_m: float | None = None,
        range_m: float | None = None,
        height_std_m: float | None = None,
        rate_rad_s: ArrayLike | None = None,
        down: ArrayLike | None = None,
    ) -> Velocity:
        """Take the next frame and measure the velocity since the one before.

        What is not known at a frame (NaN; a height or range that is not above 0 or infinite, as range finders say it;
        a direction of no length) counts as missing: a height is carried on for a while, a rate is solved for, and
        straight down is where it was.

        Parameters
        ----------
        image : (height, width) uint8, uint16 or float32
            Grey picture of the camera's size.
        t_s : float
            Its time in seconds.
        height_m : float, optional
            Perpendicular distance from the ground plane at this frame.
        range_m : float, optional
            Instead of a height: the distance to the ground along the optical axis.
        height_std_m : float, optional
            Standard deviation of this height or range; by default that of all.
        rate_rad_s : (3,) array_like, optional
            Mean angular rate of the body since the previous frame, right-handed, in the body frame.
        down : (3,) array_like, optional
            Straight down in the body frame at this frame, of any length; by default the optical axis: level ground.
            Two in a row tell the rotation but that about themselves, where no rate does.

        Returns
        -------
        Velocity

        Raises
        ------
        OptionError
            If `t_s` is not finite, a height is below 0, height and range are both given, or an argument is no number or
            no vector.
        ShapeError, DTypeError
            If the image does not have the camera's size, is not grey or of another type.
        """
        self._check_image(image)
        t_s = _time(t_s)
        if height_m is not None and range_m is not None:
            raise OptionError("height_m, range_m: got both, expected one of them")
        straight = self._straight_down(down)
        cosine = 1.0 if straight is None else float(straight[2])
        height, std = self._height(height_m, range_m, height_std_m, cosine)
        return self._chain.step(image, Told(t_s, height, std, _vector_or_none("rate_rad_s", rate_rad_s), straight))

    def _check_image(self, image: Any) -> None:
        height, width = _checks.frame("image", image).shape
        prev = self._chain.prev
        if prev is not None and image.dtype != prev.dtype:
            raise DTypeError(
                f"image: got dtype {image.dtype}, expected that of the frame before, {prev.dtype}; "
                "reset() starts another sequence"
            )
        if (width, height) != self.camera.size:
            raise ShapeError(
                f"image: got {width} x {height} pixels, expected the camera's {self.camera.width} x "
                f"{self.camera.height}; use camera.scaled({width}, {height}) or camera.cropped(...)"
            )

    def _straight_down(self, down: ArrayLike | None) -> F64 | None:
        """Straight down in the camera's axes; None where nobody tells."""
        given = _vector_or_none("down", down)
        length = 0.0 if given is None else float(np.linalg.norm(given))
        return None if given is None or length == 0 else self.R_body_from_camera.T @ given / length

    def _height(
        self, height_m: float | None, range_m: float | None, height_std_m: float | None, cosine: float
    ) -> tuple[float, float]:
        """Height and its deviation; NaN where none is known for this frame."""
        std = self.height_std_m or 0.0
        if height_std_m is not None:
            std = _checks.number("height_std_m", height_std_m, least=0, most=_MOST, of="metres")
        if range_m is not None:
            return _length("range_m", range_m) * cosine, std * abs(cosine)
        if height_m is None:
            return (np.nan if self.height_m is None else self.height_m), std
        return _length("height_m", height_m), std

    def _packed(self, state: dict[str, Any]) -> dict[str, Any]:
        return {**state, "_chain": self._chain.state()}

    def _unpacked(self, state: dict[str, Any]) -> dict[str, Any]:
        # What it is made of is looked at before it is made.
        for part, types in {**self._state_types, "_chain": (dict,)}.items():
            if not isinstance(state.get(part, self), types):
                raise FormatError(f"the state of a VelocityEstimator is damaged: {part!r}")
        made = type(self).__new__(type(self))
        made.__dict__.update(state)
        chain = made._begin()
        chain.restore(state["_chain"])
        return {**state, "_chain": chain}


def _time(t_s: float) -> float:
    t_s = _checks.number("t_s", t_s, least=-_MOST, most=_MOST, of="seconds", or_nan=True)
    if not np.isfinite(t_s):
        raise OptionError(
            f"t_s: got {t_s}, expected a finite number of seconds; pictures of a folder carry no times: "
            "give their rate (rsflow.frames(..., frame_rate=30), or --rate 30 on the command line)"
        )
    return t_s


def _length(name: str, value: float) -> float:
    """Take a length; NaN where it is none."""
    if isinstance(value, (float, np.floating)) and not np.isfinite(value):
        return np.nan
    found = _checks.number(name, value, least=0, of="metres", or_nan=True)
    return found if 1 / _MOST <= found <= _MOST else np.nan


def _vector(name: str, value: ArrayLike) -> F64:
    vector = _checks.vector(name, value, 3, "three finite numbers")
    if np.abs(vector).max() > _MOST:
        raise OptionError(f"{name}: got {vector.tolist()}, expected numbers up to {_MOST:g}")
    return vector


def _vector_or_none(name: str, value: ArrayLike | None) -> F64 | None:
    """Take three numbers; None where one of them is not known."""
    if value is None:
        return None
    found = _checks.array(name, value, (3,), "three numbers").astype(np.float64)
    return found if np.isfinite(found).all() and np.abs(found).max() <= _MOST else None
