"""The page on scale: its tables are what its script writes, and the simulation adds up."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "explanation"


@pytest.fixture(scope="module")
def figures():
    spec = importlib.util.spec_from_file_location("scale_figures", FOLDER / "scale_figures.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["scale_figures"] = module
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_those_of_the_script(figures):
    page = figures.PAGE.read_text()
    assert figures.written(page) == page, "run docs/explanation/scale_figures.py"


def test_equal_workers_that_never_fail_lose_nothing(figures):
    calm = figures.Fleet(workers=10, slow_share=0.0, spread=0.0, mean_hours_to_failure=np.inf)
    # A hundred equal videos, ten at a time.
    found = figures.simulate(np.full(100, 600.0), 50.0, None, calm)
    assert found.steps == 100
    assert found.failures == 0
    assert found.hours == pytest.approx(found.ideal_hours) == pytest.approx(100 * 600 * 30 * 0.05 / 10 / 3600)
    # Cut, each has its overlaps too: two seconds before all parts but the first.
    cut = figures.simulate(np.full(100, 600.0), 50.0, 100.0, calm)
    assert cut.steps == 600
    assert cut.extra_share == pytest.approx(5 * 2 / 600)
    # One video alone is as long as its longest part.
    alone = figures.simulate(np.array([950.0]), 50.0, 100.0, calm)
    assert alone.hours == pytest.approx((950 - 8 * 100 + 2) * 30 * 0.05 / 3600)


def test_work_that_is_lost_is_done_again(figures):
    frail = figures.Fleet(workers=5, slow_share=0.0, spread=0.0, mean_hours_to_failure=2.0, away_s=60.0)
    short, long = (figures.simulate(np.full(40, 3600.0), 50.0, part_s, frail) for part_s in (300.0, None))
    assert short.failures > 3
    assert long.lost_share > 2 * short.lost_share > 0
    # What is done, what is lost and where workers are away is all of the time.
    calm = figures.Fleet(workers=5, slow_share=0.0, spread=0.0, mean_hours_to_failure=np.inf)
    work = figures.simulate(np.full(40, 3600.0), 50.0, 300.0, calm).hours
    busy = short.hours * (1 - short.lost_share) - short.failures * 60.0 / 3600.0 / 5
    assert busy == pytest.approx(work, rel=0.03)


def test_stragglers_cost_what_their_last_step_takes(figures):
    one_slow = figures.Fleet(workers=2, slow_share=0.5, spread=0.0, slowness=10.0, mean_hours_to_failure=np.inf)
    found = figures.simulate(np.full(2, 1000.0), 50.0, None, one_slow)
    assert found.hours == pytest.approx(10 * 1000 * 30 * 0.05 / 3600)
    assert found.ideal_hours == pytest.approx(2 * 1000 * 30 * 0.05 / 1.1 / 3600)
