"""Velocities as MAVLink messages of a flow sensor: for PX4 and ArduPilot, to a file, a serial port or UDP.

Messages are made by pymavlink (``pip install 'rsflow-motion[mavlink]'``). docs/how-to/autopilots.md has signs,
quality and the parameters to set.
"""

from __future__ import annotations

import contextlib
import math
import re
import struct
from collections.abc import Callable
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import _checks
from .._extras import require
from ..errors import OptionError
from ..io.atomic import Working
from ..velocity import Velocity
from ._whole import Whole
from .flow_sensor import PX4_NOISE_RAD_S, FlowReading, Forward, flow_reading, noise_bounds

__all__ = ["MavlinkWriter"]

_TARGET = (
    "px4:PLACE or ardupilot:PLACE with a place of FILE.tlog, udpout:HOST:PORT or DEVICE,BAUD, "
    "as px4:flow.tlog or ardupilot:/dev/ttyUSB0,115200"
)
_AUTOPILOTS = ("px4", "ardupilot")
_NETWORK = re.compile(r"udpout:[^:,\s]+:\d{1,5}")
_SERIAL = re.compile(r"(?P<device>[^,]+),(?P<baud>\d{1,8})")
# Seconds between two heartbeats, as the MAVLink services ask for.
_HEARTBEAT_S = 1.0
_DECIPIXELS = 10.0
_INT16, _UINT32, _UINT64 = 2**15 - 1, 2**32 - 1, 2**64 - 1


class _Place(NamedTuple):
    autopilot: str
    kind: str
    where: str
    baud: int


