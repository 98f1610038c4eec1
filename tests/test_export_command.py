"""``--mavlink`` and ``--ros2-bag`` of ``rsflow velocity`` and ``rsflow live``, read back."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from rsflow import cli
from rsflow.synthetic import flight
from velocity_helpers import QUIET

mavutil = pytest.importorskip("pymavlink.mavutil")
highlevel = pytest.importorskip("rosbags.highlevel")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Pictures of a camera that moves to its right at 0.2 m/s, 0.4 m up, and rolls about its y axis."""
    folder = tmp_path_factory.mktemp("flight")
    f = flight(
        frames=6,
        height_m=0.4,
        velocity_m_s=(0.2, 0.0, 0.0),
        rate_rad_s=(0.0, 0.05, 0.0),
        rate_hz=20.0,
        seed=3,
        sensor=QUIET,
    )
    for k, image in enumerate(f.images):
        cv2.imwrite(str(folder / f"{k:03d}.png"), image)
    f.camera.save(folder / "cam.json")
    times = np.arange(-2, 12) / 40
    rows = "".join(f"{t},0,0.05,0\n" for t in times)
    (folder / "rates.csv").write_text("t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s\n" + rows)
    (folder / "heights.csv").write_text("t_s,height_m\n" + "".join(f"{t},0.4\n" for t in f.t_s))
    return folder


def velocity(flown, tmp_path, *more):
    command = ["velocity", f"{flown}/*.png", "--rate", "20", "--camera", f"{flown}/cam.json", "-o", f"{tmp_path}/out"]
    return cli.main([*command, *map(str, more)])


def messages(path, kind):
    log = mavutil.mavlink_connection(str(path), dialect="common")
    found = []
    while (message := log.recv_match(type=kind)) is not None:
        found.append(message)
    log.close()
    return found


def flow_of(message):
    return np.array([message.integrated_x, message.integrated_y]) * 1e6 / message.integration_time_us


def test_a_log_and_a_bag_of_the_same_flight(flown, tmp_path, capsys):
    log, bag = tmp_path / "flow.tlog", tmp_path / "bag"
    given = ("--height", 0.4, "--rates", flown / "rates.csv", "--mavlink", f"px4:{log}", "--ros2-bag", bag)
    assert velocity(flown, tmp_path, *given) == 0
    printed = capsys.readouterr().out
    assert f"sent   px4:{log}: 5 frames, 0 of them with quality 0" in printed
    found = messages(log, "OPTICAL_FLOW_RAD")
    assert len(found) == 5
    for message in found:
        # To the right: -x; the camera's y is backward, so that the roll is about minus forward.
        assert flow_of(message) == pytest.approx([-0.2 / 0.4 - 0.05, 0.0], abs=0.01)
        gyro = np.array([message.integrated_xgyro, message.integrated_ygyro, message.integrated_zgyro])
        assert gyro * 20 == pytest.approx([-0.05, 0.0, 0.0], abs=0.005)
        # The height was typed: no range finder said it.
        assert message.distance == -1.0
    with highlevel.AnyReader([bag]) as reader:
        twists = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == "/rsflow/velocity"
        ]
    assert len(twists) == 5
    assert [t.twist.twist.linear.y for t in twists] == pytest.approx([-0.2] * 5, abs=0.004)
    assert [t.twist.twist.angular.x for t in twists] == pytest.approx([-0.05] * 5, abs=0.005)


def test_the_side_that_points_forward_and_measured_heights(flown, tmp_path, capsys):
    log = tmp_path / "flow.tlog"
    given = ("--height-csv", flown / "heights.csv", "--mavlink", f"ardupilot:{log}", "--forward", "right", "--json")
    assert velocity(flown, tmp_path, *given, "--rates", flown / "rates.csv") == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["mavlink"], summary["exported"], summary["exported_blind"]) == (f"ardupilot:{log}", 5, 0)
    for message in messages(log, "OPTICAL_FLOW"):
        assert message.flow_comp_m_x == pytest.approx(0.2, abs=0.004)
        # The camera's y is the vehicle's: nose up adds to forward.
        assert message.flow_rate_y == pytest.approx(0.5 + 0.05, abs=0.01)
        assert message.ground_distance == pytest.approx(0.4)


def test_a_mounting_says_what_points_forward(flown, tmp_path, capsys):
    log = tmp_path / "flow.tlog"
    assert velocity(flown, tmp_path, "--height", 0.4, "--mount", "x-back", "--mavlink", f"ardupilot:{log}") == 0
    assert messages(log, "OPTICAL_FLOW")[2].flow_comp_m_x < -0.15
    capsys.readouterr()
    more = ("--mount", "x-back", "--forward", "top", "--mavlink", f"px4:{tmp_path / 'other.tlog'}")
    assert velocity(flown, tmp_path, "--height", 0.4, *more) == 1
    assert "--forward: got it beside --mount" in capsys.readouterr().err


