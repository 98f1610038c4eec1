"""Velocities as a flow sensor's messages, read back with pymavlink: signs in both conventions, quality, links."""

from __future__ import annotations

import os
import socket
import time

import numpy as np
import pytest

import rsflow
from rsflow import Velocity, VelocityStatus, _extras
from rsflow.interop.flow_sensor import flow_reading, quality_of
from rsflow.interop.mavlink import MavlinkWriter
from velocity_helpers import QUIET

mavutil = pytest.importorskip("pymavlink.mavutil")

SIDES = {"top": (0.0, -1.0), "right": (1.0, 0.0), "bottom": (0.0, 1.0), "left": (-1.0, 0.0)}


def given(v, *, t_s=1.0, dt_s=0.1, std=0.01, parts=None, status=VelocityStatus.OK):
    covariance = np.eye(3) * std**2 if parts is None else sum(parts.values())
    return Velocity(t_s, dt_s, *map(float, v), covariance, status, 90, 3.0, 4.0, parts=parts or {})


def blind(t_s=1.0, dt_s=0.1, status=VelocityStatus.NO_TEXTURE):
    return Velocity(t_s, dt_s, *[np.nan] * 3, np.diag([np.inf] * 3), status, 0, np.nan, np.nan)


def read(path):
    """Messages of a log but heartbeats, with the time that stands before each."""
    if path.stat().st_size == 0:
        return [], []
    log = mavutil.mavlink_connection(str(path), dialect="common")
    found = []
    while (message := log.recv_match()) is not None:
        found.append(message)
    log.close()
    assert {message.get_type() for message in found} <= {"HEARTBEAT", "OPTICAL_FLOW", "OPTICAL_FLOW_RAD"}
    return [message for message in found if message.get_type() != "HEARTBEAT"], found


def sent(tmp_path, autopilot, velocity, *, forward="x", height_m=2.0, **options):
    path = tmp_path / f"{autopilot}.tlog"
    with MavlinkWriter(f"{autopilot}:{path}", forward=forward) as writer:
        writer.write(velocity, height_m=height_m, **options)
    (message,), _ = read(path)
    return message


# What PX4's page "Optical Flow" and ArduPilot's driver ask for: forward +Y, right -X; a turn gives flow and gyro alike.
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("v", "sign"),
    [((1, 0, 0), (0, 1)), ((-1, 0, 0), (0, -1)), ((0, 1, 0), (-1, 0)), ((0, -1, 0), (1, 0)), ((0, 0, 1), (0, 0))],
    ids=["forward", "back", "right", "left", "down"],
)
def test_signs_of_motion(tmp_path, autopilot, v, sign):
    """One metre a second 2 m over the ground: half a radian a second, in 0.1 s."""
    message = sent(tmp_path, autopilot, given(v))
    if autopilot == "px4":
        assert message.get_type() == "OPTICAL_FLOW_RAD"
        assert (message.integrated_x, message.integrated_y) == pytest.approx(np.array(sign) * 0.05)
        assert message.integration_time_us == 100_000
        assert np.isnan([message.integrated_xgyro, message.integrated_ygyro, message.integrated_zgyro]).all()
        assert message.distance == 2.0
    else:
        assert message.get_type() == "OPTICAL_FLOW"
        assert (message.flow_rate_x, message.flow_rate_y) == pytest.approx(np.array(sign) * 0.5)
        assert (message.flow_comp_m_x, message.flow_comp_m_y) == pytest.approx(v[:2])
        # The ground goes back in the picture; 5 pixels in tenths of one.
        assert (message.flow_x, message.flow_y) == tuple(-50 * np.array(v[:2]))
        assert message.ground_distance == 2.0
    assert (message.quality, message.time_usec, message.sensor_id) == (255, 1_000_000, 0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_pure_turn_gives_flow_and_gyro_alike(tmp_path, axis):
    rate = np.eye(3)[axis] * 0.4
    message = sent(tmp_path, "px4", given((0, 0, 0)), rate_rad_s=rate)
    flow = (message.integrated_x, message.integrated_y)
    gyro = (message.integrated_xgyro, message.integrated_ygyro, message.integrated_zgyro)
    assert gyro == pytest.approx(rate * 0.1)
    assert flow == pytest.approx(rate[:2] * 0.1)


@pytest.mark.parametrize("forward", SIDES)
def test_the_side_of_the_picture_that_points_forward(forward):
    """Motion of the camera towards that side is forward motion; to its right is motion to the right."""
    side = np.array([*SIDES[forward], 0.0])
    ahead = flow_reading(given(side), forward=forward, height_m=1.0)
    assert ahead.velocity_m_s == pytest.approx([1, 0, 0])
    assert ahead.flow_rad == pytest.approx([0.0, 0.1])
    # Seen from above, right is a quarter turn clockwise: as x to y of a picture that looks down.
    right = flow_reading(given((-side[1], side[0], 0.0)), forward=forward, height_m=1.0)
    assert right.velocity_m_s == pytest.approx([0, 1, 0])
    assert right.flow_rad == pytest.approx([-0.1, 0.0])
    noise = {"displacement": np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.2], [0.5, 0.2, 1.0]]) * 1e-4}
    turned = flow_reading(given(side, parts=noise), forward=forward, height_m=1.0).covariance
    true = side @ noise["displacement"] @ side
    assert turned[0, 0] == pytest.approx(true)
    assert np.linalg.eigvalsh(turned) == pytest.approx(np.linalg.eigvalsh(noise["displacement"]))


