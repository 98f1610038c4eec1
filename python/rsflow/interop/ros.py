"""Velocities as a ROS 2 bag: twists with covariance for ROS, optical flow for PX4.

Written by rosbags, which needs no ROS (``pip install 'rsflow-motion[ros]'``). docs/how-to/autopilots.md has axes and
topics.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import shutil
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._extras import require
from ..errors import OptionError
from ..io.atomic import left_by_the_dead, working_name
from ..velocity import Velocity
from ._whole import Whole
from .flow_sensor import PX4_NOISE_RAD_S, FlowReading, Forward, flow_reading, noise_bounds

__all__ = ["RosBagWriter"]

F64 = NDArray[np.float64]

TWIST, FLOW, STATUS = "/rsflow/velocity", "/rsflow/vehicle_optical_flow", "/rsflow/status"
_FLOW_TYPE = "px4_msgs/msg/VehicleOpticalFlow"
# The message of px4_msgs for PX4 1.14 to 1.16.
_FLOW_DEFINITION = """\
uint64 timestamp
uint64 timestamp_sample
uint32 device_id
float32[2] pixel_flow
float32[3] delta_angle
float32 distance_m
uint32 integration_timespan_us
uint8 quality
float32 max_flow_rate
float32 min_ground_distance
float32 max_ground_distance
"""
# Forward, left, up (REP 103) from forward, right, down.
_FLU = np.array([1.0, -1.0, -1.0])
# The older one of those that rosbags writes.
_BAG_VERSION = 8
_UINT32 = 2**32 - 1


class RosBagWriter(Whole):
    """Write velocities to a ROS 2 bag.

    ``/rsflow/velocity``, geometry_msgs/TwistWithCovarianceStamped
        Velocity and rate of the vehicle along forward, left, up (REP 103), with their covariance; only of frames where
        a velocity was measured.
    ``/rsflow/vehicle_optical_flow``, px4_msgs/VehicleOpticalFlow
        Flow and gyro about forward, right, down; quality 0 where there is no velocity.
    ``/rsflow/status``, std_msgs/String
        What became of each frame.

    What is not known is NaN in a twist, with an infinite variance: a vertical velocity or a rate that was not measured.

    The bag is written beside and renamed when it is closed; where the ``with`` block raises, nothing stays of it.

    Parameters
    ----------
    folder : path
        The bag: a folder that is made, with ``metadata.yaml`` and the file of messages.
    forward : {"top", "right", "bottom", "left", "x"}
        What points forward, as of `flow_reading`.
    storage : {"sqlite3", "mcap"}
        Kind of the file of messages.
    frame_id : str
        Name of the vehicle's axes.
    distance : bool
        Give the height as a distance to PX4 too, which takes it for a measured range; False where it was assumed.
    epoch_s : float
        Added to the times of frames, as of `MavlinkWriter`.
    noise_rad_s : (float, float)
        Deviations of a flow's rate that the qualities 255 and 1 stand for, as of `MavlinkWriter`.
    max_flow_rate_rad_s, min_distance_m, max_distance_m : float
        What the sensor can do, for PX4: its defaults of SENS_FLOW_MAXR, SENS_FLOW_MINHGT and SENS_FLOW_MAXHGT. A
        largest rate of 0 would keep PX4 from using it.
    overwrite : bool
        Replace a bag of that name.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    OptionError
        If an argument is outside of its range.
    OSError
        If the folder is there already and `overwrite` is False, or cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import rsflow
    >>> from rsflow.interop.ros import RosBagWriter
    >>> flight = rsflow.synthetic.flight(frames=3, height_m=0.2, velocity_m_s=(0.0, -0.03, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with RosBagWriter(pathlib.Path(folder, "flight"), forward="top") as bag:
    ...         for frame in flight:
    ...             reading = bag.write(estimator.update(frame.image, frame.t_s), height_m=0.2)
    ...     sorted(path.name for path in pathlib.Path(folder, "flight").iterdir())
    ['flight.db3', 'metadata.yaml']
    >>> round(float(reading.velocity_m_s[0]), 3)
    0.03
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        forward: Forward,
        storage: Literal["sqlite3", "mcap"] = "sqlite3",
        frame_id: str = "base_link",
        distance: bool = True,
        epoch_s: float = 0.0,
        noise_rad_s: tuple[float, float] = PX4_NOISE_RAD_S,
        max_flow_rate_rad_s: float = 8.0,
        min_distance_m: float = 0.08,
        max_distance_m: float = 100.0,
        overwrite: bool = False,
    ) -> None:
        self.folder = _checks.path("folder", folder, "the path of a folder")
        self._forward: Forward = _checks.choice("forward", forward, ("top", "right", "bottom", "left", "x"))
        kind = _checks.choice("storage", storage, ("sqlite3", "mcap"))
        self._frame_id = _checks.text("frame_id", frame_id)
        self._distance = _checks.flag("distance", distance)
        self._epoch_s = _checks.number("epoch_s", epoch_s, least=0, most=2**31 - 1, of="seconds")
        self._noise = noise_bounds(noise_rad_s)
        least = _checks.number("min_distance_m", min_distance_m, least=0, most=1e6, of="metres")
        self._limits = {
            "max_flow_rate": _checks.number("max_flow_rate_rad_s", max_flow_rate_rad_s, above=0, most=1e6, of="rad/s"),
            "min_ground_distance": least,
            "max_ground_distance": _checks.number("max_distance_m", max_distance_m, above=least, most=1e6, of="metres"),
        }
        self._overwrite = _checks.flag("overwrite", overwrite)
        purpose = "writing a ROS 2 bag"
        rosbag2 = require("rosbags.rosbag2", extra="ros", purpose=purpose)
        typesys = require("rosbags.typesys", extra="ros", purpose=purpose)
        self.count = 0
        self._types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._types.register(typesys.get_types_from_msg(_FLOW_DEFINITION, _FLOW_TYPE))
        self._working: Path | None = _beside(self.folder, overwrite=self._overwrite)
        self._bag: Any = None
        try:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            # The names within come from that of the folder, which it keeps when it is moved.
            bag = rosbag2.Writer(self._working / self.folder.name, version=_BAG_VERSION, storage_plugin=plugin)
            bag.open()
            self._bag = bag
            self._connections = {
                topic: bag.add_connection(topic, name, typestore=self._types)
                for topic, name in (
                    (TWIST, "geometry_msgs/msg/TwistWithCovarianceStamped"),
                    (FLOW, _FLOW_TYPE),
                    (STATUS, "std_msgs/msg/String"),
                )
            }
        except BaseException:
            self.discard()
            raise

    def __repr__(self) -> str:
        sent = f"{self.count} frame{'' if self.count == 1 else 's'}"
        return f'RosBagWriter("{self.folder}", forward="{self._forward}"): {sent}'

    def write(
        self,
        velocity: Velocity,
        *,
        height_m: float | None = None,
        rate_rad_s: ArrayLike | None = None,
        down: ArrayLike | None = None,
    ) -> FlowReading | None:
        """Write the messages of one frame.

        Parameters
        ----------
        velocity : Velocity
            Of the next frame.
        height_m, rate_rad_s, down : optional
            What the estimator was given for that frame, as of `flow_reading`.

        Returns
        -------
        FlowReading or None
            What was written; None for a first frame, and one that is not later than the one before: no interval, and a
            status alone.

        Raises
        ------
        OptionError
            If no height is known for a measured velocity, or a time is before 1970.
        """
        if self._bag is None:
            raise OptionError(f"folder: got {self.folder}, which was closed, expected an open one")
        reading = flow_reading(
            velocity,
            forward=self._forward,
            height_m=height_m,
            rate_rad_s=rate_rad_s,
            down=down,
            noise_rad_s=self._noise,
        )
        time_ns = round((reading.t_s + self._epoch_s) * 1e9)
        if not 0 <= time_ns < 2**31 * 10**9:
            raise OptionError(f"epoch_s: got {self._epoch_s:g}, expected one that makes t_s {reading.t_s:g} 0 or later")
        types = self._types.types
        self._put(STATUS, time_ns, types["std_msgs/msg/String"](data=velocity.status.word))
        self.count += 1
        if not reading.dt_s > 0:
            return None
        self._put(FLOW, time_ns, self._flow(reading, time_ns))
        if velocity.valid:
            self._put(TWIST, time_ns, self._twist(reading, time_ns))
        return reading

    def close(self) -> None:
        """End the bag and put it in its place. Harmless when repeated."""
        bag, self._bag = self._bag, None
        if bag is None or self._working is None:
            return
        try:
            bag.close()
            _keep(self._working / self.folder.name, self.folder, overwrite=self._overwrite)
        finally:
            self.discard()

    def discard(self) -> None:
        """End it without keeping a bag. Harmless when repeated, and after `close`."""
        bag, self._bag = self._bag, None
        if bag is not None:
            with contextlib.suppress(Exception):
                bag.close()
        working, self._working = self._working, None
        if working is not None:
            shutil.rmtree(working, ignore_errors=True)

    def _put(self, topic: str, time_ns: int, message: Any) -> None:
        data = self._types.serialize_cdr(message, message.__msgtype__)
        self._bag.write(self._connections[topic], time_ns, data)

    def _twist(self, reading: FlowReading, time_ns: int) -> Any:
        types = self._types.types
        vector, header = types["geometry_msgs/msg/Vector3"], types["std_msgs/msg/Header"]
        stamp = types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = _flu(reading.covariance)
        covariance[3:, 3:] = _flu(reading.rate_covariance)
        parts = [vector(*(float(x) for x in part * _FLU)) for part in (reading.velocity_m_s, reading.rate_rad_s)]
        twist = types["geometry_msgs/msg/Twist"](linear=parts[0], angular=parts[1])
        return types["geometry_msgs/msg/TwistWithCovarianceStamped"](
            header=header(stamp=stamp, frame_id=self._frame_id),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=covariance.ravel()),
        )

    def _flow(self, reading: FlowReading, time_ns: int) -> Any:
        distance = reading.distance_m if self._distance else math.nan
        return self._types.types[_FLOW_TYPE](
            timestamp=time_ns // 1000,
            timestamp_sample=time_ns // 1000,
            device_id=0,
            pixel_flow=reading.flow_rad.astype(np.float32),
            delta_angle=reading.gyro_rad.astype(np.float32),
            distance_m=distance,
            integration_timespan_us=min(round(reading.dt_s * 1e6), _UINT32),
            quality=reading.quality,
            **self._limits,
        )


