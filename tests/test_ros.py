"""Velocities as ROS 2 bags, read back with rosbags."""

from __future__ import annotations

import numpy as np
import pytest

import rsflow
from rsflow import Velocity, VelocityStatus, _extras
from rsflow.interop.ros import FLOW, STATUS, TWIST, RosBagWriter
from velocity_helpers import QUIET

highlevel = pytest.importorskip("rosbags.highlevel")


def given(v, *, t_s=1.0, dt_s=0.1, covariance=None):
    covariance = np.eye(3) * 1e-4 if covariance is None else covariance
    return Velocity(t_s, dt_s, *map(float, v), covariance, VelocityStatus.OK, 90, 3.0, 4.0)


def blind(t_s=1.0, dt_s=0.1, status=VelocityStatus.NO_TEXTURE):
    return Velocity(t_s, dt_s, *[np.nan] * 3, np.diag([np.inf] * 3), status, 0, np.nan, np.nan)


def read(folder):
    """Time in ns and message of each topic, with the definitions that stand in the bag."""
    found = {TWIST: [], FLOW: [], STATUS: []}
    with highlevel.AnyReader([folder]) as reader:
        assert {connection.topic for connection in reader.connections} == set(found)
        for connection, time_ns, data in reader.messages():
            found[connection.topic].append((time_ns, reader.deserialize(data, connection.msgtype)))
    return found


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_flight_read_back(tmp_path, storage):
    """Camera down, the picture's top forward: forward is -y of the picture, left is -x."""
    v = (0.06, -0.1, 0.0)
    f = rsflow.synthetic.flight(frames=5, height_m=0.5, velocity_m_s=v, seed=2, sensor=QUIET)
    estimator = rsflow.VelocityEstimator(f.camera, height_m=0.5, height_std_m=0.005)
    folder = tmp_path / "bags" / "flight"
    measured = []
    with RosBagWriter(folder, forward="top", storage=storage, epoch_s=1.7e9, frame_id="drone") as bag:
        for frame in f:
            measured.append(estimator.update(frame.image, frame.t_s))
            bag.write(measured[-1], height_m=0.5)
        assert not folder.exists()
        assert bag.count == 5
    assert sorted(path.suffix for path in folder.iterdir()) == [".db3" if storage == "sqlite3" else ".mcap", ".yaml"]
    assert [path.name for path in folder.parent.iterdir()] == ["flight"]
    found = read(folder)
    assert [message.data for _, message in found[STATUS]] == ["first_frame"] + ["ok"] * 4
    assert [time for time, _ in found[STATUS]] == [round((1.7e9 + t) * 1e9) for t in f.t_s]
    for (time_ns, message), velocity in zip(found[TWIST], measured[1:], strict=True):
        stamp = message.header.stamp
        assert (stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id) == (time_ns, "drone")
        linear = message.twist.twist.linear
        assert (linear.x, linear.y, linear.z) == (-velocity.vy_m_s, -velocity.vx_m_s, -velocity.vz_m_s)
        assert linear.x == pytest.approx(0.1, abs=0.002)
        covariance = message.twist.covariance.reshape(6, 6)
        turn = np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]])
        assert covariance[:3, :3] == pytest.approx(turn @ velocity.covariance @ turn.T)
        # No gyro measured the rate: it is what the pictures tell, with its deviation, or not known, and not 0.
        told = velocity.rate_rad_s
        angular = [getattr(message.twist.twist.angular, axis) for axis in "xyz"]
        assert angular == pytest.approx(turn @ told, nan_ok=True)
        assert (np.diag(covariance)[3:] > 0).all()
    for _, message in found[FLOW]:
        assert message.integration_timespan_us == round(1e6 / 30)
        assert message.pixel_flow * 30 == pytest.approx([-0.12, 0.2], abs=0.004)
        assert np.isnan(message.delta_angle).all()
        assert (message.quality, message.distance_m) == (255, 0.5)
        assert (message.max_flow_rate, message.max_ground_distance) == (8.0, 100.0)


def test_rates_and_their_frames(tmp_path):
    with RosBagWriter(tmp_path / "b", forward="x") as bag:
        bag.write(given((1, 2, 3)), height_m=2.0, rate_rad_s=(0.1, 0.2, 0.3))
    found = read(tmp_path / "b")
    twist = found[TWIST][0][1].twist.twist
    assert (twist.linear.x, twist.linear.y, twist.linear.z) == (1.0, -2.0, -3.0)
    assert (twist.angular.x, twist.angular.y, twist.angular.z) == (0.1, -0.2, -0.3)
    flow = found[FLOW][0][1]
    assert flow.delta_angle == pytest.approx([0.01, 0.02, 0.03])
    assert flow.pixel_flow == pytest.approx([0.01 - 0.1, 0.02 + 0.05])


