"""Things that move, with numbers over time, and their table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow.objects import OBJECT_COLUMNS, ObjectTable, ObjectTracker


def disks(shape: tuple[int, int], *centres: tuple[float, float]) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.any([np.hypot(x - cx, y - cy) < 6 for cx, cy in centres], axis=0)


def test_numbers_last_while_things_pass_each_other_and_vanish() -> None:
    tracker = ObjectTracker(min_area=10, max_missed=3)
    paths = []
    for k in range(20):
        centres = [(10 + 4 * k, 20), (90 - 4 * k, 40)]
        if 8 <= k < 11:
            centres.pop(0)
        mask = disks((60, 100), *centres)
        motion = np.zeros((*mask.shape, 2))
        motion[:30] = 4, 0
        motion[30:] = -4, 0
        paths.append({thing.id: thing for thing in tracker.update(mask, motion)})
    assert set().union(*paths) == {1, 2}
    assert paths[-1][1].y < 30 < paths[-1][2].y
    assert paths[-1][2].age_frames == 20
    assert paths[-1][1].age_frames == 17
    assert paths[-1][1].box[2:] == (11, 11)
    assert (paths[5][1].vx_px_per_frame, paths[5][2].vx_px_per_frame) == (4, -4)
    assert tracker.labels.shape == (60, 100)
    assert set(np.unique(tracker.labels)) == {0, 1, 2}
    for _ in range(4):
        assert tracker.update(np.zeros((60, 100), bool)) == ()
    (new,) = tracker.update(disks((60, 100), (90, 20)))
    assert new.id == 3, "a number is never used twice"


def test_what_flickers_up_in_one_frame_has_no_number() -> None:
    tracker = ObjectTracker(min_area=10, min_age=2)
    assert [thing.id for thing in tracker.update(disks((60, 100), (20, 20)))] == [1], "nothing is known before"
    things = tracker.update(disks((60, 100), (20, 20), (60, 30)))
    assert [(thing.id, thing.age_frames) for thing in things] == [(1, 2)]
    assert set(np.unique(tracker.labels)) == {0, 1}
    # The flicker at (60, 30) is gone; another one stays.
    assert len(tracker.update(disks((60, 100), (20, 20), (80, 50)))) == 1
    things = tracker.update(disks((60, 100), (20, 20), (80, 50)))
    assert [(thing.id, thing.age_frames) for thing in things] == [(1, 4), (2, 2)]


def test_a_region_that_becomes_another_has_no_velocity_of_its_centre() -> None:
    tracker = ObjectTracker()
    tracker.update(disks((60, 100), (20, 30)))
    (thing,) = tracker.update(disks((60, 100), (20, 30), (28, 30), (36, 30)))
    assert np.isnan(thing.vx_px_per_frame)


def test_without_motion_the_way_of_the_centre_is_the_velocity() -> None:
    tracker = ObjectTracker()
    camera = np.array([[1, 0, 2.0], [0, 1, 0], [0, 0, 1]])
    for k in range(4):
        (thing,) = tracker.update(disks((60, 120), (20 + 5 * k, 30)), None, camera)
        assert np.isnan(thing.vx_px_per_frame) if k == 0 else thing.vx_px_per_frame == pytest.approx(3.0, abs=0.1)
    with pytest.raises(rsflow.ShapeError, match="motion"):
        tracker.update(np.zeros((5, 5), bool), np.zeros((5, 4, 2)))
    with pytest.raises(rsflow.OptionError, match="min_area"):
        ObjectTracker(min_area=0)


def test_the_table_has_units_and_survives_ctrl_c(tmp_path: Path) -> None:
    (thing,) = ObjectTracker().update(disks((60, 120), (20, 30)))
    path = tmp_path / "objects.csv"

    def interrupted(error: type[BaseException]) -> None:
        with ObjectTable(path) as table:
            table.write(4, 0.16, [thing])
            raise error

    with pytest.raises(ValueError, match=r"^$"):
        interrupted(ValueError)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(KeyboardInterrupt):
        interrupted(KeyboardInterrupt)
    head, row = path.read_text().splitlines()
    assert head.split(",") == list(OBJECT_COLUMNS)
    assert row.startswith("4,0.160000,1,1,20.00,30.00,15,25,11,11,109,nan,nan,seen,0,")
    assert len(row.split(",")) == len(OBJECT_COLUMNS)
