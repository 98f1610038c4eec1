"""The mean of a logged rate is the exact integral; the deviation of a height between two rows is what it is off by."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsflow.velocity import Heights, Rates

# Numbers that floats and fractions have alike, so that the sum of fractions is exact.
EIGHTHS = st.integers(-80, 80).map(lambda k: Fraction(k, 8))
STEPS = st.integers(1, 4).map(lambda k: Fraction(k, 16))


def integral(t: list[Fraction], values: list[Fraction], begin: Fraction, end: Fraction) -> Fraction:
    """Of straight lines between (t, values), exactly."""
    total = Fraction(0)
    for k in range(len(t) - 1):
        a, b = max(t[k], begin), min(t[k + 1], end)
        if a < b:
            slope = (values[k + 1] - values[k]) / (t[k + 1] - t[k])
            middle = values[k] + slope * ((a + b) / 2 - t[k])
            total += middle * (b - a)
    return total


@given(
    steps=st.lists(STEPS, min_size=1, max_size=12),
    data=st.data(),
    delay=st.integers(-8, 8).map(lambda k: Fraction(k, 32)),
)
def test_the_mean_is_the_exact_integral(steps: list[Fraction], data: st.DataObject, delay: Fraction) -> None:
    t = [sum(steps[:k], Fraction(0)) for k in range(len(steps) + 1)]
    values = data.draw(st.lists(EIGHTHS, min_size=len(t), max_size=len(t)))
    # A share of the log, so that many intervals end on a row and many between two.
    first, last = sorted(data.draw(st.lists(st.integers(0, 48), min_size=2, max_size=2, unique=True)))
    begin, end = (t[-1] * Fraction(share, 48) for share in (first, last))
    rates = Rates(np.array(t, float), np.stack([np.array(values, float) * k for k in (1.0, -2.0, 0.5)], axis=1))
    found = rates.mean(float(begin - delay), float(end - delay), delay_s=float(delay))
    usual = float(np.median(np.array(steps, float)))
    gone_over = [float(step) for k, step in enumerate(steps) if t[k] < end and t[k + 1] > begin]
    if max(gone_over) > 4 * usual:
        assert np.isnan(found).all()
        return
    exact = float(integral(t, values, begin, end) / (end - begin))
    assert found == pytest.approx([exact, -2.0 * exact, 0.5 * exact], abs=1e-9)


def test_the_mean_where_there_is_none() -> None:
    rates = Rates(np.arange(5.0), np.ones((5, 3)))
    for begin, end in ((1.0, 1.0), (2.0, 1.0), (np.nan, 1.0), (0.0, np.nan), (-1.0, 1.0), (3.0, 5.0)):
        assert np.isnan(rates.mean(begin, end)).all()
    # Clocks are rounded: a log that ends a moment before the frame.
    assert rates.mean(-0.005, 4.005) == pytest.approx(1.0)


def errors(
    noise_m: float, stated_m: float | None, heave_m: float, period_s: float, shared_m: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Errors at the frames of a range finder at 20 Hz, and their deviations; frames at 61 Hz, no row near them."""
    rng = np.random.default_rng(7)
    found = []
    for _ in range(12):
        rows = np.arange(0.0, 10.0, 0.05)
        phase = rng.uniform(0, 2 * np.pi)

        def true(t: np.ndarray, phase: float = phase) -> np.ndarray:
            return 2.0 + heave_m * np.sin(2 * np.pi * t / period_s + phase)

        common = rng.normal(0.0, shared_m)
        measured = true(rows) + rng.normal(0.0, noise_m, len(rows)) + common
        std = None if stated_m is None else np.full(len(rows), stated_m)
        heights = Heights("t_s", rows, measured, std, "range")
        t = np.arange(0.0, 9.9, 1 / 61)
        off = [heights.at(frame=0, t_s=float(s)) for s in t] - true(t)
        found.append((off, np.array([heights.std_at(frame=0, t_s=float(s)) for s in t])))
    return np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])


@pytest.mark.parametrize(
    ("noise", "stated", "heave", "period", "shared"),
    [
        (0.02, 0.02, 0.0, 1.0, 0.0),
        (0.02, 0.02, 0.3, 4.0, 0.0),
        (0.005, 0.005, 0.5, 1.0, 0.0),
        (0.02, 0.002, 0.2, 4.0, 0.0),
        (0.02, 0.0447, 0.0, 1.0, 0.04),
    ],
    ids=["level", "slow heave", "fast heave", "noise not declared", "part of it in common"],
)
def test_heights_between_rows_are_off_by_their_deviation(
    noise: float, stated: float, heave: float, period: float, shared: float
) -> None:
    off, std = errors(noise, stated, heave, period, shared)
    within = np.abs(off)[:, None] <= std[:, None] * (1.0, 2.0)
    one, two = 100 * within.mean(axis=0)
    if shared:
        # Twelve draws of what is in common: looser.
        assert 40 <= one <= 92
        assert two >= 85
    else:
        assert 60 <= one <= 78
        assert 90 <= two <= 99


def test_a_sine_without_noise_is_cut_off_by_straight_lines() -> None:
    """Exact rows: all that is wrong between them is the bend."""
    off, std = errors(0.0, 0.0, 0.5, 1.0)
    assert np.abs(off).max() > 0.004
    assert (np.abs(off) <= 2 * std + 1e-12).mean() > 0.95
    assert np.sqrt((off**2).mean()) == pytest.approx(np.sqrt((std**2).mean()), rel=0.15)


def test_more_scatter_than_stated_is_told() -> None:
    rng = np.random.default_rng(1)
    rows = np.arange(0.0, 5.0, 0.05)
    measured = 2.0 + rng.normal(0.0, 0.05, len(rows))
    (note,) = Heights("t_s", rows, measured, np.full(len(rows), 0.005)).notes
    assert "with a standard deviation of 0.005 m stated: the larger one counts" in note
    assert Heights("t_s", rows, measured, np.full(len(rows), 0.05)).notes == ()
    assert Heights("t_s", rows, measured).notes == ()


def test_without_a_stated_deviation_there_is_none() -> None:
    _, std = errors(0.02, None, 0.0, 1.0)
    assert np.isnan(std).all()


def test_a_table_by_hand_of_two_rows() -> None:
    heights = Heights("t_s", np.array([0.0, 10.0]), np.array([1.0, 2.0]), np.full(2, 0.1))
    assert heights.at(frame=0, t_s=2.5) == pytest.approx(1.25)
    # Nothing tells how much of it is noise of a row: all of it stays.
    assert heights.std_at(frame=0, t_s=5.0) == pytest.approx(0.1)