def test_what_was_not_measured_is_not_made_up(tmp_path):
    with RosBagWriter(tmp_path / "b", forward="top", distance=False) as bag:
        assert bag.write(blind(dt_s=np.nan, status=VelocityStatus.FIRST_FRAME)) is None
        assert bag.write(blind(t_s=1.1)).quality == 0
        covariance = np.diag([1e-4, 1e-4, np.inf])
        bag.write(given((1, 0, np.nan), t_s=1.2, covariance=covariance), height_m=2.0)
    found = read(tmp_path / "b")
    assert [message.data for _, message in found[STATUS]] == ["first_frame", "no_texture", "ok"]
    assert [message.quality for _, message in found[FLOW]] == [0, 255]
    assert np.isnan([message.distance_m for _, message in found[FLOW]]).all()
    (_, twist) = found[TWIST][0]
    assert len(found[TWIST]) == 1
    assert found[FLOW][1][1].pixel_flow == pytest.approx([-0.05, 0.0])
    assert (twist.twist.twist.linear.x, twist.twist.twist.linear.y) == (0.0, -1.0)
    assert np.isnan(twist.twist.twist.linear.z)
    assert twist.twist.covariance.reshape(6, 6)[2].tolist() == [0, 0, np.inf, 0, 0, 0]


def test_a_bag_is_kept_whole_or_not_at_all_and_nothing_else_is_replaced(tmp_path):
    folder = tmp_path / "b"

    def breaks():
        with RosBagWriter(folder, forward="x") as bag:
            bag.write(given((1, 0, 0)), height_m=1.0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        breaks()
    assert list(tmp_path.iterdir()) == []
    bag = RosBagWriter(folder, forward="x")
    bag.write(given((1, 0, 0)), height_m=1.0)
    bag.close()
    bag.close()
    bag.discard()
    assert len(read(folder)[TWIST]) == 1
    with pytest.raises(rsflow.OptionError, match="which was closed"):
        bag.write(given((1, 0, 0)), height_m=1.0)
    with pytest.raises(FileExistsError, match="a bag: overwrite=True"):
        RosBagWriter(folder, forward="x")
    with RosBagWriter(folder, forward="x", overwrite=True) as bag:
        for k in range(3):
            bag.write(given((1, 0, 0), t_s=0.1 * k), height_m=1.0)
        assert len(read(folder)[TWIST]) == 1
    assert len(read(folder)[TWIST]) == 3
    own = tmp_path / "photos"
    own.mkdir()
    (own / "a.jpg").write_text("mine")
    with pytest.raises(FileExistsError, match="is left alone"):
        RosBagWriter(own, forward="x", overwrite=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "photos"]


def test_what_a_killed_process_left_is_removed(tmp_path):
    from rsflow.io.atomic import left_by_the_dead, working_name
    from rsflow.io.processes import this_process

    dead = working_name(tmp_path / "b")
    dead = dead.with_name(dead.name.replace(this_process().split("-")[0], "4194304", 1))
    if not left_by_the_dead(dead.name):
        pytest.skip("the name of a dead process is not told here")
    dead.mkdir()
    (dead / "part").write_text("")
    with RosBagWriter(tmp_path / "b", forward="x"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_wrong_arguments_and_a_missing_package(tmp_path, monkeypatch):
    for wrong in ({"forward": "up"}, {"storage": "zip"}, {"max_flow_rate_rad_s": 0.0}, {"noise_rad_s": (1.0, 0.5)}):
        (name,) = wrong
        with pytest.raises(rsflow.OptionError, match=f"{name}: got"):
            RosBagWriter(tmp_path / "b", **{"forward": "x", **wrong})
    with RosBagWriter(tmp_path / "b", forward="x") as bag, pytest.raises(rsflow.OptionError, match="epoch_s: got 0"):
        bag.write(given((1, 0, 0), t_s=-5.0), height_m=1.0)
    real = _extras.importlib.import_module

    def gone(module):
        if module.startswith("rosbags"):
            raise ModuleNotFoundError("No module named 'rosbags'", name="rosbags")
        return real(module)

    monkeypatch.setattr(_extras.importlib, "import_module", gone)
    with pytest.raises(rsflow.MissingExtraError, match=r"pip install 'rsflow-motion\[ros\]'"):
        RosBagWriter(tmp_path / "c", forward="x")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]
