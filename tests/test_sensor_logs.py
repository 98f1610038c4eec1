"""Logs of range finders, gyros and attitudes: their columns, units, holes and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow.velocity import Attitudes, Heights, Rates

KINDS = (
    (Heights, "t_s,height_m", "0.5"),
    (Rates, "t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s", "1,2,3"),
    (Attitudes, "t_s,down_x,down_y,down_z", "0,0,1"),
)
kinds = pytest.mark.parametrize(("kind", "header", "row"), KINDS, ids=lambda item: getattr(item, "__name__", ""))


def written(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


def times_of(log: Heights | Rates | Attitudes) -> list[float]:
    return (log.keys if isinstance(log, Heights) else log.t_s).tolist()


@kinds
@pytest.mark.parametrize(("name", "step"), [("t_s", "0.5"), ("t_ms", "500"), ("t_us", "5e5"), ("t_ns", "500000000")])
def test_each_unit_of_time(
    tmp_path: Path, kind: type[Heights | Rates | Attitudes], header: str, row: str, name: str, step: str
) -> None:
    text = f"{header.replace('t_s', name)}\n0,{row}\n{step},{row}\n"
    assert times_of(kind.read(written(tmp_path, text))) == [0.0, 0.5]


@kinds
@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("", "no row after the header, expected"),
        ("0,{row}\n0,{row}\n", "row 3: t_s: got 0 after 0, expected strictly increasing times"),
        ("0,{row}\nnan,{row}\n", "row 3: t_s: got nan, expected a finite time"),
        ("0,fast,1,1\n", "row 2: got |got 4 cells"),
        ("0,{row}\n1e9,{row}\n", "which are not seconds"),
    ],
)
def test_wrong_rows_are_named(
    tmp_path: Path, kind: type[Heights | Rates | Attitudes], header: str, row: str, rows: str, message: str
) -> None:
    path = written(tmp_path, f"{header}\n{rows.format(row=row)}")
    with pytest.raises(rsflow.FormatError, match=message) as error:
        kind.read(path)
    assert str(path) in str(error.value)


@kinds
def test_missing_columns_say_what_may_stand_there(
    tmp_path: Path, kind: type[Heights | Rates | Attitudes], header: str, row: str
) -> None:
    for text in (f"time,{header.split(',', 1)[1]}\n0,{row}\n", "t_s,x\n0,1\n", f"0,{row}\n"):
        with pytest.raises(rsflow.FormatError, match=r"expected .* and one of t_s, t_ms, t_us, t_ns.*PX4's or Ardu"):
            kind.read(written(tmp_path, text))


def test_rates_of_px4_and_ardupilot(tmp_path: Path) -> None:
    path = written(
        tmp_path, "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2]\n1000000,0.1,0.2,0.3\n1004000,0.1,0.2,0.3\n"
    )
    rates = Rates.read(path)
    assert rates.origin == "PX4"
    assert rates.t_s.tolist() == [1.0, 1.004]
    assert rates.mean(1.0, 1.004).tolist() == pytest.approx([0.1, 0.2, 0.3])
    # A mean over 4 ms that ends at its time is the rate of 2 ms before.
    text = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt\n1000000,0,0,0,4000\n1004000,0,0,0,4000\n"
    assert Rates.read(written(tmp_path, text)).t_s == pytest.approx([0.998, 1.002])
    text = "timestamp,timestamp_sample,xyz[0],xyz[1],xyz[2]\n1000900,1000000,1,2,3\n1005100,1004000,1,2,3\n"
    assert Rates.read(written(tmp_path, text)).t_s == pytest.approx([1.0, 1.004])
    # Messages without the time of the sample.
    text = "timestamp,timestamp_sample,xyz[0],xyz[1],xyz[2]\n1000900,0,1,2,3\n1005100,0,1,2,3\n"
    assert Rates.read(written(tmp_path, text)).t_s == pytest.approx([1.0009, 1.0051])
    rows = [f"1.7e9,{1000000 + 2500 * k},{k % 2},{k % 2},{0.5 if k % 2 else 0.1},0" for k in range(6)]
    rates = Rates.read(written(tmp_path, "\n".join(["timestamp,TimeUS,I,GyrX,GyrY,GyrZ", *rows]) + "\n"))
    assert rates.origin == "ArduPilot"
    assert rates.t_s == pytest.approx([1.0, 1.005, 1.01])
    assert rates.rate_rad_s[:, 1] == pytest.approx(0.1)
    assert "several sensors: I 0 was taken, not 1" in rates.notes[0]


def test_rates_in_degrees_are_asked_about(tmp_path: Path) -> None:
    path = written(tmp_path, "t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s\n0,0,0,0\n1,0,0,130\n")
    with pytest.raises(rsflow.FormatError, match=r"row 3: got \[0.0, 0.0, 130.0\].*are they degrees per second"):
        Rates.read(path)


def test_attitudes_in_all_columns_are_the_same_direction(tmp_path: Path) -> None:
    """Pitch 20 degrees, then roll -10 about the body's own axis, and any yaw: aerospace angles of a body in FRD."""
    roll, pitch, yaw = np.radians([-10.0, 20.0, 70.0])

    def turn(axis: int, angle: float) -> np.ndarray:
        i, k = [(1, 2), (2, 0), (0, 1)][axis]
        R = np.eye(3)
        R[i, i] = R[k, k] = np.cos(angle)
        R[i, k], R[k, i] = -np.sin(angle), np.sin(angle)
        return R

    earth_from_body = turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
    down = earth_from_body.T @ (0.0, 0.0, 1.0)
    half = [np.array([np.cos(a / 2), *(np.sin(a / 2) * np.eye(3)[k])]) for k, a in enumerate((roll, pitch, yaw))]

    def times(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])

    w, x, y, z = times(times(half[2], half[1]), half[0])
    tables = {
        f"t_s,down_x,down_y,down_z\n0,{3 * down[0]},{3 * down[1]},{3 * down[2]}\n": "",
        f"t_s,qw,qx,qy,qz\n0,{w},{x},{y},{z}\n": "",
        f"t_s,roll_rad,pitch_rad\n0,{roll},{pitch}\n": "",
        f"timestamp,q[0],q[1],q[2],q[3]\n0,{w},{x},{y},{z}\n": "PX4",
        "timestamp,TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw\n1.7e9,0,0,-10,0,20,70\n": "ArduPilot",
    }
    for text, origin in tables.items():
        attitudes = Attitudes.read(written(tmp_path, text))
        assert attitudes.origin == origin
        assert attitudes.down(0.0) == pytest.approx(down, abs=1e-12)
    # Up is the third axis of ROS' earth; PX4's own columns do not ask.
    texts = list(tables)
    assert Attitudes.read(written(tmp_path, texts[1]), earth="enu").down(0.0) == pytest.approx(-down, abs=1e-12)
    assert Attitudes.read(written(tmp_path, texts[3]), earth="enu").down(0.0) == pytest.approx(down, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "t_s,roll_rad,pitch_rad\n0,0.1,0.2\n1,2,20\n",
            r"row 3: got \[2.0, 20.0\], expected .* in rad: are",
        ),
        ("t_s,qw,qx,qy,qz\n0,1,1,0,0\n", r"row 2: got \[1.0, 1.0, 0.0, 0.0\], expected a quaternion of length 1"),
    ],
)
def test_attitudes_that_cannot_be(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(rsflow.FormatError, match=message):
        Attitudes.read(written(tmp_path, text))


def test_directions_go_along_the_great_circle() -> None:
    angles = np.array([0.0, 0.8, 0.8])
    attitudes = Attitudes(np.array([0.0, 1.0, 2.0]), np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1))
    for t_s, angle in ((0.0, 0.0), (0.25, 0.2), (0.5, 0.4), (1.0, 0.8), (1.7, 0.8)):
        assert attitudes.down(t_s) == pytest.approx([np.sin(angle), 0.0, np.cos(angle)], abs=1e-12)
    # Between opposite directions there is none; nor of a row without one.
    assert np.isnan(Attitudes(np.array([0.0, 1.0]), np.array([[0.0, 0, 1], [0, 0, -1]])).down(0.5)).all()
    assert np.isnan(Attitudes(np.array([0.0]), np.zeros((1, 3))).down(0.0)).all()