@pytest.mark.parametrize("case", ["forward", "right", "roll", "pitch"])
def test_signs_over_rendered_ground(tmp_path, case):
    """A camera that looks down, the picture's top forward: forward is -y of the picture, right is x."""
    motion = {"forward": (0.0, -0.1, 0.0), "right": (0.1, 0.0, 0.0)}.get(case, (0.0, 0.0, 0.0))
    # Right wing down turns about forward, -y of the camera; nose up about right, its x.
    rate = {"roll": (0.0, -0.2, 0.0), "pitch": (0.2, 0.0, 0.0)}.get(case, (0.0, 0.0, 0.0))
    f = rsflow.synthetic.flight(frames=4, height_m=0.5, velocity_m_s=motion, rate_rad_s=rate, seed=2, sensor=QUIET)
    estimator = rsflow.VelocityEstimator(f.camera, height_m=0.5, height_std_m=0.0, rate_std_rad_s=0.001)
    path = tmp_path / "a.tlog"
    with MavlinkWriter(f"px4:{path}", forward="top") as writer:
        for k, frame in enumerate(f):
            v = estimator.update(frame.image, frame.t_s, rate_rad_s=f.rate_rad_s[k] if k else None)
            writer.write(v, height_m=0.5, rate_rad_s=f.rate_rad_s[k] if k else None)
    messages, _ = read(path)
    assert len(messages) == 3
    flow = {"forward": (0.0, 0.2), "right": (-0.2, 0.0), "roll": (0.2, 0.0), "pitch": (0.0, 0.2)}[case]
    gyro = flow if case in ("roll", "pitch") else (0.0, 0.0)
    for message in messages:
        per_second = 1e6 / message.integration_time_us
        got = np.array([message.integrated_x, message.integrated_y]) * per_second
        assert got == pytest.approx(flow, abs=0.004)
        got = np.array([message.integrated_xgyro, message.integrated_ygyro]) * per_second
        # What was learned of the gyro is taken off it.
        assert got == pytest.approx(gyro, abs=0.003)
        assert message.quality == 255


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("status", [s for s in VelocityStatus if not s.valid and s.name != "FIRST_FRAME"])
def test_a_frame_without_a_velocity_has_quality_zero(tmp_path, autopilot, status):
    message = sent(tmp_path, autopilot, blind(status=status), rate_rad_s=(0.1, 0.0, 0.0))
    assert message.quality == 0
    if autopilot == "px4":
        assert (message.integrated_x, message.integrated_y) == (0.0, 0.0)
        assert message.integrated_xgyro == pytest.approx(0.01)
    else:
        assert (message.flow_rate_x, message.flow_rate_y, message.flow_x, message.flow_comp_m_x) == (0, 0, 0, 0)


