"""CSV files of times and heights: what is accepted, and what each error says."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow.velocity import Heights

PICTURE = np.zeros((4, 6), np.uint8)


def times_of(path: Path, text: str | bytes, count: int = 3) -> list[float]:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return [frame.t_s for frame in rsflow.frames([PICTURE] * count, times=path)]


@pytest.mark.parametrize(
    "text",
    [
        "t_s\n0.5\n0.6\n0.9\n",
        "0.5\n0.6\n0.9",
        b"\xef\xbb\xbft_s\r\n0.5\r\n0.6\r\n0.9\r\n",
        "frame;t_s\n0;0.5\n1;0.6\n2;0.9\n",
        "frame\tt_s\n0\t0.5\n1\t0.6\n2\t0.9\n",
        "# made by hand\n\nframe,t_s\n# the first\n0,0.5\n\n1,0.6\n2,0.9\n",
        "t_ms\n500\n600\n900\n",
        "t_us\n500000\n600000\n900000\n",
        "t_ns\n500000000\n600000000\n900000000\n",
        "t_s,\n0.5,\n0.6,\n0.9,\n",
        'name,t_s\n"a, b",0.5\nb,0.6\nc,+9e-1\n',
    ],
)
def test_tables_that_are_accepted(tmp_path: Path, text: str | bytes) -> None:
    assert times_of(tmp_path / "t.csv", text) == [0.5, 0.6, 0.9]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s\n0,0\n1,5\n3,0\n", r"row 2: got 2 cells, '0,0', expected 1: decimals have a point, not a comma"),
        ("0,0\n1,5\n3,0\n", r"2 columns without names, '0, 0', .*decimals have a point"),
        ("t_s;x\n0,5;1\n0,6;1\n", r"row 2: got '0,5', expected a time in seconds: decimals have a point"),
        ('t_s\n"0,5"\n', r"row 2: got '0,5', expected a time in seconds: decimals have a point"),
        ("frame,t_s\n0,0,5\n", r"row 2: got 3 cells, '0,0,5', expected 2: decimals have a point"),
        (
            "t_s\n0\n33333333\n66666667\n",
            "t_s: got 3.33333e.07 s from one to the next, after number 1, which are not seconds .nano",
        ),
        ("t_ms\n0\n0.00001\n0.00002\n", "t_ms: got 1e-08 s from one to the next"),
        ("t_s\n0\n1\n2\n3\n", "got 4 times for the 3 frames"),
        ("t_s\n0\n1\n", "got 2 times for the 3 frames"),
        ("t_s\n0\nnan\n2\n", r"row 3: t_s: got nan, expected a finite time"),
        ("t_s\n0\n1\ninf\n", r"row 4: t_s: got inf, expected a finite time"),
        ("t_ms\n0\n\n5\n4\n", r"row 5: t_ms: got 4 after 5, expected strictly increasing"),
        ("# one\nt_s\n0\n1\n1\n", r"row 5: t_s: got 1 after 1, expected strictly increasing"),
        ("t_s\n1_0\n", "row 2: got '1_0', expected a time"),
        ("a;b\n1;2\n", "got the columns a, b, expected one that is called t_s or t_ms"),
        ("t_s,t_s\n1,2\n", "two columns that are called 't_s'"),
        ('t_s\n"1\n', "not a CSV file"),
        ("t_s\n" + "9" * 200_000 + "\n", "not a CSV file|expected a finite"),
        ("t_s\n", "got 0 times for the 3 frames"),
        (b"t_s\n\xff\n", "not a text file in UTF-8"),
        ("t_s\n0\n1\n2\n".encode("utf-16"), "not a text file in UTF-8"),
    ],
)
def test_tables_that_are_refused_say_why(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(rsflow.RsflowError, match=message):
        times_of(tmp_path / "t.csv", text)


def test_steps_of_hours_are_asked_about(tmp_path: Path) -> None:
    source = rsflow.frames([PICTURE] * 3, times=[0.0, 33333.0, 66667.0])
    assert "33333.5 s from one to the next: are they microseconds" in source.notes[0]
    source = rsflow.frames([PICTURE] * 4, times=[0.0, 33.3, 66.7, 100.0])
    assert "33.3 s from one to the next: are they microseconds or milliseconds" in source.notes[0]
    assert rsflow.frames([PICTURE] * 3, times=[0.0, 5.0, 9.0]).notes == ()


def test_one_step_that_is_wrong_is_not_hidden_by_the_others(tmp_path: Path) -> None:
    with pytest.raises(
        rsflow.FormatError, match=r"t_s: got 1e.09 s from one to the next, after number 2, which are not"
    ):
        times_of(tmp_path / "t.csv", "t_s\n0\n0.1\n0.2\n1e9\n", 4)
    with pytest.raises(rsflow.OptionError, match="times: got 1e-09 s from one to the next, after number 1, expected"):
        rsflow.frames([PICTURE] * 4, times=[0.0, 0.1, 0.100000001, 0.2])
    source = rsflow.frames([PICTURE] * 4, times=[0.0, 0.1, 60.1, 60.2])
    assert source.notes == (
        "times: 60 s from one to the next, after number 1, where 0.1 s are usual: a pause, or a wrong time?",
    )


@pytest.mark.parametrize("name", ["sigma", "std_m", "Height_StdDev", "range_std_m"])
def test_deviations_of_heights_are_not_dropped_in_silence(tmp_path: Path, name: str) -> None:
    path = tmp_path / "h.csv"
    path.write_text(f"t_s,height_m,{name}\n0,1,0.1\n1,1,0.1\n")
    with pytest.raises(rsflow.FormatError, match=f"got a column {name}, expected the deviations.*called height_std_m"):
        Heights.read(path)
    path.write_text("t_s,height_m,standard,erroneous\n0,1,0.1,0\n1,1,0.1,0\n")
    assert Heights.read(path).notes == ()


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, None, 2.0], "times: frame 1: got None, expected a finite number of seconds"),
        (["0.0", "1.0", "2.0"], 'times: frame 0: got "0.0", expected'),
        ([False, True, True], "times: frame 0: got False"),
        (np.array(["2020-01-01"] * 3, "datetime64[s]"), "times: got dtype datetime64"),
        (np.array([False, True, True]), "times: got dtype bool"),
        (np.zeros((3, 1)), r"times: got shape \(3, 1\)"),
        ([[0.0], [1.0], [2.0]], "times: got a list of lists or arrays"),
        ([0.0, 1.0, np.inf], "times: frame 2: got inf"),
        ([0.0, 1.0, 10**400], "times: frame 2: got an integer of"),
        (np.ma.masked_equal([0.0, 1.0, 2.0], 1.0), "a masked value for frame 1"),
        (5.0, "times: got 5.0"),
        (np.array([0.0, 1e9, 2e9]), "not seconds"),
        ([0.0, 1.0, 2.0, 3.0], "got 4 times for the 3 frames"),
    ],
)
def test_lists_of_times_that_are_refused_say_why(times: object, message: str) -> None:
    with pytest.raises(rsflow.RsflowError, match=message):
        rsflow.frames([PICTURE] * 3, times=times)  # type: ignore[arg-type]


def test_numbers_of_any_type_are_times() -> None:
    for times in ([0, Fraction(1, 2), 1], (0.0, np.float32(0.5), np.int64(1)), np.array([0, 0.5, 1], ">f8")):
        assert [frame.t_s for frame in rsflow.frames([PICTURE] * 3, times=times)] == [0.0, 0.5, 1.0]


def test_times_left_over_are_told_where_the_count_is_not_known_before() -> None:
    source = rsflow.frames(iter([PICTURE] * 3), times=[0.0, 1.0, 2.0, 3.0])
    for _ in range(3):
        next(source)
    with pytest.raises(rsflow.OptionError, match="got 4 times for the 3 frames of arrays"):
        next(source)
    assert len(list(rsflow.frames(iter([PICTURE] * 3), times=[0.0, 1.0, 2.0, 3.0], stop=3))) == 3


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([None], "item 0: t_s: got None, expected a finite number of seconds"),
        (["0.5"], 'item 0: t_s: got "0.5"'),
        ([0.0, True], "item 1: t_s: got True"),
        ([0.0, np.inf], "item 1: t_s: got inf"),
        ([0.0, 1.0, 1.0], "item 2: t_s: got 1.0 after 1.0"),
        ([0.0, np.nan, -1.0], "item 2: t_s: got -1.0 after 0.0"),
        ([0.0, 10**5000], "item 1: t_s: got an integer of"),
    ],
)
def test_times_in_pairs_are_checked(pairs: list[object], message: str) -> None:
    with pytest.raises(rsflow.RsflowError, match=message):
        list(rsflow.frames([(PICTURE, t_s) for t_s in pairs]))


def test_a_time_that_is_none_is_named_by_who_takes_it() -> None:
    frame = np.random.default_rng(0).integers(0, 255, (48, 64), np.uint8)
    camera = rsflow.Camera(60.0, 60.0, 31.5, 23.5, width=64, height=48)
    for t_s in (None, "0.5", True):
        with pytest.raises(rsflow.OptionError, match="t_s: got"):
            rsflow.VelocityEstimator(camera, height_m=1.0).update(frame, t_s)  # type: ignore[arg-type]
    with pytest.raises(rsflow.OptionError, match='t_s: got "1"'):
        rsflow.PointTracker().update(frame, t_s="1")  # type: ignore[arg-type]


def test_heights_are_read_by_the_same_rules(tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_bytes(b"\xef\xbb\xbf# laser\r\nt_ms;height_m\r\n0;0.2\r\n500;\r\n1000;0.4\r\n")
    heights = Heights.read(path)
    assert heights.by == "t_s"
    assert heights.keys.tolist() == [0.0, 0.5, 1.0]
    assert np.array_equal(heights.height_m, [0.2, np.nan, 0.4], equal_nan=True)
    for text, message in (
        ("t_s,height_m\n0,0,2\n", "row 2: got 3 cells, '0,0,2', expected 2: decimals have a point"),
        ("t_s;height_m\n0;0,2\n", "row 2: got '0,2', expected a number for height_m: decimals have a point"),
        ("0,0.2\n1,0.3\n", "the first line has no names of columns, expected height_m"),
        ("frame,height_m\n0.5,1\n", "frame is 0.5, expected whole numbers"),
        ("t_s,height_m\n0,1\n1e9,1\n2e9,1\n", "not seconds"),
    ):
        path.write_text(text)
        with pytest.raises(rsflow.FormatError, match=message):
            Heights.read(path)