def test_the_tables_do_not_depend_on_where_velocities_are_sent(flown, tmp_path, capsys):
    assert velocity(flown, tmp_path, "--height", 0.4) == 0
    before = (tmp_path / "out" / "velocity.csv").read_bytes()
    assert velocity(flown, tmp_path, "--height", 0.4, "--mavlink", f"px4:{tmp_path / 'a.tlog'}") == 0
    assert (tmp_path / "out" / "velocity.csv").read_bytes() == before
    capsys.readouterr()


def test_nothing_is_written_over_without_being_asked_for(flown, tmp_path, capsys):
    log, bag = tmp_path / "flow.tlog", tmp_path / "bag"
    both = ("--height", 0.4, "--mavlink", f"px4:{log}", "--ros2-bag", bag)
    assert velocity(flown, tmp_path, *both) == 0
    first = log.read_bytes()
    capsys.readouterr()
    for target in (both[:4], (*both[:2], *both[4:])):
        assert velocity(flown, tmp_path, *target) == 1
        assert "--overwrite" in capsys.readouterr().err
    assert log.read_bytes() == first
    assert velocity(flown, tmp_path, *both, "--overwrite") == 0
    assert log.read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "flow.tlog", "out"]


def test_what_fails_leaves_neither_log_nor_bag(flown, tmp_path, capsys):
    (tmp_path / "one").mkdir()
    cv2.imwrite(str(tmp_path / "one" / "0.png"), np.zeros((144, 176), np.uint8))
    command = ["velocity", f"{tmp_path}/one/*.png", "--rate", "20", "--camera", f"{flown}/cam.json", "--height", "1"]
    command += ["-o", f"{tmp_path}/out", "--mavlink", f"px4:{tmp_path}/a.tlog", "--ros2-bag", f"{tmp_path}/bag"]
    assert cli.main(command) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) in (["one"], ["one", "out"])
    capsys.readouterr()


def test_an_interrupted_run_keeps_what_was_sent(flown, tmp_path, capsys, monkeypatch):
    from rsflow.velocity import VelocityEstimator

    real, calls = VelocityEstimator.update, []

    def update(self, *args, **named):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return real(self, *args, **named)

    monkeypatch.setattr(VelocityEstimator, "update", update)
    assert velocity(flown, tmp_path, "--height", 0.4, "--mavlink", f"px4:{tmp_path / 'a.tlog'}") == 130
    assert len(messages(tmp_path / "a.tlog", "OPTICAL_FLOW_RAD")) == 2
    capsys.readouterr()


def test_a_filtered_table_beside_the_measured_one(flown, tmp_path, capsys):
    """Rates in a log: the heading follows them. Without --filter there is no such table."""
    import csv

    given = ("--height", 0.4, "--height-std", 0.004, "--rates", flown / "rates.csv", "--rate-std", 0.001)
    assert velocity(flown, tmp_path, *given, "--filter", 0.1, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    with Path(summary["filtered"]).open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["waiting"] + ["ok"] * 5
    last = {name: float(value) for name, value in rows[-1].items() if name not in ("status", "std_without")}
    assert last["vx_m_s"] == pytest.approx(0.2, abs=0.004)
    assert last["x_m"] == pytest.approx(0.2 * 5 / 20, abs=0.001)
    # One per cent of height is one per cent of the way.
    assert last["x_std_m"] > 0.0099 * last["x_m"]
    assert (tmp_path / "out" / "velocity.csv").is_file()
    assert velocity(flown, tmp_path / "c", *given, "--json") == 0
    assert "filtered" not in json.loads(capsys.readouterr().out)
    assert velocity(flown, tmp_path / "b", *given, "--filter", "-1") == 1
    assert "--filter: got -1" in capsys.readouterr().err


def test_live_sends_each_frame(flown, tmp_path, capsys):
    log = tmp_path / "live.tlog"
    # Pictures have no times: a video has.
    from rsflow import VideoWriter

    with VideoWriter(tmp_path / "clip.mp4", frame_rate=20) as video:
        for path in sorted(Path(flown).glob("*.png")):
            video.write(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    command = ["live", f"{tmp_path}/clip.mp4", "--camera", f"{flown}/cam.json", "--height", "0.4"]
    assert cli.main([*command, "--mavlink", f"px4:{log}", "--frames", "4"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 5
    found = messages(log, "OPTICAL_FLOW_RAD")
    assert len(found) == 4
    # Without a gyro the turn is in the flow all the same.
    assert flow_of(found[1])[0] == pytest.approx(-0.55, abs=0.03)
    assert np.isnan(found[1].integrated_xgyro)
    assert cli.main([*command, "--mavlink", f"px4:{log}"]) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert cli.main(["live", f"{tmp_path}/clip.mp4", "--mavlink", "px4:a.tlog"]) == 1
    assert "expected a camera and a height with it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--mavlink", "px4:flow.txt"), "--mavlink: got"),
        (("--forward", "left"), "--forward: got it alone"),
        (("--mavlink", "px4:/dev/no-such-port,57600"), "cannot open /dev/no-such-port"),
    ],
)
def test_what_is_wrong_is_said_before_the_work(flown, tmp_path, capsys, more, told):
    assert velocity(flown, tmp_path, "--height", 0.4, *more) == 1
    err = capsys.readouterr().err
    assert told in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out" / "velocity.csv").exists()