def test_holes_are_unknown_and_told() -> None:
    t = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(2.0, 3.0, 0.1)])
    rates = Rates(t, np.ones((len(t), 3)))
    attitudes = Attitudes(t, np.tile([0.0, 0.0, 1.0], (len(t), 1)))
    heights = Heights("t_s", t, np.full(len(t), 2.0), np.full(len(t), 0.1))
    for t_s, known in ((0.45, True), (0.95, False), (1.5, False), (2.05, True), (-0.2, False), (3.2, False)):
        assert np.isfinite(attitudes.down(t_s)).all() == known
        assert np.isfinite(heights.at(frame=0, t_s=t_s)) == known
        assert np.isfinite(heights.std_at(frame=0, t_s=t_s)) == known
        assert np.isfinite(rates.mean(t_s, t_s + 0.02)).all() == known
    # An interval that touches the hole is not known; the rows at its ends are.
    assert np.isnan(rates.mean(0.8, 1.0)).all()
    assert np.isfinite(rates.mean(0.8, 0.9)).all()
    assert heights.at(frame=0, t_s=float(t[9])) == 2.0
    for log, what in ((rates, "rates"), (attitudes, "attitudes"), (heights, "heights")):
        (note,) = log.notes
        assert note.startswith(f"The {what} have a hole of 1.1 s from 0.9 s on, where 0.1 s from row to row are usual")