def test_frames_without_an_interval_are_not_sent(tmp_path):
    with MavlinkWriter(f"px4:{tmp_path / 'a.tlog'}", forward="top") as writer:
        assert writer.write(blind(dt_s=np.nan, status=VelocityStatus.FIRST_FRAME)) is None
        assert writer.write(blind(dt_s=-0.1, status=VelocityStatus.TIME_NOT_INCREASING)) is None
        assert (writer.count, repr(writer)[:13]) == (0, "MavlinkWriter")
    assert read(tmp_path / "a.tlog")[1] == []


def test_quality_is_what_px4_reads_as_a_deviation():
    """PX4 takes 255 for EKF2_OF_N_MIN, 1 for EKF2_OF_N_MAX, and weighs deviations in between (calcOptFlowMeasVar)."""
    for noise in np.linspace(0.15, 0.5, 50):
        quality = quality_of(noise)
        weight = (quality - 1) / 254
        assert 0.15 * weight + 0.5 * (1 - weight) == pytest.approx(noise, abs=0.35 / 254)
    assert [quality_of(x) for x in (0.0, 0.1, 0.501, 9.0, np.nan)] == [255, 255, 0, 0, 0]
    assert quality_of(0.1, best=0.05, worst=0.15) == 128
    # Deviation of the flow: 0.65 m/s over 2 m are 0.325 rad/s.
    reading = flow_reading(given((1, 0, 0), std=0.65), forward="x", height_m=2.0)
    assert reading.noise_rad_s == pytest.approx(0.325)
    assert reading.quality == 128
    assert flow_reading(given((1, 0, 0), std=1.1), forward="x", height_m=2.0).quality == 0


def test_neither_height_nor_gyro_are_in_the_quality_since_they_are_not_in_the_flow():
    v = np.array([1.0, 0.0, 0.0])
    parts = {"displacement": np.eye(3) * 1e-4, "height": np.outer(v, v), "gyro": np.eye(3)}
    reading = flow_reading(given(v, parts=parts), forward="x", height_m=2.0)
    assert reading.noise_rad_s == pytest.approx(0.005)
    # The same flow, whatever height was taken for the velocity.
    other = flow_reading(given(v * 0.5, parts={"displacement": np.eye(3) * 0.25e-4}), forward="x", height_m=1.0)
    assert other.flow_rad == pytest.approx(reading.flow_rad)
    assert (other.noise_rad_s, other.quality) == (pytest.approx(0.005), 255)


def test_a_tilted_vehicle_is_further_from_the_ground_along_its_axis():
    down = (np.sin(0.5), 0.0, np.cos(0.5))
    reading = flow_reading(given((1, 0, 0)), forward="x", height_m=2.0, down=down)
    assert reading.distance_m == pytest.approx(2.0 / np.cos(0.5))
    assert reading.flow_rad == pytest.approx([0.0, 0.1 * np.cos(0.5) / 2.0])
    past = flow_reading(given((1, 0, 0)), forward="x", height_m=2.0, down=(1.0, 0.0, 0.1))
    assert (past.quality, past.valid) == (0, False)
    assert np.isnan(past.distance_m)


def test_an_assumed_height_is_not_sent_as_a_distance(tmp_path):
    path = tmp_path / "a.tlog"
    with MavlinkWriter(f"px4:{path}", forward="x", distance=False, epoch_s=1.7e9, sensor_id=3, system_id=7) as writer:
        writer.write(given((1, 0, 0)), height_m=2.0)
    (message,), _ = read(path)
    assert (message.distance, message.sensor_id, message.get_srcSystem()) == (-1.0, 3, 7)
    assert message.time_usec == 1_700_000_001_000_000
    assert message._timestamp == pytest.approx(1_700_000_001.0)


def test_a_heartbeat_a_second(tmp_path):
    path = tmp_path / "a.tlog"
    with MavlinkWriter(f"ardupilot:{path}", forward="x") as writer:
        for k in range(35):
            writer.write(given((1, 0, 0), t_s=0.1 * k, dt_s=0.1), height_m=1.0)
        assert writer.count == 35
    flow, everything = read(path)
    assert len(flow) == 35
    assert len(everything) - len(flow) == 4
    assert [m.time_usec for m in flow] == [round(1e5 * k) for k in range(35)]


