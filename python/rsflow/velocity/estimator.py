"""The estimator: frames in, velocities out.

docs/algorithms.md, section "Velocity over a plane: VelocityEstimator".
"""

from __future__ import annotations

import numbers
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import options
from .._rotation import rotation_matrix
from .._shared import Shared, alone, anew
from ..camera.model import Camera
from ..errors import DTypeError, OptionError, ShapeError
from . import budget, plane
from .ground_flow import GroundFlow, centers, follow, overlap
from .result import Velocity, VelocityStatus, unmeasured

__all__ = ["VelocityEstimator"]

F64 = NDArray[np.float64]

# Beyond this a length in metres, or a rate, is no measurement, and its square no number.
_MOST = 1e12
# The fewest points that a velocity is fitted to: twice the unknowns of the largest model, and a few to judge it by.
_LEAST_POINTS = 6
# Deviation in pixels of what all points of a pair have in common, since all lie at one sub-pixel phase: the error of
# interpolation does not average out. Measured on flights over the finest texture.
_COMMON_PX = 0.001


class VelocityEstimator(Shared):
    """Velocity of a camera over flat ground, frame by frame.

    Points of the ground are followed from frame to frame, freed from distortion, turned by the measured rate, each by
    itself, and a plane's motion (`vx`, `vy`, and `vz` and yaw as far as the data demand them) is fitted to all of them
    at once, weighted by their covariances and robust against what moves by itself. It is the report's equations 2.10
    and 2.11 with the y row mended, with principal point, distortion, attitude and rotation.

    Threads that share one wait for each other. A copy, or a pickle read anywhere, goes on with the same bits.

    Without `rate_rad_s` a camera that rolls or pitches looks like one that moves: give the rate, or keep it level.

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
        Standard deviation of each axis of the rates that `update` gets, as means over an interval: over level ground
        the height times this enters the deviation of the velocity. Without it the rates' share is missing likewise.
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
    >>> v = estimator.update(flight.images[1], flight.t_s[1])
    >>> v.valid, bool(abs(v.vx_m_s - 0.02) < 4e-4), bool(abs(v.vy_m_s - 0.01) < 4e-4)
    (True, True, True)
    """

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
        R_body_from_camera: ArrayLike | None = None,
        lever_arm_m: ArrayLike = (0.0, 0.0, 0.0),
        mask: NDArray[np.bool_] | None = None,
    ) -> None:
        self.camera = _checks.instance("camera", camera, Camera, "an rsflow.Camera")
        self.height_m = _checks.number_or_none("height_m", height_m, least=1 / _MOST, most=_MOST, of="metres")
        self.height_std_m = _checks.number_or_none("height_std_m", height_std_m, least=0, most=_MOST, of="metres")
        self.rate_std_rad_s = _checks.number_or_none("rate_std_rad_s", rate_std_rad_s, least=0, most=_MOST, of="rad/s")
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
        self._prev: NDArray[Any] | None = None
        self._prev_t_s = np.nan

    def __repr__(self) -> str:
        knobs = {name: getattr(self, name) for name in ("height_m", "height_std_m", "rate_std_rad_s")}
        told = options(**knobs, mask=self.mask is not None)
        camera = f"{self.camera.width} x {self.camera.height} camera"
        before = "no frame yet" if self._prev is None else f"last frame at {self._prev_t_s:.6g} s"
        return f"VelocityEstimator({camera}{', ' if told else ''}{told}): {before}"

    @anew
    def reset(self) -> None:
        """Forget the frame before: the next one is a first frame."""
        self._prev = None
        self._prev_t_s = np.nan

    @alone
    def update(
        self,
        image: NDArray[Any],
        t_s: float,
        *,
        height_m: float | None = None,
        range_m: float | None = None,
        rate_rad_s: ArrayLike | None = None,
        down: ArrayLike | None = None,
    ) -> Velocity:
        """Take the next frame and measure the velocity since the one before.

        Parameters
        ----------
        image : (height, width) uint8, uint16 or float32
            Grey picture of the camera's size.
        t_s : float
            Its time in seconds.
        height_m : float, optional
            Perpendicular distance from the ground plane at this frame; NaN where it is not known.
        range_m : float, optional
            Instead of a height: the distance to the ground along the optical axis.
        rate_rad_s : (3,) array_like, optional
            Mean angular rate of the body since the previous frame, right-handed, in the body frame.
        down : (3,) array_like, optional
            Straight down in the body frame at this frame, of any length; by default the optical axis: level ground.

        Returns
        -------
        Velocity

        Raises
        ------
        OptionError
            If `t_s` is not finite, a height is not above 0, height and range are both given, or a vector is wrong.
        ShapeError, DTypeError
            If the image does not have the camera's size, is not grey or of another type.
        """
        self._check_image(image)
        t_s = _checks.number("t_s", t_s, least=-_MOST, most=_MOST, of="seconds", or_nan=True)
        if not np.isfinite(t_s):
            raise OptionError(
                f"t_s: got {t_s}, expected a finite number of seconds; pictures of a folder carry no times: "
                "give their rate (rsflow.frames(..., frame_rate=30), or --rate 30 on the command line)"
            )
        if height_m is not None and range_m is not None:
            raise OptionError("height_m, range_m: got both, expected one of them")
        straight = _vector("down", (0.0, 0.0, 1.0) @ self.R_body_from_camera.T if down is None else down)
        length = float(np.linalg.norm(straight))
        if length == 0.0:
            raise OptionError("down: got (0, 0, 0), expected a direction")
        rate = None if rate_rad_s is None else _vector("rate_rad_s", rate_rad_s)
        down_camera = self.R_body_from_camera.T @ straight / length
        height, height_std = self._height(height_m, range_m, float(down_camera[2]))

        prev, before = self._prev, self._prev_t_s
        self._prev, self._prev_t_s = np.array(image, copy=True), float(t_s)
        if prev is None:
            return unmeasured(VelocityStatus.FIRST_FRAME, float(t_s), np.nan)
        dt = float(t_s) - before
        if not dt > 0:
            return unmeasured(VelocityStatus.TIME_NOT_INCREASING, float(t_s), dt)
        interval = plane.Interval(
            turn=np.zeros(3) if rate is None else self.R_body_from_camera.T @ rate * dt,
            down=down_camera,
            height_m=height,
            dt_s=dt,
            yaw_free=rate is None,
        )
        return self._measure(prev, self._prev, float(t_s), interval, height_std, rate)

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

    def _height(self, height_m: float | None, range_m: float | None, cosine: float) -> tuple[float, float]:
        """Height and its deviation; NaN where none is known for this frame."""
        std = self.height_std_m or 0.0
        if range_m is not None:
            measured = _checks.number("range_m", range_m, least=1 / _MOST, most=_MOST, of="metres", or_nan=True)
            return measured * cosine, std * abs(cosine)
        if height_m is None:
            return (np.nan if self.height_m is None else self.height_m), std
        return _checks.number("height_m", height_m, least=1 / _MOST, most=_MOST, of="metres", or_nan=True), std

    def _measure(
        self,
        prev: NDArray[Any],
        image: NDArray[Any],
        t_s: float,
        interval: plane.Interval,
        height_std: float,
        rate: F64 | None,
    ) -> Velocity:
        def turned(pixels: F64) -> F64:
            rays = self.camera.undistort_points(pixels, normalized=True).astype(np.float64)
            by = rotation_matrix(-interval.turn)
            return np.asarray(self.camera.distort_points(plane.turned(rays, by), normalized=True), dtype=np.float64)

        flow = follow(prev, image, turned if interval.turn.any() else None, self.mask)
        if flow.offered < _LEAST_POINTS:
            status = VelocityStatus.NO_TEXTURE if flow.related else VelocityStatus.SCENE_CUT
            return unmeasured(status, t_s, interval.dt_s)
        if len(flow.after) < max(_LEAST_POINTS, 0.1 * flow.offered):
            status = VelocityStatus.TOO_FEW_POINTS if flow.related else VelocityStatus.SCENE_CUT
            return unmeasured(status, t_s, interval.dt_s)
        moved = np.median(flow.after - flow.before, axis=0)
        if not np.isfinite(interval.height_m):
            return unmeasured(VelocityStatus.NO_HEIGHT, t_s, interval.dt_s, moved, len(flow.after))

        rays = self._rays(flow)
        seen = np.isfinite(rays).all(axis=(0, 2))
        ground = seen & plane.in_view(rays[1], interval)
        if interval.height_m <= 0 or 2 * ground.sum() < seen.sum() or ground.sum() < _LEAST_POINTS:
            return unmeasured(VelocityStatus.NO_GROUND, t_s, interval.dt_s, moved)
        flow = flow.only(ground)
        spread = budget.in_rays(self.camera, flow.after, flow.covariance)
        shared = overlap(flow.before, flow.window)
        fit = plane.fit(self._points(flow, spread), interval, overlap=shared)
        if fit is not None and (len(fit.terms) > 2 or interval.turn.any()):
            # Where windows grow or turn and were followed as if they did not, their displacement is that of a place off
            # their middle.
            places = flow.moved(centers(prev, flow.before, flow.window, self.mask))
            known = np.asarray(np.isfinite(self._rays(places)).all(axis=(0, 2)))
            apart = known & ~flow.deformed
            flow = flow.moved(np.where(apart[:, None], places.before, flow.before))
            fit = plane.fit(self._points(flow, spread), interval, overlap=shared)
        if fit is None:
            return unmeasured(VelocityStatus.TOO_FEW_POINTS, t_s, interval.dt_s, moved)
        if fit.inliers.sum() < max(_LEAST_POINTS, 0.5 * len(flow.after)):
            status = VelocityStatus.INCONSISTENT if flow.related else VelocityStatus.SCENE_CUT
            return unmeasured(status, t_s, interval.dt_s, moved)
        common = np.array([_COMMON_PX / self.camera.fx, _COMMON_PX / self.camera.fy, 0.0])
        displacement = fit.covariance + np.diag((common * interval.height_m / interval.dt_s) ** 2)
        measured = budget.Measured(self._rays(flow), spread, interval, fit)
        parts = {"displacement": displacement}
        if self.height_std_m is not None:
            parts["height"] = budget.of_height(measured, height_std)
        parts |= budget.of_camera(self.camera, measured)
        if rate is not None and self.rate_std_rad_s:
            parts["gyro"] = budget.of_gyro(measured, self.rate_std_rad_s)
        R = self.R_body_from_camera
        # An infinite variance of Vz must stay infinite, and must not make NaN of the others, under the rotation.
        parts = {name: budget.rotated(R, part) for name, part in parts.items()}
        velocity = R @ np.where(np.isfinite(fit.velocity), fit.velocity, 0.0)
        velocity[np.isinf(np.diag(parts["displacement"]))] = np.nan
        arm = np.cross(np.full(3, np.nan) if rate is None else rate, self.lever_arm_m)
        moved = np.median((flow.after - flow.before)[fit.inliers], axis=0)
        return Velocity(
            t_s=t_s,
            dt_s=interval.dt_s,
            vx_m_s=float(velocity[0]),
            vy_m_s=float(velocity[1]),
            vz_m_s=float(velocity[2]),
            covariance=np.asarray(sum(parts.values()), dtype=np.float64),
            status=VelocityStatus.OK,
            n_points=int(fit.inliers.sum()),
            dx_px=float(moved[0]),
            dy_px=float(moved[1]),
            terms=fit.terms,
            yaw_rate_rad_s=fit.yaw_rad / interval.dt_s if interval.yaw_free else np.nan,
            origin_velocity_m_s=velocity - (arm if self.lever_arm_m.any() else 0.0),
            parts=parts,
            unstated=self._unstated(rate is not None),
        )

    def _unstated(self, turned: bool) -> tuple[str, ...]:
        """Name what the covariance leaves out, since nobody said how exact it is."""
        std = self.camera.std
        known = {
            "height": self.height_std_m is not None,
            "focal length": "fx" in std and "fy" in std,
            "principal point": "cx" in std and "cy" in std,
            "gyro": not turned or self.rate_std_rad_s is not None,
        }
        return tuple(name for name, stated in known.items() if not stated)

    def _rays(self, flow: GroundFlow) -> F64:
        """Undistorted normalised coordinates in both frames, (2, N, 2)."""
        return np.stack([self.camera.undistort_points(p, normalized=True) for p in (flow.before, flow.after)]).astype(
            np.float64
        )

    def _points(self, flow: GroundFlow, spread: F64) -> plane.Points:
        rays = self._rays(flow)
        return plane.Points(rays[0], rays[1], spread)


def _vector(name: str, value: ArrayLike) -> F64:
    vector = _checks.vector(name, value, 3, "three finite numbers")
    if np.abs(vector).max() > _MOST:
        raise OptionError(f"{name}: got {vector.tolist()}, expected numbers up to {_MOST:g}")
    return vector
