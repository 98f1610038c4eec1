"""The sum of the way over what could not be measured: no step is taken as zero, and the deviation covers the truth."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest

import rsflow
from rsflow import Velocity, VelocityStatus, synthetic
from rsflow.extraction.answers import answers
from rsflow.extraction.gaps import MEASURED, NEIGHBOURS, SECOND, UNKNOWN, fill
from rsflow.extraction.trajectory import Trajectory


def made_steps(rng: np.random.Generator, count: int) -> np.ndarray:
    """Steps of a camera: a drift, slow waves and trembling, of any size."""
    k = np.arange(count)[:, None]
    period, phase = rng.uniform(25, 120, 2), rng.uniform(0, 2 * math.pi, 2)
    wave = rng.uniform(0, 3, 2) * np.sin(2 * math.pi * k / period + phase)
    return rng.normal(0, 2, 2) + wave + rng.normal(0, rng.uniform(0.01, 0.4), (count, 2))


def gaps(rng: np.random.Generator, count: int) -> np.ndarray:
    missing = np.zeros(count, bool)
    for _ in range(rng.integers(1, 6)):
        first = rng.integers(0, count)
        missing[first : first + rng.integers(1, 16)] = True
    return missing


@pytest.mark.parametrize("seconds", [False, True])
def test_the_deviation_of_the_sum_covers_the_truth(seconds):
    rng = np.random.default_rng(5)
    off, plain, said = [], [], []
    for _ in range(150):
        true = made_steps(rng, 120)
        missing = gaps(rng, 120)
        steps = np.where(missing[:, None], np.nan, true + rng.normal(0, 0.01, true.shape))
        second = check = None
        if seconds:
            second = true + rng.normal(0, 0.1, true.shape) + rng.normal(0, 0.05, 2)
            # On some frames the other estimate follows something else too.
            second[rng.random(120) < 0.2] = np.nan
            check = true + rng.normal(0, 0.2, true.shape)
        way = fill(steps, np.full_like(steps, 1e-4), np.full(120, 0.04), second, check)
        assert np.isfinite(way.steps).all()
        error = way.sums[-1] - true.sum(axis=0)
        carried = np.hypot(*true.T).mean() * max(way.count(NEIGHBOURS) + way.count(SECOND), 1)
        said.append(np.sqrt(way.variance[-1]).max() / max(carried, 1.0))
        off.extend(np.abs(error) / np.sqrt(way.variance[-1]))
        plain.extend(np.abs(np.nansum(steps, axis=0) - true.sum(axis=0)) / np.maximum(np.abs(error), 1e-3))
        assert (np.diff(way.variance, axis=0) > -1e-9).mean() > 0.5
    off = np.array(off)
    assert np.mean(off < 1) > 0.68, np.mean(off < 1)
    assert np.mean(off < 2) > 0.95, np.mean(off < 2)
    # Nothing is gained by saying too much: a few times the motion that may have gone on unseen.
    assert np.median(said) < 4, np.median(said)
    assert np.median(plain) > 3, np.median(plain)


@pytest.mark.parametrize("unseen", [5.0, 0.0, -4.0])
@pytest.mark.parametrize("beside", [1.0, 0.0])
def test_a_sum_over_what_nobody_saw_is_no_sure_one(unseen, beside):
    true = np.zeros((23, 2))
    true[:, 0] = beside
    true[8:14, 0] = unseen if beside else unseen / 5
    steps = true.copy()
    steps[8:14] = np.nan
    way = fill(steps, np.full_like(steps, 1e-12), np.full(23, 0.04))
    error = np.abs(way.sums[-1] - true.sum(axis=0))
    assert (error <= 2 * np.sqrt(way.variance[-1])).all(), (error, np.sqrt(way.variance[-1]))
    track = Trajectory()
    track.add(velocity(0.0, None), 0)
    for k, step in enumerate(steps, 1):
        v = (float(step[0]) / 1000 + 1e-9, 0.0)
        row = track.add(velocity(0.1 * k, None if 9 <= k < 15 else v), k)
    assert row["x_std_m"] == pytest.approx(track.figures()["distance_std_m"], rel=0.2)
    if beside:
        assert abs(row["x_m"] - true[:, 0].sum() * 1e-4) <= 2 * row["x_std_m"]
        assert abs(track.figures()["distance_m"] - np.abs(true[:, 0]).sum() * 1e-4) <= 2 * row["x_std_m"]


def test_where_nothing_is_known_nothing_is_said():
    steps = np.full((6, 2), np.nan)
    way = fill(steps, steps, np.ones(6))
    assert (way.source == UNKNOWN).all()
    assert np.isinf(way.variance).all()
    # Two steps say nothing about how a gap goes on.
    steps[:2] = 1.0
    way = fill(steps, np.full_like(steps, 0.01), np.ones(6))
    assert way.source.tolist() == [MEASURED] * 2 + [NEIGHBOURS] * 4
    assert np.isfinite(way.variance[1]).all()
    assert np.isinf(way.variance[2:]).all()
    # A second estimate alone does, with what it differs by from the third.
    second = np.full((6, 2), 1.0)
    way = fill(steps, np.full_like(steps, 0.01), np.ones(6), second, second + np.array([0.4, 0.0]))
    assert way.source.tolist() == [MEASURED] * 2 + [SECOND] * 4
    assert np.sqrt(way.variance[-1, 0]) > 4 * 0.2
    np.testing.assert_allclose(way.sums[-1], 6.0)


def velocity(t_s: float, v: tuple[float, float] | None) -> Velocity:
    if v is None:
        status = VelocityStatus.TOO_FEW_POINTS if t_s > 0 else VelocityStatus.FIRST_FRAME
        return Velocity(t_s, 0.1, *[math.nan] * 3, np.diag([math.inf] * 3), status, 0, math.nan, math.nan)
    part = np.diag([1e-6, 1e-6, 1e-6])
    return Velocity(t_s, 0.1, *v, 0.0, part, VelocityStatus.OK, 50, 1.0, 0.0, parts={"displacement": part})


def test_a_path_goes_on_over_a_gap_and_its_deviation_covers_the_truth():
    rng = np.random.default_rng(8)
    off, places = [], []
    for _ in range(150):
        true = 0.05 * made_steps(rng, 80)
        missing = gaps(rng, 80)
        missing[40:44] = False
        track = Trajectory()
        track.add(velocity(0.0, None), 0)
        for k, (v, lost) in enumerate(zip(true, missing, strict=True), 1):
            row = track.add(velocity(0.1 * k, None if lost else (float(v[0]), float(v[1]))), k)
        figures = track.figures()
        assert figures["distance_unmeasured"] == missing.sum()
        assert figures["distance_unmeasured_s"] == pytest.approx(0.1 * missing.sum())
        way = 0.1 * np.hypot(*true.T).sum()
        off.append(abs(figures["distance_m"] - way) / figures["distance_std_m"])
        if not missing[-1]:
            end = 0.1 * true.sum(axis=0)
            places += [abs(row["x_m"] - end[0]) / row["x_std_m"], abs(row["y_m"] - end[1]) / row["y_std_m"]]
    for share in (np.array(off), np.array(places)):
        assert np.mean(share < 1) > 0.68, np.mean(share < 1)
        assert np.mean(share < 2) > 0.95, np.mean(share < 2)


def test_a_path_without_enough_to_judge_a_gap_by_has_no_length():
    track = Trajectory()
    for k, v in enumerate([None, (0.1, 0.0), None, (0.1, 0.0)]):
        row = track.add(velocity(0.1 * k, v), k)
    assert math.isinf(row["distance_std_m"])
    figures = track.figures()
    assert math.isnan(figures["distance_m"])
    assert figures["distance_measured_m"] == pytest.approx(0.02)


def covered(images: list[np.ndarray], frames: range) -> list[np.ndarray]:
    """Hide the picture in some frames: nothing can be measured to and from them."""
    rng = np.random.default_rng(3)
    return [
        rng.normal(60, 2, image.shape).round().astype(np.uint8) if index in frames else image
        for index, image in enumerate(images)
    ]


def test_the_report_adds_up_the_way_over_pairs_that_failed_and_says_so(tmp_path):
    flight = synthetic.flight(frames=24, height_m=0.2, velocity_m_s=(0.05, 0.03, 0.0), seed=6)
    exact = flight.camera.scaled(*flight.camera.size)
    images = covered(list(flight.images), range(10, 14))
    out = rsflow.extract(
        images, tmp_path, frame_rate=30, camera=exact, height_m=0.2, height_std_m=0.0, camera_motion="moving",
        videos=False,
    )  # fmt: skip
    summary = out.summary
    missing = summary["displacement_unmeasured"]
    assert missing == 5
    assert summary["displacement_from_dense_flow"] + summary["displacement_from_neighbours"] == missing
    with out.files["motion"].open() as file:
        steps = [float(row["dx_px"]) for row in csv.DictReader(file)][1:]
    step = np.nanmedian(steps)
    assert summary["displacement_sum_measured_px"][0] == pytest.approx(step * (23 - missing), rel=0.02)
    error = abs(summary["displacement_sum_px"][0] - step * 23)
    assert error < max(2 * summary["displacement_sum_std_px"][0], 0.2)
    of_the_picture = answers({name: value for name, value in summary.items() if name != "velocity_measured"})[1].line()
    assert "Where it was measured the picture went " in of_the_picture
    assert "5 of 23 pairs (0.17 s) could not be measured: in sum about" in of_the_picture
    true = float(np.hypot(0.05, 0.03) * 23 / 30)
    assert summary["distance_m"] == pytest.approx(true, rel=0.02)
    assert summary["distance_measured_m"] < 0.85 * true
    assert abs(summary["distance_m"] - true) < 3 * summary["distance_std_m"]
    assert "for 5 frames (0.17 s) without a velocity nothing was: about" in summary["text"]
    assert "if the motion went on as beside" in summary["text"]
    page = out.files["report"].read_text()
    assert "way travelled where it was measured; 5 frames (0.17 s) were not" in page
    assert "as if nothing had moved" not in page


def test_a_sum_that_is_not_known_is_not_given(tmp_path):
    a = synthetic.shifted_pair(2.0, 0.0, size=(96, 72), seed=1)
    out = rsflow.extract(covered([a.prev, a.next, a.prev], range(2, 3)), tmp_path, frame_rate=10, videos=False)
    assert out.summary["displacement_sum_px"] == [None, None]
    assert "How far the picture went in sum is not known, since 1 of 2 pairs" in out.summary["text"]
    assert out.summary["displacement_sum_measured_px"][0] == pytest.approx(2.0, abs=0.05)


def test_a_sum_of_nothing_has_no_others(tmp_path):
    out = rsflow.extract(np.full((3, 72, 96), 90, np.uint8), tmp_path, frame_rate=10, videos=False)
    assert "since 2 of 2 pairs (0.20 s) could not be measured. " in out.summary["text"]