class MavlinkWriter(Whole):
    """Write velocities as the messages of a flow sensor that PX4 or ArduPilot reads.

    PX4 gets ``OPTICAL_FLOW_RAD``, ArduPilot ``OPTICAL_FLOW``, both as MAVLink 2, with a heartbeat a second. A frame
    without a velocity is sent with a flow of zero and quality 0, which neither fuses: MAVLink has no other way to say
    that nothing was seen. A ``.tlog`` is written beside and renamed when it is closed; where the ``with`` block raises,
    nothing stays of it.

    Parameters
    ----------
    target : str
        ``px4:`` or ``ardupilot:`` and a place: a file (``px4:flow.tlog``), a network address
        (``ardupilot:udpout:127.0.0.1:14550``), or a serial port and its speed (``px4:/dev/ttyUSB0,115200``).
    forward : {"top", "right", "bottom", "left", "x"}
        Which side of the picture points forward on the vehicle, where the velocities are in the axes of a camera that
        looks down; "x" where the estimator's `R_body_from_camera` gives forward, right, down.
    distance : bool
        Send the height as a distance too. PX4 takes it for the measurement of a range finder where it has none: leave
        it out (False) where the height was assumed.
    epoch_s : float
        Added to the times of frames, which MAVLink counts from 1970 or from the start of the system.
    noise_rad_s : (float, float)
        Deviations of a flow's rate that the qualities 255 and 1 stand for: PX4's EKF2_OF_N_MIN and EKF2_OF_N_MAX.
    system_id, component_id, sensor_id : int
        Whose the messages are: of system 1, the onboard computer, sensor 0.

    Raises
    ------
    MissingExtraError
        If pymavlink, or for a serial port pyserial, is not installed.
    OptionError
        If the target is none of these, or a number is outside of its range.
    OSError
        If the file, the port or the address cannot be opened.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import rsflow
    >>> from rsflow.interop.mavlink import MavlinkWriter
    >>> flight = rsflow.synthetic.flight(frames=3, height_m=0.2, velocity_m_s=(0.0, -0.03, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "flow.tlog")
    ...     with MavlinkWriter(f"px4:{path}", forward="top") as autopilot:
    ...         for frame in flight:
    ...             sent = autopilot.write(estimator.update(frame.image, frame.t_s), height_m=0.2)
    ...     sent.quality, bool(sent.flow_rad[1] > 0), path.stat().st_size > 100
    (255, True, True)
    """

    def __init__(
        self,
        target: str,
        *,
        forward: Forward,
        distance: bool = True,
        epoch_s: float = 0.0,
        noise_rad_s: tuple[float, float] = PX4_NOISE_RAD_S,
        system_id: int = 1,
        component_id: int = 191,
        sensor_id: int = 0,
    ) -> None:
        place = _place(target)
        self.target = target
        self._autopilot = place.autopilot
        self._forward: Forward = _checks.choice("forward", forward, ("top", "right", "bottom", "left", "x"))
        self._distance = _checks.flag("distance", distance)
        self._epoch_s = _checks.number("epoch_s", epoch_s, least=0, most=1e12, of="seconds")
        self._noise = noise_bounds(noise_rad_s)
        system = _checks.integer("system_id", system_id, least=1, most=255)
        component = _checks.integer("component_id", component_id, least=1, most=255)
        self._sensor = _checks.integer("sensor_id", sensor_id, least=0, most=255)
        self._dialect = require(
            "pymavlink.dialects.v20.common", extra="mavlink", purpose="sending velocities to an autopilot"
        )
        self._packer = self._dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._beat_s = -math.inf
        self.count = 0
        self._file: Working | None = None
        self._stream: BinaryIO | None = None
        self._link: Any = None
        if place.kind == "file":
            self._file = Working(place.where)
            self._stream = self._file.path.open("wb")
            self._put: Callable[[bytes, int], None] = self._to_file
        else:
            self._link = _opened(place)
            self._put = self._to_link

    def __repr__(self) -> str:
        sent = f"{self.count} message{'' if self.count == 1 else 's'}"
        return f'MavlinkWriter("{self.target}", forward="{self._forward}"): {sent}'

    def write(
        self,
        velocity: Velocity,
        *,
        height_m: float | None = None,
        rate_rad_s: ArrayLike | None = None,
        down: ArrayLike | None = None,
    ) -> FlowReading | None:
        """Send the message of one interval.

        Parameters
        ----------
        velocity : Velocity
            Of the next frame.
        height_m, rate_rad_s, down : optional
            What the estimator was given for that frame, as of `flow_reading`.

        Returns
        -------
        FlowReading or None
            What was sent; None for a first frame, and one that is not later than the one before: no interval.

        Raises
        ------
        OptionError
            If no height is known for a measured velocity, or a time is before 1970.
        OSError
            If the file cannot be written or the port is gone.
        """
        if self._stream is None and self._link is None:
            raise OptionError(f"target: got {self.target}, which was closed, expected an open one")
        reading = flow_reading(
            velocity,
            forward=self._forward,
            height_m=height_m,
            rate_rad_s=rate_rad_s,
            down=down,
            noise_rad_s=self._noise,
        )
        if not reading.dt_s > 0:
            return None
        time_us = round((reading.t_s + self._epoch_s) * 1e6)
        if not 0 <= time_us <= _UINT64:
            raise OptionError(f"epoch_s: got {self._epoch_s:g}, expected one that makes t_s {reading.t_s:g} 0 or later")
        if reading.t_s - self._beat_s >= _HEARTBEAT_S or reading.t_s < self._beat_s:
            self._beat_s = reading.t_s
            self._put(self._heartbeat().pack(self._packer), time_us)
        encode = self._for_px4 if self._autopilot == "px4" else self._for_ardupilot
        self._put(encode(reading, velocity, time_us).pack(self._packer), time_us)
        self.count += 1
        return reading

    def close(self) -> None:
        """End it: a file is put in its place, a port closed. Harmless when repeated."""
        if self._stream is not None and self._file is not None:
            self._stream.close()
            self._stream = None
            self._file.keep()
        self._end_link()

    def discard(self) -> None:
        """End it without keeping a file. Harmless when repeated, and after `close`."""
        if self._stream is not None and self._file is not None:
            self._stream.close()
            self._stream = None
            self._file.discard()
        self._end_link()

    def _end_link(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            with contextlib.suppress(OSError):
                link.close()

    def _to_file(self, message: bytes, time_us: int) -> None:
        # A telemetry log: microseconds since 1970, big-endian, before each packet.
        assert self._stream is not None
        self._stream.write(struct.pack(">Q", time_us) + bytes(message))

    def _to_link(self, message: bytes, time_us: int) -> None:
        self._link.write(bytes(message))

    def _heartbeat(self) -> Any:
        dialect = self._dialect
        return self._packer.heartbeat_encode(
            dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE
        )

    def _range(self, reading: FlowReading) -> float:
        """Distance in metres, or what stands for none."""
        return reading.distance_m if self._distance and math.isfinite(reading.distance_m) else -1.0

    def _for_px4(self, reading: FlowReading, velocity: Velocity, time_us: int) -> Any:
        return self._packer.optical_flow_rad_encode(
            time_usec=time_us,
            sensor_id=self._sensor,
            integration_time_us=min(round(reading.dt_s * 1e6), _UINT32),
            integrated_x=float(reading.flow_rad[0]),
            integrated_y=float(reading.flow_rad[1]),
            integrated_xgyro=float(reading.gyro_rad[0]),
            integrated_ygyro=float(reading.gyro_rad[1]),
            integrated_zgyro=float(reading.gyro_rad[2]),
            temperature=0,
            quality=reading.quality,
            time_delta_distance_us=0,
            distance=self._range(reading),
        )

    def _for_ardupilot(self, reading: FlowReading, velocity: Velocity, time_us: int) -> Any:
        rate = reading.flow_rad / reading.dt_s
        moved = np.nan_to_num(reading.velocity_m_s) if reading.valid else np.zeros(3)
        # Pixels of the picture: the ground goes back where the vehicle goes forward, and that is a turn about "right".
        angle = float(np.hypot(*reading.flow_rad))
        length = velocity.flow_px if reading.valid and angle > 0 and math.isfinite(velocity.flow_px) else 0.0
        pixels = np.array([-reading.flow_rad[1], reading.flow_rad[0]]) * (_DECIPIXELS * length / (angle or 1.0))
        pixels = np.clip(np.round(pixels), -_INT16, _INT16).astype(int)
        return self._packer.optical_flow_encode(
            time_usec=time_us,
            sensor_id=self._sensor,
            flow_x=int(pixels[0]),
            flow_y=int(pixels[1]),
            flow_comp_m_x=float(moved[0]),
            flow_comp_m_y=float(moved[1]),
            quality=reading.quality,
            ground_distance=self._range(reading),
            flow_rate_x=float(rate[0]),
            flow_rate_y=float(rate[1]),
        )


def _place(target: object) -> _Place:
    """Take a target apart."""
    text = _checks.text("target", target)
    autopilot, colon, place = text.partition(":")
    serial = _SERIAL.fullmatch(place)
    if autopilot in _AUTOPILOTS and colon:
        if _NETWORK.fullmatch(place) and int(place.rpartition(":")[2]) < 2**16:
            return _Place(autopilot, "network", place, 0)
        if place.endswith(".tlog") and len(place) > len(".tlog"):
            return _Place(autopilot, "file", place, 0)
        if serial is not None and ":" not in serial["device"] and int(serial["baud"]) > 0:
            return _Place(autopilot, "serial", serial["device"], int(serial["baud"]))
    raise _checks.refused("target", target, _TARGET)


def _opened(place: _Place) -> Any:
    """Open a port or an address through pymavlink."""
    if place.kind == "serial":
        require("serial", extra="mavlink", purpose="writing to a serial port")
    mavutil = require("pymavlink.mavutil", extra="mavlink", purpose="sending velocities to an autopilot")
    try:
        if place.kind == "serial":
            return mavutil.mavserial(place.where, baud=place.baud)
        return mavutil.mavlink_connection(place.where)
    except OSError as error:
        raise type(error)(error.errno, f"cannot open {place.where}: {error.strerror or error}") from error