def test_a_log_is_kept_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.tlog"
    path.write_text("before")

    def breaks():
        with MavlinkWriter(f"px4:{path}", forward="x") as writer:
            writer.write(given((1, 0, 0)), height_m=1.0)
            assert path.read_text() == "before"
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        breaks()
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
    writer = MavlinkWriter(f"px4:{path}", forward="x")
    writer.write(given((1, 0, 0)), height_m=1.0)
    writer.close()
    writer.close()
    writer.discard()
    assert len(read(path)[0]) == 1
    with pytest.raises(rsflow.OptionError, match="which was closed"):
        writer.write(given((1, 0, 0)), height_m=1.0)


def test_udp():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    receiver = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="common")
    try:
        with MavlinkWriter(f"ardupilot:udpout:127.0.0.1:{port}", forward="x") as writer:
            writer.write(given((1, 0, 0)), height_m=2.0)
            message = receiver.recv_match(type="OPTICAL_FLOW", blocking=True, timeout=10)
        assert message.flow_rate_y == pytest.approx(0.5)
    finally:
        receiver.close()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals here")
def test_a_serial_port():
    pytest.importorskip("serial")
    from pymavlink.dialects.v20 import common

    reading, port = os.openpty()
    try:
        with MavlinkWriter(f"px4:{os.ttyname(port)},115200", forward="x") as writer:
            writer.write(given((0, 1, 0)), height_m=2.0)
            parser, messages, end = common.MAVLink(None), [], time.monotonic() + 10
            while len(messages) < 2 and time.monotonic() < end:
                messages += parser.parse_buffer(os.read(reading, 512)) or []
    finally:
        os.close(reading)
        os.close(port)
    assert [m.get_type() for m in messages] == ["HEARTBEAT", "OPTICAL_FLOW_RAD"]
    assert messages[1].integrated_x == pytest.approx(-0.05)


@pytest.mark.parametrize(
    "target",
    [
        "",
        "px4",
        "px4:",
        "px4:.tlog",
        "px4:flow.log",
        "flow.tlog",
        "apm:flow.tlog",
        "px4:udpout:127.0.0.1",
        "px4:udpout:127.0.0.1:99999",
        "px4:udpin:127.0.0.1:14550",
        "px4:/dev/ttyUSB0",
        "px4:/dev/ttyUSB0,0",
        "px4:/dev/ttyUSB0,fast",
    ],
)
def test_a_wrong_target_says_what_would_be_right(target):
    with pytest.raises(rsflow.OptionError, match=r"target: got .*, expected px4:PLACE or ardupilot:PLACE"):
        MavlinkWriter(target, forward="top")


def test_what_else_is_wrong(tmp_path, monkeypatch):
    target = f"px4:{tmp_path / 'a.tlog'}"
    with pytest.raises(rsflow.OptionError, match="forward: got"):
        MavlinkWriter(target, forward="up")
    with pytest.raises(rsflow.OptionError, match="noise_rad_s: got"):
        MavlinkWriter(target, forward="x", noise_rad_s=(0.5, 0.1))
    with pytest.raises(OSError, match=r"cannot open .*no-such-port"):
        MavlinkWriter("px4:/dev/no-such-port,115200", forward="x")
    with MavlinkWriter(target, forward="x") as writer, pytest.raises(rsflow.OptionError, match="epoch_s: got 0"):
        writer.write(given((1, 0, 0), t_s=-5.0), height_m=1.0)
    real = _extras.importlib.import_module

    def gone(module):
        if module.startswith("pymavlink"):
            raise ModuleNotFoundError("No module named 'pymavlink'", name="pymavlink")
        return real(module)

    monkeypatch.setattr(_extras.importlib, "import_module", gone)
    with pytest.raises(rsflow.MissingExtraError, match=r"pip install 'rsflow-motion\[mavlink\]'"):
        MavlinkWriter(target, forward="x")
    assert [path.name for path in tmp_path.iterdir()] == ["a.tlog"]