def _flu(covariance: F64) -> F64:
    """Give a covariance along forward, left, up; what is not known has an infinite variance and no covariance."""
    known = np.isfinite(np.diag(covariance))
    plain = np.where(np.outer(known, known) & np.isfinite(covariance), covariance, 0.0) * np.outer(_FLU, _FLU)
    plain[~known, ~known] = np.inf
    return plain


def _beside(folder: Path, *, overwrite: bool) -> Path:
    """Make a working folder beside a bag, which must not be there; and remove those of processes that died."""
    if folder.name in ("", ".."):
        raise OptionError(f"folder: got {folder}, expected the name of a folder that is made")
    _expect_none(folder, overwrite=overwrite)
    folder.parent.mkdir(parents=True, exist_ok=True)
    for entry in folder.parent.iterdir():
        if left_by_the_dead(entry.name) and entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry, ignore_errors=True)
    working = working_name(folder)
    working.mkdir()
    return working


def _expect_none(folder: Path, *, overwrite: bool) -> None:
    """Raise FileExistsError where something else than an empty folder is there, or a bag that may be replaced."""
    if not folder.exists() and not folder.is_symlink():
        return
    empty = folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir())
    a_bag = folder.is_dir() and not folder.is_symlink() and (folder / "metadata.yaml").is_file()
    if not (empty or (a_bag and overwrite)):
        told = "a bag: overwrite=True (--overwrite) replaces it" if a_bag else "no bag, and is left alone"
        raise FileExistsError(errno.EEXIST, f"there is something already, {told}", str(folder))


def _keep(made: Path, folder: Path, *, overwrite: bool) -> None:
    """Put a bag in its place, and remove the one that stood there."""
    _expect_none(folder, overwrite=overwrite)
    old = None
    if folder.exists():
        old = made.with_name(f"{made.name}.before")
        folder.rename(old)
    try:
        made.rename(folder)
    except OSError:
        if old is not None:
            old.rename(folder)
        raise
