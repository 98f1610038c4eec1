"""Velocity over the ground, frame by frame: the estimator, and what the logs beside the frames tell it."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import OptionError
from .log_use import LogUse
from .metric import fitting_camera
from .thing_scale import scales
from .variance_shares import VarianceShares

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..camera.model import Camera
    from ..capture.stream import Frame, Frames
    from ..velocity import Attitudes, Sensors, Velocity, VelocityEstimator

__all__ = ["Ground"]

# A delay of the rates that is learned is told from so many deviations, and so many seconds, on.
_SURE, _LATE_S = 4.0, 1e-3


class Ground:
    """The velocity of a source's frames; logs are read before the first one, the camera is fitted to it.

    Parameters
    ----------
    camera : Camera or path
        Of the whole picture.
    height_m : float or path
        Metres, or a CSV of heights or ranges.
    height_std_m : float, optional
        Of all heights or ranges; not where the CSV has a deviation of each.
    sensors : Sensors, optional

    Raises
    ------
    FormatError
        If a log is none.
    OptionError
        If a log is in the axes of an autopilot's body and nothing says how the camera is mounted on it.
    """

    def __init__(
        self,
        camera: Camera | str | os.PathLike[str],
        height_m: float | str | os.PathLike[str],
        height_std_m: float | None = None,
        sensors: Sensors | None = None,
    ) -> None:
        from ..velocity import Attitudes, Heights, Rates, Sensors, mounting

        self.sensors = Sensors() if sensors is None else sensors
        self.sensors.validate()
        self._camera, self._height_std_m = camera, height_std_m
        self._height_m, self._heights, self._rates, self._attitudes = None, None, None, None
        self._uses: list[LogUse] = []
        # What the velocities' deviations leave out.
        self.unstated: tuple[str, ...] = ()
        # Where their variance comes from.
        self.shares = VarianceShares()
        # In how many frames what was odd.
        self._doubts: dict[str, int] = {}
        self.notes: list[str] = []
        if isinstance(height_m, (str, os.PathLike)):
            self._heights = Heights.read(height_m, std_m=height_std_m)
            self._use("height_m", height_m, self._heights.kind, self._heights)
        else:
            self._height_m = float(height_m)
        if self.sensors.rates is not None:
            self._rates = Rates.read(self.sensors.rates)
            self._use("rates", self.sensors.rates, "rate", self._rates)
        if self.sensors.attitude is not None:
            self._attitudes = Attitudes.read(self.sensors.attitude, earth=self.sensors.earth)
            self._use("attitude", self.sensors.attitude, "attitude", self._attitudes)
        self._mount = None if self.sensors.mount is None else mounting(self.sensors.mount)
        for log, path in ((self._rates, self.sensors.rates), (self._attitudes, self.sensors.attitude)):
            if log is not None and log.origin and self._mount is None:
                raise OptionError(
                    f"mount: got none, expected how the camera is mounted on the body, whose axes are forward, right, "
                    f'down in {path} ({log.origin}): "x-right" for one that looks down with the top of its picture to '
                    "the front"
                )
        if self._attitudes is not None:
            self._doubt_attitudes(self._attitudes)
        self._estimator: VelocityEstimator | None = None
        # The camera as it fits the frames.
        self.fitted: Camera | None = None
        self._prev_t_s = math.nan
        # What the estimator was told at the last frame: height_m or range_m, rate_rad_s, down.
        self._last: dict[str, Any] = {}
        # Of the last interval, where the logs tell: straight down in the body's axes half-way.
        self.down: NDArray[np.float64] | None = None
        self._prev_down: NDArray[np.float64] | None = None

    def _use(self, name: str, path: Any, what: str, log: Any) -> None:
        self._uses.append(LogUse(name, os.fspath(path), what, log))
        self.notes.extend(log.notes)

    def _doubt_attitudes(self, attitudes: Attitudes) -> None:
        """Note where the camera would look at the sky for most of the log."""
        axis = np.array([0.0, 0.0, 1.0]) if self._mount is None else self._mount[:, 2]
        along = attitudes.directions @ axis
        if not np.isfinite(along).any() or (middle := float(np.nanmedian(along))) >= 0:
            return
        angle = math.degrees(math.acos(max(middle, -1.0)))
        self.notes.append(
            f"By the attitudes the camera looks {angle:.0f} degrees away from straight down, at the sky: is it mounted "
            "in another way (mount, --mount), or do the quaternions lead to axes with the third one up (--earth enu)?"
        )

    def expect_some(self, stream: Frames) -> None:
        """Raise OptionError where it is plain before the first frame that a log has nothing for `stream`."""
        for use in self._uses:
            use.expect_some(stream, self.sensors.log_start_s)

    def open(self, stream: Frames, roi: tuple[int, int, int, int] | None, mask: NDArray[np.bool_] | None) -> None:
        """Make the estimator for the frames of `stream`, whose size is known."""
        from ..velocity import VelocityEstimator

        camera, note = fitting_camera(self._camera, stream, roi)
        self.fitted = camera
        if note:
            self.notes.append(note)
        sensors = self.sensors
        stated: dict[str, Any] = {
            "height_m": self._height_m,
            "height_std_m": self._height_std_m if self._heights is None else None,
            "rate_std_rad_s": sensors.rate_std_rad_s,
            "rate_delay_std_s": sensors.rate_delay_std_s,
            "dt_std_s": sensors.dt_std_s,
            "readout_s": sensors.readout_s,
            "down_std_rad": sensors.down_std_rad,
            "max_height_gap_s": sensors.max_height_gap_s,
            "max_speed_m_s": sensors.max_speed_m_s,
            "R_body_from_camera": self._mount,
            "mask": mask,
        }
        self._estimator = VelocityEstimator(
            camera, **{name: value for name, value in stated.items() if value is not None}
        )

    def scales(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Give metres on the ground for each pixel at places (n, 2) of the last frame; NaN where that is not known."""
        known = self.known
        axis = np.array([0.0, 0.0, 1.0]) if self._mount is None else self._mount[:, 2]
        along = 1.0 if known["down"] is None else float(axis @ known["down"])
        height_m = known["height_m"]
        assert self.fitted is not None, "open comes first"
        return scales(self.fitted, math.nan if height_m is None else float(height_m), along, places)

    @property
    def is_open(self) -> bool:
        """Whether the estimator is made."""
        return self._estimator is not None

    def after_gap(self) -> None:
        """Take the next frame as a first one: the one before is of too long ago to be compared with."""
        assert self._estimator is not None, "open comes first"
        self._estimator.reset()
        self._prev_t_s, self._prev_down, self.down = math.nan, None, None

    def update(self, frame: Frame) -> tuple[Velocity, dict[str, Any]]:
        """Measure the velocity at a frame; give it and its row of ``velocity.csv``."""
        from ..velocity import velocity_row

        assert self._estimator is not None, "open comes first"
        self._last = self._told(frame)
        velocity = self._estimator.update(frame.image, frame.t_s, **self._last)
        self._prev_t_s = frame.t_s
        self.unstated = velocity.unstated or self.unstated
        self.shares.add(velocity)
        for doubt in velocity.doubts:
            self._doubts[doubt] = self._doubts.get(doubt, 0) + 1
        # Of the first frame too, whose height no velocity was computed with.
        height_m = velocity.height_m if math.isfinite(velocity.height_m) else self.known["height_m"]
        return velocity, velocity_row(velocity, frame=frame.index, height_m=height_m)

    @property
    def known(self) -> dict[str, Any]:
        """What the last frame's velocity was computed with: `height_m` above the ground, `rate_rad_s` and `down`."""
        axis = np.array([0.0, 0.0, 1.0]) if self._mount is None else self._mount[:, 2]
        height_m = self._last.get("height_m", self._height_m)
        if "range_m" in self._last:
            # Along the optical axis.
            down = self._last.get("down")
            height_m = self._last["range_m"] * (1.0 if down is None else float(axis @ down))
            height_m = height_m if height_m > 0 else math.nan
        return {"height_m": height_m, "rate_rad_s": self._last.get("rate_rad_s"), "down": self._last.get("down")}

    def _told(self, frame: Frame) -> dict[str, Any]:
        """Give what the logs tell at a frame, as `VelocityEstimator.update` takes it."""
        told: dict[str, Any] = {}
        t_s = frame.t_s + self.sensors.log_start_s
        values: list[Any] = []
        if self._heights is not None:
            height = self._heights.at(frame=frame.index, t_s=t_s)
            told["height_m" if self._heights.kind == "height" else "range_m"] = height
            std = self._heights.std_at(frame=frame.index, t_s=t_s)
            if math.isfinite(std):
                told["height_std_m"] = std
            values.append(height)
        if self._rates is not None:
            before = self._prev_t_s + self.sensors.log_start_s
            rate = self._rates.mean(before, t_s, delay_s=self.sensors.rate_delay_s)
            # Of the first frame there is no interval.
            if math.isfinite(self._prev_t_s):
                told["rate_rad_s"] = rate
            values.append(rate)
        if self._attitudes is not None:
            told["down"] = down = self._attitudes.down(t_s)
            self.down = down if self._prev_down is None else down + self._prev_down
            self._prev_down = down
            values.append(down)
        for use, value in zip(self._uses, values, strict=True):
            use.count(frame.index, frame.t_s, bool(np.isfinite(value).all()))
        return told

    @property
    def attitude(self) -> dict[str, Any]:
        """How the body stood in the last interval and what its rate came of, as `Trajectory.add` takes it."""
        rate = self._last.get("rate_rad_s")
        told = rate is not None and bool(np.isfinite(rate).all())
        return {"down": self.down, "gyro_std_rad_s": self.sensors.rate_std_rad_s if told else math.inf}

    def missed(self) -> OptionError | None:
        """Give the error that frames were asked for and a log had nothing for any, or None."""
        return next((error for use in self._uses if (error := use.missed(self.sensors.log_start_s))), None)

    def gaps(self) -> list[str]:
        """Say of each log for how many frames it had nothing, where that is any."""
        return [text for use in self._uses if (text := use.gaps())]

    def gyro(self) -> dict[str, Any] | None:
        """Give what the pictures told of the rates: bias, and delay with that which was stated; None without rates."""
        if self._rates is None or self._estimator is None:
            return None
        found = self._estimator.gyro
        return {
            "bias_rad_s": [-float(value) for value in found.bias_rad_s],
            "bias_std_rad_s": [float(value) for value in found.bias_std_rad_s],
            "delay_s": float(found.delay_s) + self.sensors.rate_delay_s,
            "delay_std_s": float(found.delay_std_s),
        }

    def _late(self) -> str:
        """Say how late the rates come, where the pictures are sure of it."""
        gyro = self.gyro()
        off = 0.0 if gyro is None else abs(gyro["delay_s"] - self.sensors.rate_delay_s)
        if gyro is None or not off > max(_SURE * gyro["delay_std_s"], _LATE_S):
            return ""
        delay, std = gyro["delay_s"], gyro["delay_std_s"]
        return (
            f"By the pictures the rates come {1e3 * delay:.1f} +- {1e3 * std:.1f} ms after what they are of: "
            f"--rate-delay {delay:.4f} says so from the first frame on"
        )

    def doubts(self) -> list[str]:
        """Say what was odd, and in how many frames, the most frequent first."""
        found = sorted(self._doubts.items(), key=lambda item: -item[1])
        late = self._late()
        told = [f"In {count} frame{'' if count == 1 else 's'}: {doubt}" for doubt, count in found]
        return [late, *told] if late else told

    def state(self) -> dict[str, Any]:
        """Give what `go_on` needs: what the estimator has learned, and what of the logs was of use."""
        assert self._estimator is not None, "open comes first"
        return {
            # What else it is made of, the options and the camera's file say.
            "chain": self._estimator.__getstate__()["state"]["_chain"],
            "logs": [use.counts() for use in self._uses],
            "prev": (self._prev_t_s, self._prev_down),
            "unstated": self.unstated,
            "variance": self.shares.variance,
            "doubts": self._doubts,
        }

    def go_on(self, state: dict[str, Any]) -> None:
        """Be as when `state` was given."""
        assert self._estimator is not None, "open comes first"
        made = self._estimator.__getstate__()
        self._estimator.__setstate__(made | {"state": made["state"] | {"_chain": state["chain"]}})
        for use, counts in zip(self._uses, state["logs"], strict=True):
            use.go_on(counts)
        self._prev_t_s, self._prev_down = state["prev"]
        self.unstated, self.shares.variance, self._doubts = state["unstated"], state["variance"], state["doubts"]