def test_three_lost_rows_are_no_hole_and_empty_cells_are_lost_rows(tmp_path: Path) -> None:
    t = np.delete(np.arange(0.0, 2.0, 0.1), [5, 6, 7])
    rates = Rates(t, np.stack([t, t, t], axis=1))
    assert rates.notes == ()
    assert rates.mean(0.4, 0.8) == pytest.approx(0.6)
    rows = [f"{k / 10},{'' if 5 <= k <= 8 else k}" for k in range(20)]
    heights = Heights.read(written(tmp_path, "\n".join(["t_s,range_m", "-0.1,0.1", *rows]).replace(",0\n", ",0.1\n")))
    assert heights.kind == "range"
    assert np.isnan(heights.at(frame=0, t_s=0.6))
    assert heights.at(frame=0, t_s=0.35) == pytest.approx(3.5)
    assert "a hole of 0.5 s from 0.4 s on" in heights.notes[0]


def test_ranges_without_an_echo(tmp_path: Path) -> None:
    heights = Heights.read(
        written(tmp_path, "t_s,range_m,range_std_m\n0,1,0.1\n1,0,\n2,-1,\n3,2,0.1\n4,2,\n5,2,0.2\n6,2,1\n")
    )
    assert np.array_equal(heights.height_m, [1, np.nan, np.nan, 2, 2, 2, 2], equal_nan=True)
    assert heights.notes[0].startswith("2 of 7 rows of ")
    assert "have no echo" in heights.notes[0]
    assert heights.std_at(frame=0, t_s=0.0) == pytest.approx(0.1)
    assert np.isnan(heights.std_at(frame=0, t_s=4.0))
    text = (
        "timestamp,min_distance,max_distance,current_distance,variance,signal_quality,orientation\n"
        + "".join(f"{50000 * k},0.1,8,{1 + k / 10},0.0004,90,25\n" for k in range(6))
        + "300000,0.1,8,9.5,0.0004,90,25\n350000,0.1,8,1.5,0.0004,0,25\n400000,0.1,8,0.05,0,-1,25\n"
        "450000,0.1,8,5,0,90,0\n"
    )
    heights = Heights.read(written(tmp_path, text))
    assert (heights.kind, heights.by) == ("range", "t_s")
    assert np.isfinite(heights.height_m).tolist() == [True] * 6 + [False] * 4
    assert heights.at(frame=0, t_s=0.1) == pytest.approx(1.2)
    assert heights.std_at(frame=0, t_s=0.1) == pytest.approx(0.02)
    text = "timestamp,TimeUS,Instance,Dist,Stat,Orient\n" + "".join(
        f"0,{50000 * k + 10 * i},{i},{1 + i},{4 if k else 2},25\n" for k in range(4) for i in range(2)
    )
    heights = Heights.read(written(tmp_path, text))
    assert np.array_equal(heights.height_m, [np.nan, 1, 1, 1], equal_nan=True)
    assert heights.std_m is None


def test_deviations_of_rows(tmp_path: Path) -> None:
    text = "frame,height_m,height_std_m\n0,1,0.1\n2,1,0\n3,0,0.2\n4,1,0.1\n"
    heights = Heights.read(written(tmp_path, text))
    assert [heights.std_at(frame=k, t_s=0.0) for k in (0, 2)] == [0.1, 0.0]
    assert all(np.isnan(heights.std_at(frame=k, t_s=0.0)) for k in (1, 3, 9))
    with pytest.raises(rsflow.FormatError, match=r"got a column height_std_m and 0\.3 m for all rows, expected one of"):
        Heights.read(tmp_path / "log.csv", std_m=0.3)
    with pytest.raises(rsflow.FormatError, match="row 2: height_std_m is -1, expected metres from 0 on"):
        Heights.read(written(tmp_path, "frame,height_m,height_std_m\n0,1,-1\n"))
    assert Heights.read(written(tmp_path, "frame,height_m\n0,1\n"), std_m=0.3).std_at(frame=0, t_s=0) == 0.3
    assert np.isnan(Heights.read(tmp_path / "log.csv").std_at(frame=0, t_s=0))


def test_a_drone_that_starts_from_the_ground(tmp_path: Path) -> None:
    rows = [f"{k / 10},{max(0, (k - 3) / 10)}" for k in range(20)]
    heights = Heights.read(written(tmp_path, "\n".join(["t_s,height_m", *rows])))
    assert np.isnan(heights.at(frame=0, t_s=0.2))
    assert "4 of 20 rows" in heights.notes[0]


@pytest.mark.parametrize("kind", [Rates, Attitudes])
def test_arrays_that_are_refused(kind: type[Rates | Attitudes]) -> None:
    three = np.ones((3, 3))
    for times, values, error, message in (
        ([0.0, 1.0, 1.0], three, rsflow.OptionError, "t_s: got 1 at 2, expected finite times, each later"),
        ([0.0, np.nan, 1.0], three, rsflow.OptionError, "t_s: got nan at 1"),
        ([], np.ones((0, 3)), rsflow.OptionError, "t_s: got no times"),
        ([0.0, 1.0], three, rsflow.ShapeError, r"expected \(2, 3\) numbers, a row for each of t_s"),
        ([0.0, 1.0, 2.0], np.ones((3, 3), complex), rsflow.DTypeError, "complex"),
    ):
        with pytest.raises(error, match=message):
            kind(np.array(times), values)
