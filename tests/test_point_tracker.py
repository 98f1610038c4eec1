"""The streaming tracker: ids, ages, where new points come, masks, scene cuts, and its table in every format."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from scipy import ndimage

import rsflow
from rsflow import PointStatus
from rsflow.errors import OptionError

SHAPE = (200, 260)


def picture(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    layers = [ndimage.gaussian_filter(rng.standard_normal((SHAPE[0], SHAPE[1] + 200)), sigma) for sigma in (1.3, 4.0)]
    total = sum(layer / layer.std() for layer in layers)
    return 110 + 25 * total / total.std()


def frame(scene: np.ndarray, dx: int = 0) -> np.ndarray:
    """The scene moved by `dx` pixels to the right: nothing is interpolated, so the truth is exact."""
    return np.round(scene[:, 100 - dx : 100 - dx + SHAPE[1]]).astype(np.uint8)


def test_ids_live_as_long_as_their_point_and_are_never_used_again():
    tracker = rsflow.PointTracker(max_corners=80, min_distance=10)
    seen: dict[int, int] = {}
    over: set[int] = set()
    for step in range(8):
        # Another scene from the fifth frame on.
        tracks = tracker.update(frame(picture(1 if step < 4 else 2), 4 * step))
        assert len(set(tracks.ids.tolist())) == len(tracks)
        for id_, age, status in zip(tracks.ids.tolist(), tracks.ages.tolist(), tracks.status.tolist(), strict=True):
            assert id_ not in over
            assert age == (0 if status == PointStatus.NEW else seen[id_] + 1)
            if status in (PointStatus.NEW, PointStatus.TRACKED):
                seen[id_] = age
            else:
                over.add(id_)
        assert tracker.scene_cut == (step == 4)
        if step == 4:
            assert not tracks.valid.any()
    assert max(seen.values()) >= 3
    assert len(over) >= 80


def test_new_points_come_where_there_are_none():
    scene = picture(3)
    tracker = rsflow.PointTracker(max_corners=100, min_distance=8)
    tracker.update(frame(scene))
    hidden = np.ones(SHAPE, bool)
    hidden[:, :130] = False
    # The left half is lost, and stays without points while the mask excludes it.
    masked = tracker.update(frame(scene, 1), mask=hidden)
    assert (masked.status == PointStatus.MASKED).sum() > 30
    alive = masked.points[masked.valid | (masked.status == PointStatus.NEW)]
    assert (alive[:, 0] >= 129).all()
    tracks = tracker.update(frame(scene, 2))
    new = tracks.points[tracks.status == PointStatus.NEW]
    assert (new[:, 0] < 135).mean() > 0.9
    alive = tracks.points[tracks.valid | (tracks.status == PointStatus.NEW)]
    distances = np.hypot(*(alive[:, None] - alive[None]).T)
    assert distances[~np.eye(len(alive), dtype=bool)].min() >= 7
    counts, _, _ = np.histogram2d(alive[:, 1], alive[:, 0], bins=(2, 2), range=((0, SHAPE[0]), (0, SHAPE[1])))
    assert counts.min() >= 10


def test_points_that_leave_the_frame_say_so_and_are_replaced():
    scene = picture(4)
    tracker = rsflow.PointTracker(max_corners=60, min_distance=10)
    tracker.update(frame(scene))
    gone = 0
    for step in range(1, 8):
        tracks = tracker.update(frame(scene, 9 * step))
        assert not tracker.scene_cut
        left = tracks.status == PointStatus.OUT_OF_FRAME
        gone += left.sum()
        # Windows at the other border have half of what they saw no more.
        beside = np.minimum(tracks.origins[left][:, 0], SHAPE[1] - 1 - tracks.origins[left][:, 0])
        assert (beside < 12).all()
        alive = tracks.valid | (tracks.status == PointStatus.NEW)
        assert 50 <= alive.sum() <= 60
        error = np.abs(tracks.displacement[tracks.valid] - np.float32([9, 0]))
        assert np.median(error) < 0.02
    assert gone > 5


def test_a_still_picture_keeps_every_point_where_it_is():
    still = frame(picture(5))
    tracker = rsflow.PointTracker(max_corners=50)
    first = tracker.update(still)
    for _ in range(3):
        tracks = tracker.update(still)
        np.testing.assert_array_equal(tracks.ids, first.ids)
        np.testing.assert_array_equal(tracks.points, first.points)


def test_ids_go_on_after_a_reset():
    tracker = rsflow.PointTracker(max_corners=20)
    first = tracker.update(frame(picture(6)))
    tracker.reset()
    again = tracker.update(frame(picture(6)))
    assert (again.status == PointStatus.NEW).all()
    assert again.ids.min() > first.ids.max()


def recorded(rate_hz: float = 20.0) -> tuple[rsflow.PointTracker, list[rsflow.Tracks]]:
    scene = picture(7)
    tracker = rsflow.PointTracker(max_corners=40, min_distance=12, record=True)
    return tracker, [tracker.update(frame(scene, 3 * step), t_s=step / rate_hz) for step in range(5)]


def test_the_table_has_a_row_for_each_point_and_frame_with_speeds():
    tracker, tracks = recorded()
    table = tracker.to_table()
    columns = table.columns
    assert list(columns) == list(table.NAMES)
    assert len(table) == sum(len(part) for part in tracks) == len(columns["id"])
    for name, parts in (("id", [part.ids for part in tracks]), ("x_px", [part.points[:, 0] for part in tracks])):
        np.testing.assert_array_equal(columns[name], np.concatenate(parts))
    np.testing.assert_array_equal(columns["frame"], np.repeat(np.arange(5), [len(part) for part in tracks]))
    np.testing.assert_allclose(columns["t_s"], columns["frame"] / 20)
    good = columns["status"] == "tracked"
    assert good.sum() > 100
    # 3 pixels a frame at 20 frames a second.
    np.testing.assert_allclose(np.median(columns["vx_px_s"][good]), 60, atol=0.5)
    assert np.isnan(columns["vx_px_s"][columns["status"] == "new"]).all()
    assert (columns["std_x_px"][good] > 0).all()


def test_the_table_is_written_as_csv_and_parquet_and_read_back(tmp_path):
    tracker, _ = recorded()
    table = tracker.to_table()
    table.save(tmp_path / "tracks.csv")
    with (tmp_path / "tracks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(table.NAMES)
    assert len(rows) == len(table)
    for name in ("id", "age", "frame", "status"):
        assert [row[name] for row in rows] == [str(value) for value in table.columns[name].tolist()]
    for name, atol in (("x_px", 6e-4), ("vy_px_s", 6e-3), ("residual", 6e-5)):
        np.testing.assert_allclose([float(row[name]) for row in rows], table.columns[name], atol=atol)
    parquet = pytest.importorskip("pyarrow.parquet")
    table.save(tmp_path / "tracks.parquet")
    read = parquet.read_table(tmp_path / "tracks.parquet")
    assert read.column_names == list(table.NAMES)
    for name, values in table.columns.items():
        np.testing.assert_array_equal(read.column(name).to_numpy(zero_copy_only=False), values)


def test_a_table_that_was_not_asked_for_or_has_no_format_is_an_error(tmp_path):
    with pytest.raises(OptionError, match="record"):
        rsflow.PointTracker().to_table()
    with pytest.raises(OptionError, match=r"expected a name that ends in \.csv or \.parquet"):
        rsflow.PointTracker(record=True).to_table().save(tmp_path / "tracks.txt")
