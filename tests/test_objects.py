"""Things that move, with numbers over time, and their table."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsflow
from rsflow.objects import (
    OBJECT_COLUMNS,
    CountingLine,
    ObjectStatistics,
    ObjectTable,
    ObjectTracker,
    TrackedObject,
)
from rsflow.segmentation.tracks.assignment import assign


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


def walks(*ways: Callable[[int], tuple[float, float] | None], frames: int, **options: Any) -> list[tuple[Any, ...]]:
    """Follow disks along ways; a way gives no place where its thing is hidden. Each has the motion that is true."""
    tracker = ObjectTracker(min_area=10, **options)
    y, x = np.mgrid[:120, :200]
    seen = []
    for k in range(frames):
        mask, motion = np.zeros((120, 200), bool), np.zeros((120, 200, 2))
        for way in ways:
            here, before = way(k), way(k - 1)
            if here is None:
                continue
            inside = np.hypot(x - here[0], y - here[1]) < 8
            mask |= inside
            motion[inside] = (0, 0) if before is None else (here[0] - before[0], here[1] - before[1])
        seen.append((tracker.update(mask, motion, t_s=k / 10), tracker.hidden, tracker.labels))
    return seen


def test_things_that_cross_in_one_region_keep_their_numbers() -> None:
    seen = walks(lambda k: (20 + 4 * k, 58), lambda k: (180 - 4 * k, 62), frames=40)
    for k in (0, 39):
        by_id = {thing.id: thing.x for thing in seen[k][0]}
        assert by_id == pytest.approx({1: 20 + 4 * k, 2: 180 - 4 * k}, abs=1)
    assert {thing.state for thing in seen[20][0] + seen[20][1]} <= {"merged", "hidden"}
    assert set(np.unique(seen[18][2])) == {0, 1, 2}, "both have pixels of the region they share"


def test_a_thing_behind_a_post_is_predicted() -> None:
    seen = walks(lambda k: None if 10 <= k < 20 else (20 + 5 * k, 60), frames=30)
    assert [len(things) for things, _, _ in seen[8:22]] == [1, 1, *[0] * 10, 1, 1]
    (hidden,) = seen[15][1]
    assert (hidden.id, hidden.state, hidden.missed_frames, hidden.area) == (1, "hidden", 6, 0)
    assert abs(hidden.x - 95) < 3 * max(hidden.x_std_px, 0.5)
    (again,) = seen[29][0]
    assert again.id == 1
    assert again.travelled_px == pytest.approx(145, rel=0.05)


def test_a_thing_that_is_two_is_split() -> None:
    # Side by side in one region, then apart.
    seen = walks(lambda k: (40 + 3 * k, 60), lambda k: (52 + 3 * k, 60 + 3 * max(0, k - 20)), frames=34)
    assert [len(things) for things, _, _ in seen[:20]] == [1] * 20
    assert len(seen[33][0]) == 2
    assert 1 in {thing.id for thing in seen[33][0]}


def test_what_gets_nowhere_is_no_thing() -> None:
    rng = np.random.default_rng(1)
    shake = rng.normal(0, 2.5, (80, 2))
    seen = walks(
        lambda k: (60 + shake[k % 80][0], 30 + shake[k % 80][1]),
        lambda k: (150, 100),
        lambda k: (20 + 2 * k, 80),
        frames=60,
        only_travelling=True,
    )
    counts = [len(things) for things, _, _ in seen]
    assert counts[3:30].count(1) >= 20
    assert counts[30:] == [1] * 30
    assert seen[59][0][0].y == pytest.approx(80, abs=0.5)


@pytest.mark.parametrize("speed", [0.3, 3.0, 30.0])
def test_speeds_are_smooth_and_their_deviations_honest(speed: float) -> None:
    rng = np.random.default_rng(2)
    tracker = ObjectTracker(min_area=10)
    errors = []
    for k in range(40 if speed < 10 else 16):
        x, y = 30 + speed * k, 60 + 0.2 * speed * k
        rows, columns = np.mgrid[:240, :600]
        inside = np.hypot(columns - x - rng.normal(0, 0.5), rows - y) < 14 + rng.normal(0, 0.5)
        motion = rng.normal((speed, 0.2 * speed), 0.3 + 0.05 * speed, (240, 600, 2))
        motion[rng.random((240, 600)) < 0.4] = np.nan
        (thing,) = tracker.update(inside, motion, t_s=k / 25)
        if k >= 10:
            assert thing.speed_px_s == pytest.approx(25 * math.hypot(speed, 0.2 * speed), rel=0.05, abs=1.25)
            errors.append((thing.vx_px_s - 25 * speed) / thing.vx_std_px_s)
    assert np.sqrt(np.mean(np.square(errors))) < 2


def test_a_camera_that_moves_leaves_speeds_and_places_over_the_ground() -> None:
    tracker = ObjectTracker(min_area=10)
    camera = np.array([[1.0, 0, 5], [0, 1, -1], [0, 0, 1]])
    rows, columns = np.mgrid[:120, :300]
    for k in range(25):
        mask = np.hypot(columns - 20 - 7 * k, rows - 60 + k) < 8
        (thing,) = tracker.update(mask, np.where(mask[..., None], (2.0, 0.0), np.nan), camera if k else None)
    assert (thing.vx_px_per_frame, thing.vy_px_per_frame) == pytest.approx((2, 0), abs=0.05)
    assert (thing.x_ground_px, thing.y_ground_px) == pytest.approx((20 + 2 * 24, 60), abs=1)
    assert thing.travelled_px == pytest.approx(48, abs=2)


def test_lines_are_crossed_once_and_both_ways() -> None:
    across, beside = CountingLine(100, 120, 100, 0), CountingLine(100, 40, 100, 0)
    statistics = ObjectStatistics(lines=[across, beside], scale_m_per_px=0.1)
    trembling = [99, 99.6, 100.4, 99.7, 100.3, 99.5]
    seen = walks(
        lambda k: (20 + 5 * k, 60),
        lambda k: (170 - 4 * k, 90),
        lambda k: (trembling[k % 6], 20) if k < 30 else (99 + 3 * (k - 30), 20),
        frames=35,
    )
    for frame, (things, hidden, _) in enumerate(seen):
        statistics.update(frame, things, hidden, size=(200, 120))
    assert (across.to_right, across.to_left) == (2, 1)
    assert (beside.to_right, beside.to_left) == (1, 0)
    told = statistics.to_dict()
    assert told["things"] == 3
    assert told["speed_unit"] == "m_s"
    assert sum(told["speed_counts"]) >= 100
    assert [190, 60] in [pytest.approx(path["exit_px"], abs=3) for path in told["paths"].values()]
    assert statistics.heat_map.shape == (15, 25)
    assert {number: len(path) for number, path in statistics.paths.items()} == {1: 35, 2: 35, 3: 35}
    assert json.dumps(told)


@pytest.mark.parametrize("seed", range(20))
def test_the_pairing_is_the_best_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.integers(0, 12, (rng.integers(1, 6), rng.integers(1, 6))).astype(float)
    cost[rng.random(cost.shape) < 0.2] = np.inf

    def total(pairs: Iterable[tuple[int, int]]) -> float:
        return sum(cost[pair] - 10 for pair in pairs)

    rows, columns = cost.shape
    best = 0.0
    for count in range(1, min(rows, columns) + 1):
        for some in itertools.combinations(range(rows), count):
            for others in itertools.permutations(range(columns), count):
                best = min(best, total(zip(some, others, strict=True)))
    found = assign(cost, 10)
    assert total(found) == best
    assert len({row for row, _ in found}) == len({column for _, column in found}) == len(found)


def test_memory_is_bounded() -> None:
    statistics = ObjectStatistics()
    things = [TrackedObject(number, 5.0, 5.0, (0, 0, 9, 9), 81, 1.0, 0.0, 9) for number in range(200)]
    for frame in range(2500):
        statistics.update(frame, things, size=(64, 64))
    assert sum(map(len, statistics.paths.values())) <= 200_200
    assert statistics.to_dict()["paths"]["7"]["frames"] == 2500
