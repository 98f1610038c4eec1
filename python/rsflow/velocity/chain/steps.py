"""From two frames and what is known of the camera to a velocity: the steps of `VelocityEstimator`, in their order.

docs/explanation/algorithms.md, section "Velocity over a plane: VelocityEstimator".
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._rotation import rotation_matrix
from ...shift import ShiftStatus, estimate_shift
from ..result import Velocity, VelocityStatus, unmeasured
from . import budget, plane, search
from .attitude import Attitude
from .geometry import cross, demanded, sees_ground, smooth_error
from .height import Height, HeightKeeper
from .others import second_motion
from .pattern import FixedPattern
from .readout import Readout
from .rotation import RotationModel
from .settings import Settings, Told
from .task import Task
from .watch import Watch

F64 = NDArray[np.float64]

# Deviation in pixels of what all tiles of a pair have in common, since all lie at one sub-pixel phase: the error of
# interpolation does not average out. Measured on flights over the finest texture.
_COMMON_PX = 0.00015
# A velocity leads on to the next frames for so long.
_LEADS_S = 0.5
# Where the pictures tilt the ground by more than this, in radians, the frames are laid over each other again.
_TILTED_RAD = 0.005
_AGAIN = 3
# They no longer are after so many frames that were level where they were taken to be.
_LEVEL = 4
_EYE = np.eye(3)
# How a rotation grows is taken from so many intervals where nothing tells it: what the rows make of it comes back.
_GROWS = 4
# A rotation is looked for within this deviation at least, in rad/s.
_WIDE_RAD_S = 0.015
# Where tiles lie so many times further off than they should, it is looked for within this; and if they still do, they
# are not those of a plane.
_STRAINED = 60.0
_TENSE = 40.0
# So many of the tiles must stay.
_KEPT = 0.8
_EASED_RAD_S = 1.0
# Fewer tiles than this judge their own noise badly: what they say of the rotation has this many times the variance.
_FEW_TILES = 16
_FEW_WORSE = 10.0
# Of one of which the rows make something that cannot be told yet, nothing is learned: as it was told, give or take 0.
_AS_TOLD_RAD_S = 1e-5
# Frames that are closer than this, in seconds, are of one time: what turns meanwhile has no square.
_LEAST_S = 5e-10
# No mounting is known better than this, in radians: straight down and the axis that heights are measured along.
_MOUNTED_RAD = 2.5e-4


class Chain:
    """Everything that is known from frame to frame."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._follower = plane.Follower(settings.camera)
        self._lens = budget.wanted(settings.camera)
        self._smooth = smooth_error(settings.camera)
        self.prev: NDArray[Any] | None = None
        self.prev_t_s = np.nan
        self.rotation = RotationModel(settings.rate_std_rad_s, settings.rate_delay_std_s)
        self._attitude = Attitude(settings.down_std_rad)
        self._heights = HeightKeeper(settings.max_height_gap_s)
        self._watch = Watch()
        self._pattern = FixedPattern()
        self._readout = Readout(settings.readout_s)
        # Rates in the camera's axes of the last intervals, in rad/s: as found and as told.
        self._rates: list[F64] = []
        self._told_rates: list[F64] = []
        # Frames in a row whose straight down was where it was taken to be.
        self._level = 0
        # The last way in heights a second and rate in rad/s, in the camera's axes, and when they were.
        self._led: tuple[float, F64, F64] | None = None
        # How many heights a second another motion was that was left out for its speed alone; 0 where none was.
        self._left_out = 0.0

    def step(self, image: NDArray[Any], told: Told) -> Velocity:
        """Take the next frame."""
        prev, before = self.prev, self.prev_t_s
        if prev is None:
            self._take(image, told.t_s)
            self._attitude.tell(told.down)
            self._heights.at_first(told.height_m, told.height_std_m, told.t_s)
            return unmeasured(VelocityStatus.FIRST_FRAME, told.t_s, np.nan)
        dt = told.t_s - before
        if not dt > _LEAST_S:
            self._take(image, told.t_s)
            self._attitude.tell(told.down)
            self.rotation.forget_rate()
            return unmeasured(VelocityStatus.TIME_NOT_INCREASING, told.t_s, dt)
        if np.array_equal(prev, image):
            # The next frame is compared with the one before, over both intervals.
            blank = estimate_shift(prev, prev).status is ShiftStatus.NO_TEXTURE
            status = VelocityStatus.NO_TEXTURE if blank else VelocityStatus.REPEATED_FRAME
            return unmeasured(status, told.t_s, dt)
        self._take(image, told.t_s)
        return self._measure(prev, before, told)

    def _take(self, image: NDArray[Any], t_s: float) -> None:
        self.prev, self.prev_t_s = np.array(image, copy=True), t_s
        self._follower.push(self.prev, self._settings.mask)

    def _told_rotation(
        self, told: Told, downs: tuple[F64 | None, F64 | None], dt: float
    ) -> tuple[str, F64, F64 | None]:
        """Give what tells the rotation, its vector in the camera's axes, and the axes in which errors are learned."""
        R = self._settings.R_body_from_camera
        if told.rate is not None:
            return "gyro", R.T @ (told.rate + self.rotation.correction(told.rate, dt)) * dt, None
        self.rotation.forget_rate()
        first, second = downs
        if first is None or second is None:
            return "none", np.zeros(3), None
        # The smallest turn that carries one into the other; about themselves they tell nothing.
        across = cross(second, first)
        sine = float(np.linalg.norm(across))
        angle = float(np.arctan2(sine, second @ first))
        turn = across * (angle / sine if sine > 1e-12 else 1.0)
        side = np.cross(second, (0.0, 1.0, 0.0) if abs(second[1]) < 0.9 else (1.0, 0.0, 0.0))
        side = side / np.linalg.norm(side)
        return "attitude", turn, np.stack([side, np.cross(second, side), second]) @ R.T

    def _expected_px(self, led: F64, turn: F64) -> F64:
        """Give how the middle of the picture should move, (2,), by where the motion before leads and what was told."""
        x, y = led[:2]
        a, b = (turn + led[3:])[:2]
        return np.array([-x - b, -y + a]) * (self._settings.camera.fx, self._settings.camera.fy)

    def _growth(self, source: str, turn: F64, dt: float) -> F64 | None:
        """Give how much the rotation grows from one interval to the next, in radians; None where nothing tells it."""
        told, self._told_rates = self._told_rates, [*self._told_rates, turn / dt][-2:] if source == "gyro" else []
        if source == "gyro":
            if len(told) < 2:
                return None
            # As it is half-way through this interval: the last change, and half of how that changes.
            return np.asarray(1.5 * turn + (0.5 * told[0] - 2.0 * told[1]) * dt)
        if len(self._rates) < _GROWS:
            return None
        return np.asarray((self._rates[-1] - self._rates[0]) * (dt / (_GROWS - 1)))

    def _measure(self, prev: NDArray[Any], before: float, told: Told) -> Velocity:
        settings, t_s = self._settings, told.t_s
        dt = t_s - before
        R = settings.R_body_from_camera
        assert self.prev is not None
        source, turn, axes = self._told_rotation(told, self._attitude.tell(told.down), dt)
        expected = self.rotation.expected(source, axes)
        cover = (R.T @ expected.cover @ R) * dt**2
        # Wide enough for the pictures to say what they show.
        wide = cover + (_WIDE_RAD_S * dt) ** 2 * _EYE
        led = None
        if self._led is not None and t_s - self._led[0] <= _LEADS_S:
            led = np.concatenate([self._led[1] * dt, self._led[2] * dt - turn if source == "none" else np.zeros(3)])
        turned = turn if source != "none" or led is None else led[3:]
        down, tilt = self._attitude.carry(turned, cover, dt)
        exact = not tilt.any()
        numbers = (*self._lens, plane.READOUT, *(() if exact else (plane.DOWN_X, plane.DOWN_Y)))
        growth = self._growth(source, turn, dt)
        readout = self._readout.applied_s / dt
        told_rows = readout == 0 or growth is not None
        interval = plane.Interval(turn, down, dt, readout, np.zeros(3) if growth is None else growth)
        longest = None if settings.max_speed_m_s is None else settings.max_speed_m_s * dt / told.height_m
        task = Task(settings.camera, self._follower, prev, self.prev, settings.mask, interval, wide, numbers, longest)
        found = search.find(task, None if led is None else led.tolist())
        motion = found.motion
        if found.left_out is not None:
            self._left_out = found.left_out
        if motion is None:
            self._led = None
            self._rates = []
            if sees_ground(settings.camera, down):
                return unmeasured(found.status, t_s, dt)
            if told.down is None and source == "none":
                # Only the pictures carried straight down there, and they lead nowhere.
                self._attitude.begin_anew()
                return unmeasured(found.status, t_s, dt)
            return unmeasured(VelocityStatus.NO_GROUND, t_s, dt)
        moved, count = motion.moved_px(), motion.count
        expected_px = None if led is None else self._expected_px(led, turn)
        if self._watch.is_repeated(motion.residual, moved, expected_px):
            self.prev, self.prev_t_s = prev, before
            self._follower.take_back()
            return unmeasured(VelocityStatus.REPEATED_FRAME, t_s, dt, moved, count)
        if second_motion(task, motion):
            self._led = None
            self._rates = []
            return unmeasured(VelocityStatus.TWO_MOTIONS, t_s, dt, moved, count)
        if self._pattern.hides(prev, self.prev, moved, settings.mask):
            return unmeasured(VelocityStatus.NO_TEXTURE, t_s, dt, moved, count)
        tilt_or_none, carried = None if exact else tilt, told.down is None
        interval, motion, at = self._levelled(task, motion, tilt_or_none, carried)
        if motion.scale > _STRAINED:
            # No plane moves like that; but rows that are taken one after the other make it look so.
            strained = plane.Prior.of(task.covariance, task.covariance, tilt_or_none, at, carried=carried)
            self._readout.learn(*motion.known(strained).readout, dt)
            return unmeasured(VelocityStatus.INCONSISTENT, t_s, dt, moved, count)
        shown, spread = motion.rotation(tilt_or_none, at)
        if told_rows:
            if motion.count < _FEW_TILES:
                spread = _FEW_WORSE * spread
            spread, smooth = (R @ part @ R.T / dt**2 for part in (spread, self._smooth))
            self.rotation.learn(source, axes, R @ shown / dt, spread, smooth, dt)
            expected = self.rotation.expected(source, axes)
        inside, cover = ((R.T @ part @ R) * dt**2 for part in (expected.covariance, expected.cover))
        if not told_rows:
            inside = (_AS_TOLD_RAD_S * dt) ** 2 * _EYE
        known = motion.known(plane.Prior.of(inside, cover, tilt_or_none, at, carried=carried))
        return self._told_velocity((before, told), (turn, interval), motion, known, source, exact)

    def _levelled(
        self, task: Task, motion: plane.Motion, tilt: F64 | None, carried: bool
    ) -> tuple[plane.Interval, plane.Motion, F64]:
        """Lay the frames over each other again where straight down or the rotation are not what they were taken to be.

        Gives the interval and the motion, and where straight down was before, from there, (2,).
        """
        interval, at = task.interval, np.zeros(2)
        # Points that stand in for tiles say nothing of it.
        loose = tilt is not None and self._level < _LEVEL
        for _ in range(_AGAIN):
            strained = _total(motion) > _TENSE
            if not np.isfinite(motion.correlation) or not (loose or strained):
                break
            # Tiles that a wrong attitude strains tell it no worse for that.
            strain = _total(motion) ** 2 if strained else 1.0
            wide = strain * task.covariance
            known = motion.known(
                plane.Prior.of(wide, wide, None if tilt is None else strain * tilt, at, carried=carried)
            )
            by = np.zeros(2) if tilt is None else known.values[6:]
            if not strained and np.abs(by).max() < _TILTED_RAD:
                break
            tilted = interval if tilt is None else replace(
                interval, down=rotation_matrix([by[0], by[1], 0.0]) @ interval.down
            )  # fmt: skip
            around = wide + (_EASED_RAD_S * interval.dt_s) ** 2 * _EYE if strained else task.covariance
            again = self._follower.motion(tilted, known.values[:6].tolist(), around, numbers=task.numbers)
            if again is None or not again.settled or again.count < _KEPT * motion.count:
                break
            if _total(again) > (0.5 if strained else 2.0) * _total(motion):
                break
            interval, motion, at = tilted, again, at - by
        return interval, motion, at

    def _told_velocity(
        self,
        times: tuple[float, Told],
        turns: tuple[F64, plane.Interval],
        motion: plane.Motion,
        known: plane.Known,
        source: str,
        exact: bool,
    ) -> Velocity:
        """Give the velocity of a motion, with its covariance by cause."""
        settings, (before, told), (turn, interval) = self._settings, times, turns
        dt, R = told.t_s - before, settings.R_body_from_camera
        way, total = known.values[:3], known.covariance
        if not exact:
            # A tilt that comes anew is seen a frame late.
            small = np.abs(known.values[6:]).max() < 0.5 * _TILTED_RAD
            self._level = self._level + 1 if small else 0
            self._attitude.correct(interval.down, known.values[6:], total[6:, 6:])
        down = self._attitude.down
        self._readout.learn(*known.readout, dt)
        moved, count = motion.moved_px(), motion.count
        rise_std = float(np.sqrt(max(down @ total[:3, :3] @ down, 0.0)))
        height, doubt = self._heights.at(told.height_m, told.height_std_m, told.t_s, float(down @ way), rise_std)
        turning = turn + known.values[3:6]
        self._led = (told.t_s, way / dt, turning / dt)
        self._rates = [*self._rates, turning / dt][-_GROWS:]
        size = float(np.hypot(*way[:2]))
        flat_std = float(np.sqrt(np.trace(total[:2, :2]) / 2))
        self._watch.add(motion.residual, size / dt, flat_std / dt, size, dt)
        if height is None:
            return unmeasured(VelocityStatus.NO_HEIGHT, told.t_s, dt, moved, count)
        per_way = height.height_m / dt
        velocity = way * per_way
        parts = self._parts(velocity, down, height, known, source, told.down is None, per_way)
        square = velocity[:, None] * velocity
        dt_std, jitter = settings.dt_std_s, ""
        if dt_std is None:
            dt_std = self._watch.dt_std_s()
            jitter = f"times jitter by {1e3 * dt_std:.2g} ms against a steady flow" if dt_std else ""
        if dt_std > 0:
            parts["time"] = square * (dt_std / dt) ** 2
        jump = self._watch.jump(velocity, np.sqrt(sum(np.diag(part) for part in parts.values())), dt)
        if jump is not None:
            parts["time"] = parts.get("time", 0.0) + jump[:, None] * jump
            jitter = "the velocity jumps within a frame: frames may be missing, or their times wrong"
        parts = budget.rotated(R, parts)
        covariance = np.asarray(sum(parts.values()), dtype=np.float64)
        rate, rate_covariance = R @ turning / dt, R @ total[3:6, 3:6] @ R.T / dt**2
        body = R @ velocity
        straight = R @ down
        yaw, yaw_std = float(rate @ straight), float(np.sqrt(max(straight @ rate_covariance @ straight, 0.0)))
        arm = cross(rate, settings.lever_arm_m)
        return Velocity(
            t_s=told.t_s,
            dt_s=dt,
            vx_m_s=float(body[0]),
            vy_m_s=float(body[1]),
            vz_m_s=float(body[2]),
            covariance=covariance,
            status=VelocityStatus.OK,
            n_points=count,
            dx_px=float(moved[0]),
            dy_px=float(moved[1]),
            terms=demanded(body, covariance, yaw / yaw_std if told.rate is None else 0.0),
            yaw_rate_rad_s=yaw,
            origin_velocity_m_s=body - arm,
            parts=parts,
            unstated=settings.unstated(),
            rate_rad_s=rate,
            rate_covariance=rate_covariance,
            height_m=height.height_m,
            height_std_m=height.std_m,
            doubts=tuple(text for text in (doubt, jitter, self._readout.doubt, self._repeats()) if text),
        )

    def _parts(
        self,
        velocity: F64,
        down: F64,
        height: Height,
        known: plane.Known,
        source: str,
        carried: bool,
        per_way: float,
    ) -> dict[str, F64]:
        """Give the covariance of a velocity by cause, in the camera's axes, but that of times."""
        settings = self._settings
        square = velocity[:, None] * velocity
        # Straight down that the rotation carried along shares its errors.
        turned = known.both if carried else known.rotation
        common = np.array([_COMMON_PX / settings.camera.fx, _COMMON_PX / settings.camera.fy, 0.0])
        parts = {
            "displacement": (known.noise[:3, :3] + np.diag(common**2)) * per_way**2,
            "gyro" if source == "gyro" else "rotation": turned[:3, :3] * per_way**2,
        }
        # About two axes across straight down: all of a turn about any, less that about itself.
        spun = cross(down, velocity)
        tipped = float(velocity @ velocity) * _EYE - square - spun[:, None] * spun
        parts["displacement"] += tipped * _MOUNTED_RAD**2
        if len(known.values) > 6 and not carried:
            parts["attitude"] = (known.both - known.rotation)[:3, :3] * per_way**2
        if settings.height_std_m is not None or height.std_m > 0:
            parts["height"] = square * (height.std_m / height.height_m) ** 2
        return parts | budget.of_lens(settings.camera, self._lens, known.changes, per_way)

    def _repeats(self) -> str:
        """Tell that the ground repeats, where only a speed that nobody stated keeps another motion out."""
        if self._left_out == 0 or self._settings.max_speed_m_s is not None:
            return ""
        return (
            f"the ground repeats: a motion of {self._left_out:.2g} heights a second explains the pictures as well, "
            "and was left out as too fast (max_speed_m_s)"
        )

    def state(self) -> dict[str, Any]:
        """Everything that is known, to be kept."""
        kept: dict[str, Any] = {"prev": self.prev, "prev_t_s": self.prev_t_s, "led": self._led}
        kept["left_out"] = self._left_out
        kept |= {"level": self._level, "rates": self._rates, "told_rates": self._told_rates}
        return kept | {name: getattr(self, name).state() for name in _PARTS}

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        if kept["prev"] is not None:
            self._take(kept["prev"], float(kept["prev_t_s"]))
        self._level = int(kept["level"])
        self._left_out = kept["left_out"]
        self._led, self._rates, self._told_rates = kept["led"], kept["rates"], kept["told_rates"]
        for name in _PARTS:
            getattr(self, name).restore(kept[name])


_PARTS = ("rotation", "_attitude", "_heights", "_watch", "_pattern", "_readout")


def _total(motion: plane.Motion) -> float:
    """Give how many times further off tiles lie than they should, with what neighbours share."""
    return float(np.sqrt(motion.widened)) * motion.scale
