"""`rsflow bench velocity`: its conditions are what they say, its scores right, and what fools an estimator shows."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import bench, cli
from rsflow.bench import VELOCITY_MARKS, ConditionRow, VelocityBench, measure_velocity
from rsflow.bench.velocity_conditions import Condition, conditions
from rsflow.bench.velocity_latency import WHOLE, stages
from rsflow.bench.velocity_run import scored

EVERY = conditions()


@pytest.fixture(scope="module")
def found() -> VelocityBench:
    before = rsflow.get_num_threads(), cv2.getNumThreads()
    result = measure_velocity(
        only=["level flight", "own vehicle on 30 %", "fixed shadow", "weak ground"], rounds=3, quick=True
    )
    assert (rsflow.get_num_threads(), cv2.getNumThreads()) == before
    return result


def _row(found: VelocityBench, name: str) -> ConditionRow:
    (row,) = [row for row in found.conditions if row.condition == name]
    return row


def test_what_is_easy_is_measured_and_believed(found: VelocityBench) -> None:
    for name in ("level flight", "own vehicle on 30 %", "fixed shadow"):
        row = _row(found, name)
        assert row.valid == 1.0
        assert row.false == 0.0
        assert row.rms_percent < 0.3
        assert abs(row.bias_percent) <= row.rms_percent
        assert row.within_2 > 0.5
        assert row.frames == 9


def test_what_shows_nothing_is_not_measured(found: VelocityBench) -> None:
    row = _row(found, "weak ground")
    assert row.false == 0.0
    assert row.valid < 0.3


def test_both_chains_are_timed_by_stage_and_measure_the_flight(found: VelocityBench) -> None:
    for size in ((64, 64), (320, 240), (640, 480)):
        rows = [row for row in found.latencies if row.size == size]
        for method in ("rsflow", "OpenCV"):
            (whole,) = [row for row in rows if row.method == method and row.stage == WHOLE]
            steps = [row for row in rows if row.method == method and row.stage != WHOLE]
            assert len(steps) >= 2
            assert all(0 < step.time_ms < 2 * whole.time_ms for step in steps)
            assert all(math.isnan(step.rms_percent) for step in steps)
            # A wrong sign, axis or scale of either chain would be far above; 64 x 64 pixels are few.
            assert whole.rms_percent < (6.0 if size == (64, 64) else 1.5)


def test_clocks_are_taken_off_again() -> None:
    estimator = rsflow.VelocityEstimator(rsflow.Camera(60.0, 60.0, 31.5, 31.5, width=64, height=64))
    before = {stage: getattr(owner, name) for stage, (owner, name) in stages(estimator).items()}
    measure_velocity(only=[], rounds=1, quick=True)
    assert {stage: getattr(owner, name) for stage, (owner, name) in stages(estimator).items()} == before


def test_scores_of_errors_that_are_known() -> None:
    """Errors drawn from their covariance: 68 and 95 % within, nothing false; a bias along the way is found."""
    rng = np.random.default_rng(2)
    n = 4000
    truth = np.tile([0.6, 0.8], (n, 1))
    root = np.array([[0.01, 0.0], [0.004, 0.02]])
    error = rng.standard_normal((n, 2)) @ root.T + 0.005 * truth
    row = scored("made", n + 1000, 1.0, error, np.tile(root @ root.T, (n, 1, 1)), truth)
    assert row.valid == pytest.approx(0.8)
    assert row.within_1 == pytest.approx(0.6827, abs=0.04)
    assert row.within_2 == pytest.approx(0.9545, abs=0.02)
    assert row.bias_percent == pytest.approx(0.5, abs=4 * 100 * 0.02 / math.sqrt(n))
    assert row.rms_percent == pytest.approx(100 * math.sqrt(np.trace(root @ root.T) + 0.005**2), rel=0.05)
    assert row.false == 0.0


def test_false_is_off_by_deviations_and_by_percent() -> None:
    truth = np.tile([1.0, 0.0], (4, 1))
    error = np.array([[0.03, 0.0], [0.03, 0.0], [0.015, 0.0], [0.03, 0.0]])
    std = np.array([0.001, 0.01, 0.001, np.inf])  # 30 deviations, 3, 15 but 1.5 %, infinitely uncertain
    covariances = [np.diag([s**2, s**2]) for s in std]
    row = scored("made", 8, 1.0, error, covariances, truth)
    assert row.false == 1 / 8
    nothing = scored("made", 8, 1.0, [], [], [])
    assert (nothing.valid, nothing.false) == (0.0, 0.0)
    assert math.isnan(nothing.rms_percent)


@pytest.mark.parametrize("condition", EVERY, ids=[condition.name for condition in EVERY])
def test_conditions_fly_and_tell_each_frame(condition: Condition) -> None:
    flown = condition.fly(1, 9)
    told = condition.tell(flown, 1)
    assert len(told.t_s) == len(told.rows) == len(flown) >= 3
    known = {"height_m", "range_m", "rate_rad_s", "down"}
    assert all(set(row) <= known for row in told.rows)
    assert flown.images.dtype == np.uint8
    speed = np.linalg.norm(flown.velocity_m_s[1:], axis=1)
    assert (speed > 0.05).all() or "from 0" in condition.name
    assert np.isfinite(flown.height_m).all()


def test_a_flight_that_rocks_goes_straight_on() -> None:
    (condition,) = [condition for condition in EVERY if condition.name == "tilt to 24 deg at 3 rad/s, down"]
    flown = condition.fly(0, 60)
    way = np.diff(flown.position_m, axis=0)
    np.testing.assert_allclose(way, np.tile(way.mean(axis=0), (59, 1)), atol=1e-4)
    assert np.rad2deg(np.arccos(flown.down[:, 2])).max() == pytest.approx(27, abs=2)
    assert np.abs(flown.rate_rad_s[1:]).max() == pytest.approx(3.0, rel=0.05)
    assert np.ptp(flown.height_m) < 2e-3


def test_tables_are_markdown(found: VelocityBench) -> None:
    accuracy, latency, ground = found.tables().split("\n\n")
    assert {(line.count("|"), line[0], line[-1]) for line in accuracy.splitlines()} == {(8, "|", "|")}
    assert {(line.count("|"), line[0], line[-1]) for line in latency.splitlines()} == {(7, "|", "|")}
    assert "1 thread, 1 flight a condition" in ground
    assert f"| {'weak ground':{len('own vehicle on 30 %')}} |" in accuracy


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"flights": 0}, "flights: got 0, expected an integer from 1"),
        ({"rounds": -1}, "rounds: got -1, expected an integer from 0"),
        ({"only": "level"}, 'only: got "level", expected a sequence of names'),
        ({"only": ["no such"]}, 'only: got "no such", expected the beginning of one of: level flight; '),
    ],
)
def test_misuse_says_what_was_got(options: dict[str, object], message: str) -> None:
    with pytest.raises(rsflow.OptionError, match=message):
        measure_velocity(**options)  # type: ignore[arg-type]


def test_command_prints_the_table_and_rewrites_a_page(
    found: VelocityBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[dict[str, object]] = []
    monkeypatch.setattr(bench, "measure_velocity", lambda **options: asked.append(options) or found)
    page = tmp_path / "page.md"
    page.write_text("\n".join(("Before.", *VELOCITY_MARKS, "After.", "")), encoding="utf-8")
    assert cli.main(["bench", "velocity", "--only", "level", "--flights", "2", "--update", str(page)]) == 0
    assert found.tables() in capsys.readouterr().out
    first, last = VELOCITY_MARKS
    assert page.read_text(encoding="utf-8") == f"Before.\n{first}\n\n{found.tables()}\n\n{last}\nAfter.\n"
    assert (asked[0]["only"], asked[0]["flights"], asked[0]["rounds"]) == (["level"], 2, 0)
    assert cli.main(["bench", "velocity", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["conditions"][0]["condition"] == "level flight"
    assert figures["latencies"][1]["rms_percent"] is None
    assert (asked[1]["only"], asked[1]["rounds"]) == (None, 60)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["bench", "--flights", "2"], "--flights: got 2, expected it with rsflow bench velocity alone"),
        (["bench", "--only", "level"], "--only: got "),
        (["bench", "velocity", "--threads", "2"], "--threads: got 2, expected 1"),
        (["bench", "velocity", "--only", "x"], 'only: got "x"'),
    ],
)
def test_command_refuses(line: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(line) == 1
    assert message in capsys.readouterr().err
