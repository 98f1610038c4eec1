"""``rsflow track``: the video and the tables that it leaves."""

from __future__ import annotations

import csv
import json

import cv2
import numpy as np
import pytest
from skimage import data

import rsflow
from rsflow.cli import main
from rsflow.errors import OptionError


@pytest.fixture
def pictures(tmp_path):
    brick = data.brick()
    folder = tmp_path / "pictures"
    folder.mkdir()
    for index in range(6):
        cv2.imwrite(str(folder / f"{index}.png"), brick[40:280, 40 + 3 * index : 360 + 3 * index])
    return folder


def test_the_table_has_the_motion_and_the_video_every_frame(pictures, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["track", str(pictures), "-o", str(out), "--rate", "10", "--points", "150", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == 6
    assert summary["tracked"] > 0.95 * summary["steps"] > 500
    with (out / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    tracked = [row for row in rows if row["status"] == "tracked"]
    assert np.median([float(row["dx_px"]) for row in tracked]) == pytest.approx(-3, abs=0.01)
    assert np.median([float(row["vx_px_s"]) for row in tracked]) == pytest.approx(-30, abs=0.1)
    assert max(int(row["age"]) for row in tracked) == 5
    new = [row for row in rows if row["status"] == "new"]
    assert {row["dx_px"] for row in new} == {"nan"}
    video = cv2.VideoCapture(str(out / "tracks.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 6
    ok, frame = video.read()
    assert ok
    assert frame.shape == (240, 320, 3)


def test_parquet_holds_what_csv_holds(pictures, tmp_path, capsys):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert main(["track", str(pictures), "-o", str(tmp_path), "--no-video", "--parquet", "--stop", "3"]) == 0
    assert "3 frames" in capsys.readouterr().out
    table = parquet.read_table(tmp_path / "tracks.parquet")
    assert table.column_names == list(rsflow.tracking.TrackTable.NAMES)
    assert set(table["frame"].to_pylist()) == {0, 1, 2}
    assert not (tmp_path / "tracks.mp4").exists()


def test_failures_are_one_line(tmp_path, capsys):
    assert main(["track", str(tmp_path / "none.mp4"), "-o", str(tmp_path)]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["track", str(tmp_path), "--trail", "0", "-o", str(tmp_path)]) == 1
    assert "--trail: got 0, expected 1 or more frames" in capsys.readouterr().err


def test_a_table_needs_a_record_and_a_known_suffix(tmp_path):
    with pytest.raises(OptionError, match="record: got False"):
        rsflow.PointTracker().to_table()
    tracker = rsflow.PointTracker(record=True)
    assert len(tracker.to_table()) == 0
    tracker.to_table().save(tmp_path / "empty.csv")
    assert (tmp_path / "empty.csv").read_text().startswith("frame,t_s,id")
    with pytest.raises(OptionError, match=r"expected a name that ends in \.csv or"):
        tracker.to_table().save(tmp_path / "tracks.txt")
