"""The estimator: frames in, velocities out.

docs/algorithms.md, section "Velocity over a plane: VelocityEstimator".
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
from ..errors import DTypeError, OptionError, ShapeError
from . import budget, plane, search
from .height import Height, HeightKeeper
from .result import Velocity, VelocityStatus, unmeasured
from .rotation import GyroState, RotationModel
from .watch import Watch

__all__ = ["VelocityEstimator"]

F64 = NDArray[np.float64]

# Beyond this a length in metres, or a rate, is no measurement, and its square no number.
_MOST = 1e12
# Deviation in pixels of what all tiles of a pair have in common, since all lie at one sub-pixel phase: the error of
# interpolation does not average out. Measured on flights over the finest texture.
_COMMON_PX = 0.0003
# A velocity leads on to the next frames for so long.
_LEADS_S = 0.5
# A parameter is demanded where it differs from zero by this many of its own standard deviations.
_DEMANDED = 3.0


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
    readout_s : float
        Time from the first row of a frame to its last one, of a rolling shutter; the time of a frame is that of its
        middle row. 0: all rows at once.
    down_std_rad : float, optional
        Standard deviation of the direction straight down about two axes. Without it, what `update` gets is exact, and
        so is level ground where it gets none.
    max_height_gap_s : float
        For how long a missing height is carried on by the vertical velocity that the pictures show.
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
        **dict.fromkeys(("height_m", "height_std_m", "rate_std_rad_s"), (numbers.Real, type(None))),
        "R_body_from_camera": (np.ndarray,),
        "lever_arm_m": (np.ndarray,),
        "mask": (np.ndarray, type(None)),
        "_prev": (np.ndarray, type(None)),
        "_prev_t_s": (numbers.Real,),
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
        readout_s: float = 0.0,
        down_std_rad: float | None = None,
        max_height_gap_s: float = 1.0,
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
        self.readout_s = _checks.number("readout_s", readout_s, least=-10, most=10, of="seconds")
        self.down_std_rad = std("down_std_rad", down_std_rad, of="radians")
        self.max_height_gap_s = _checks.number("max_height_gap_s", max_height_gap_s, least=0, most=_MOST, of="seconds")
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
        self._follower = plane.Follower(self.camera)
        self._forget()

    def _forget(self) -> None:
        self._prev: NDArray[Any] | None = None
        self._prev_t_s = np.nan
        self._rotation = RotationModel(self.rate_std_rad_s, self.rate_delay_std_s)
        self._heights = HeightKeeper(self.max_height_gap_s)
        self._watch = Watch()
        # The last way in heights a second, in the camera's axes, and when it was; straight down as it was last given.
        self._led: tuple[float, F64] | None = None
        self._down: F64 | None = None

    def __repr__(self) -> str:
        knobs = {name: getattr(self, name) for name in ("height_m", "height_std_m", "rate_std_rad_s")}
        told = options(**knobs, mask=self.mask is not None)
        camera = f"{self.camera.width} x {self.camera.height} camera"
        before = "no frame yet" if self._prev is None else f"last frame at {self._prev_t_s:.6g} s"
        return f"VelocityEstimator({camera}{', ' if told else ''}{told}): {before}"

    @property
    def gyro(self) -> GyroState:
        """What the pictures told of the bias and the delay of the rates, in the body's axes."""
        return self._rotation.gyro

    @anew
    def reset(self) -> None:
        """Forget the frame before and what was learned: the next one is a first frame."""
        self._follower.reset()
        self._forget()

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

        What is not known at a frame (NaN; a height or range that is not above 0 or infinite, as range finders say it; a
        direction of no length) counts as missing: a height is carried on for a while, a rate is solved for, and straight
        down is where it was.

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
            If `t_s` is not finite, height and range are both given, or an argument is no number or no vector.
        ShapeError, DTypeError
            If the image does not have the camera's size, is not grey or of another type.
        """
        self._check_image(image)
        t_s = _time(t_s)
        if height_m is not None and range_m is not None:
            raise OptionError("height_m, range_m: got both, expected one of them")
        straight, told = self._straight_down(down)
        rate = _vector_or_none("rate_rad_s", rate_rad_s)
        height, height_std = self._height(height_m, range_m, height_std_m, float(straight[2]))

        prev, before = self._prev, self._prev_t_s
        if prev is None:
            self._take(image, t_s, straight, told)
            self._heights.at_first(height, height_std, t_s)
            return unmeasured(VelocityStatus.FIRST_FRAME, t_s, np.nan)
        dt = t_s - before
        if not dt > 0:
            self._follower.reset()
            self._take(image, t_s, straight, told)
            self._rotation.forget_rate()
            return unmeasured(VelocityStatus.TIME_NOT_INCREASING, t_s, dt)
        if np.array_equal(prev, image):
            # The next frame is compared with the one before, over both intervals.
            return unmeasured(VelocityStatus.REPEATED_FRAME, t_s, dt)
        had = self._down
        self._take(image, t_s, straight, told)
        return self._measure(prev, (before, t_s), (height, height_std), rate, (had, straight if told else None), straight)

    def _take(self, image: NDArray[Any], t_s: float, straight: F64, told: bool) -> None:
        self._prev, self._prev_t_s = np.array(image, copy=True), t_s
        self._follower.push(self._prev, self.mask)
        self._down = straight if told else None

    def _take_back(self, prev: NDArray[Any], before: float) -> None:
        self._prev, self._prev_t_s = prev, before
        self._follower.take_back()

    def _check_image(self, image: Any) -> None:
        height, width = _checks.frame("image", image).shape
        if self._prev is not None and image.dtype != self._prev.dtype:
            raise DTypeError(
                f"image: got dtype {image.dtype}, expected that of the frame before, {self._prev.dtype}; "
                "reset() starts another sequence"
            )
        if (width, height) != self.camera.size:
            raise ShapeError(
                f"image: got {width} x {height} pixels, expected the camera's {self.camera.width} x "
                f"{self.camera.height}; use camera.scaled({width}, {height}) or camera.cropped(...)"
            )

    def _straight_down(self, down: ArrayLike | None) -> tuple[F64, bool]:
        """Straight down in the camera's axes, and whether it was told."""
        if down is not None:
            given = _vector_or_none("down", down)
            length = 0.0 if given is None else float(np.linalg.norm(given))
            if given is not None and length > 0:
                return self.R_body_from_camera.T @ given / length, True
            if self._down is not None:
                return self._down, False
        return np.array([0.0, 0.0, 1.0]), False

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

    def _told_rotation(
        self, rate: F64 | None, downs: tuple[F64 | None, F64 | None], dt: float
    ) -> tuple[str, F64, F64]:
        """What tells the rotation, its vector in the camera's axes, and the axes in which its errors are learned."""
        R = self.R_body_from_camera
        if rate is not None:
            return "gyro", R.T @ (rate + self._rotation.correction(rate, dt)) * dt, np.eye(3)
        self._rotation.forget_rate()
        first, second = downs
        if first is None or second is None:
            return "none", np.zeros(3), np.eye(3)
        # The smallest turn that carries one into the other; about themselves they tell nothing.
        across = np.cross(second, first)
        sine = float(np.linalg.norm(across))
        angle = float(np.arctan2(sine, second @ first))
        turn = across * (angle / sine if sine > 1e-12 else 1.0)
        side = np.cross(second, (0.0, 1.0, 0.0) if abs(second[1]) < 0.9 else (1.0, 0.0, 0.0))
        side = side / np.linalg.norm(side)
        return "attitude", turn, np.stack([side, np.cross(second, side), second]) @ R.T

    def _measure(
        self,
        prev: NDArray[Any],
        times: tuple[float, float],
        height: tuple[float, float],
        rate: F64 | None,
        downs: tuple[F64 | None, F64 | None],
        down: F64,
    ) -> Velocity:
        before, t_s = times
        dt = t_s - before
        R = self.R_body_from_camera
        assert self._prev is not None
        source, turn, axes = self._told_rotation(rate, downs, dt)
        expected = self._rotation.expected(source, axes)
        interval = plane.Interval(turn, down, dt, self.readout_s / dt)
        down_std = self.down_std_rad or 0.0
        task = search.Task(
            self.camera, self._follower, prev, self._prev, self.mask, interval,
            (R.T @ expected.cover @ R) * dt**2, budget.wanted(self.camera, down_std),
        )  # fmt: skip
        led = self._leads(t_s, dt)
        found = search.find(task, None if led is None else [*led.tolist(), 0.0, 0.0, 0.0])
        motion = found.motion
        if motion is None:
            self._led = None
            status = found.status
            if not self._sees_ground(down):
                status = VelocityStatus.NO_GROUND
            return unmeasured(status, t_s, dt)
        moved = motion.moved_px()
        count = int(np.count_nonzero(motion.plane))
        expected_px = None if led is None else -led[:2] * (self.camera.fx, self.camera.fy)
        if self._watch.is_repeated(motion.residual, moved, expected_px):
            self._take_back(prev, before)
            return unmeasured(VelocityStatus.REPEATED_FRAME, t_s, dt, moved, count)
        if search.second_motion(task, motion):
            self._led = None
            return unmeasured(VelocityStatus.TWO_MOTIONS, t_s, dt, moved, count)
        shown, spread = motion.rotation()
        self._rotation.learn(source, axes, R @ shown / dt, R @ spread @ R.T / dt**2, dt)
        expected = self._rotation.expected(source, axes)
        inside, cover = ((R.T @ part @ R) * dt**2 for part in (expected.covariance, expected.cover))
        values, noise, turned, inverse = motion.known(np.zeros(3), inside, cover)
        total = noise + turned
        rise = float(down @ values[:3])
        rise_std = float(np.sqrt(max(down @ total[:3, :3] @ down, 0.0)))
        known, doubt = self._heights.at(*height, t_s, rise, rise_std)
        self._led = (t_s, values[:3] / dt)
        size = float(np.hypot(*values[:2]))
        self._watch.add(motion.residual, size / dt, float(np.sqrt(np.trace(total[:2, :2]) / 2)) / dt, size, dt)
        if known is None:
            return unmeasured(VelocityStatus.NO_HEIGHT, t_s, dt, moved, count)
        rotation = (R @ (turn + values[3:]) / dt, R @ total[3:, 3:] @ R.T / dt**2)
        per_way = known.height_m / dt
        dt_std, jitter = self._dt_std()
        parts = self._parts(task.numbers, motion, (noise, turned, inverse), per_way, source)
        velocity = values[:3] * per_way
        square = np.outer(velocity, velocity)
        if self.height_std_m is not None or known.std_m > 0:
            parts["height"] = square * (known.std_m / known.height_m) ** 2
        if dt_std > 0:
            parts["time"] = square * (dt_std / dt) ** 2
        parts = budget.rotated(R, parts)
        return self._result(
            times, R @ velocity, parts, rotation, known, tuple(text for text in (doubt, jitter) if text), rate, moved, count
        )

    def _parts(
        self, numbers: tuple[int, ...], motion: plane.Motion, spread: tuple[F64, F64, F64], per_way: float, source: str
    ) -> dict[str, F64]:
        """Covariances by cause, in the camera's axes."""
        noise, turned, inverse = spread
        common = np.array([_COMMON_PX / self.camera.fx, _COMMON_PX / self.camera.fy, 0.0])
        parts = {
            "displacement": (noise[:3, :3] + np.diag(common**2)) * per_way**2,
            "gyro" if source == "gyro" else "rotation": turned[:3, :3] * per_way**2,
        }
        changes = -(inverse[:3] @ motion.responses[:, :6].T).T
        return parts | budget.of_causes(self.camera, numbers, changes, per_way, self.down_std_rad or 0.0)

    def _result(
        self,
        times: tuple[float, float],
        velocity: F64,
        parts: dict[str, F64],
        rotation: tuple[F64, F64],
        height: Height,
        doubts: tuple[str, ...],
        rate: F64 | None,
        moved: F64,
        count: int,
    ) -> Velocity:
        dt = times[1] - times[0]
        covariance = np.asarray(sum(parts.values()), dtype=np.float64)
        turning, turning_spread = rotation
        straight = self.R_body_from_camera @ (self._down if self._down is not None else (0.0, 0.0, 1.0))
        yaw = float(turning @ straight)
        yaw_std = float(np.sqrt(max(straight @ turning_spread @ straight, 0.0)))
        terms: tuple[str, ...] = ("vx", "vy")
        if abs(velocity[2]) > _DEMANDED * np.sqrt(covariance[2, 2]):
            terms += ("vz",)
        if rate is None and abs(yaw) > _DEMANDED * yaw_std:
            terms += ("yaw",)
        arm = np.cross(turning, self.lever_arm_m) if self.lever_arm_m.any() else np.zeros(3)
        return Velocity(
            t_s=times[1],
            dt_s=dt,
            vx_m_s=float(velocity[0]),
            vy_m_s=float(velocity[1]),
            vz_m_s=float(velocity[2]),
            covariance=covariance,
            status=VelocityStatus.OK,
            n_points=count,
            dx_px=float(moved[0]),
            dy_px=float(moved[1]),
            terms=terms,
            yaw_rate_rad_s=yaw,
            origin_velocity_m_s=velocity - arm,
            parts=parts,
            unstated=self._unstated(),
            rate_rad_s=turning,
            rate_covariance=turning_spread,
            height_m=height.height_m,
            height_std_m=height.std_m,
            doubts=doubts,
        )

    def _leads(self, t_s: float, dt: float) -> F64 | None:
        """Where the motion before leads: a way in heights, (3,)."""
        if self._led is None or t_s - self._led[0] > _LEADS_S:
            return None
        return self._led[1] * dt

    def _dt_std(self) -> tuple[float, str]:
        """Deviation of the time between frames, and what is odd about it."""
        if self.dt_std_s is not None:
            return self.dt_std_s, ""
        seen = self._watch.dt_std_s()
        return seen, f"times jitter by {1e3 * seen:.2g} ms against a steady flow" if seen else ""

    def _sees_ground(self, down: F64) -> bool:
        """Whether at least half of the picture shows what lies less than 80 degrees from straight down."""
        x, y = np.meshgrid(np.linspace(0, self.camera.width - 1, 9), np.linspace(0, self.camera.height - 1, 9))
        pixels = np.column_stack([x.ravel(), y.ravel()])
        rays = self.camera.undistort_points(pixels, normalized=True).astype(np.float64)
        length = np.sqrt(1.0 + np.sum(rays * rays, axis=1))
        with np.errstate(invalid="ignore"):
            return bool(np.mean((rays @ down[:2] + down[2]) / length > 0.17) >= 0.5)

    def _unstated(self) -> tuple[str, ...]:
        """Name what the covariance leaves out, since nobody said how exact it is."""
        std = self.camera.std
        known = {
            "height": self.height_std_m is not None,
            "focal length": "fx" in std and "fy" in std,
            "principal point": "cx" in std and "cy" in std,
        }
        return tuple(name for name, stated in known.items() if not stated)

    def _packed(self, state: dict[str, Any]) -> dict[str, Any]:
        kept = {name: state[name].state() for name in ("_rotation", "_heights", "_watch")}
        return {name: value for name, value in state.items() if name != "_follower"} | kept

    def _unpacked(self, state: dict[str, Any]) -> dict[str, Any]:
        follower = plane.Follower(_checks.instance("camera", state["camera"], Camera, "an rsflow.Camera"))
        if state["_prev"] is not None:
            follower.push(state["_prev"], state["mask"])
        made = {
            "_rotation": RotationModel(state["rate_std_rad_s"], state["rate_delay_std_s"]),
            "_heights": HeightKeeper(state["max_height_gap_s"]),
            "_watch": Watch(),
        }
        for name, part in made.items():
            part.restore(state[name])
        return {**state, **made, "_follower": follower}


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
    if isinstance(value, float) and not np.isfinite(value):
        return np.nan
    found = _checks.number(name, value, of="metres", or_nan=True)
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
