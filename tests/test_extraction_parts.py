"""The parts of the main job: tables, progress, plots, track."""

import contextlib
import math
import re
import sys
import time

import numpy as np
import pytest

import rsflow
from extraction_helpers import HEIGHT_M, names_in
from rsflow import synthetic
from rsflow.extraction.columns import meaning
from rsflow.extraction.progress import Progress, clock
from rsflow.extraction.report import axes, time_plot
from rsflow.extraction.rows import status_word
from rsflow.extraction.series import Series, runs
from rsflow.extraction.tables import CsvTable, cell
from rsflow.extraction.trajectory import Trajectory
from rsflow.extraction.worker import BackgroundWorker

# --- parts ----------------------------------------------------------------------------------------------------------


def test_cells():
    values = [None, True, 3, 0.1, -0.0, math.nan, -math.inf, 'a "b", c', np.float64(1 / 3)]
    assert [cell(value) for value in values] == [
        "", "true", "3", "0.1", "0", "nan", "-inf", '"a ""b"", c"', "0.333333333",
    ]  # fmt: skip


def test_table_cuts_a_row_that_does_not_fit(tmp_path, monkeypatch):
    table = CsvTable(tmp_path / "a.csv", ("n", "text"))
    table.append({"n": 1, "text": "fits"})
    real = table._file

    class Full:
        """Takes four more bytes, then the disk is full."""

        left = 4

        def write(self, data):
            if self.left <= 0:
                raise OSError(28, "No space left on device")
            count = real.write(bytes(data)[: self.left])
            self.left -= count
            return count

        def __getattr__(self, name):
            return getattr(real, name)

    table._file = Full()
    with pytest.raises(OSError, match=r"No space left.*a\.csv"):
        table.append({"n": 2, "text": "does not fit"})
    assert table.keep(complete=False).read_text() == "n,text\n1,fits\n"
    assert names_in(tmp_path) == {"a.partial.csv"}


def test_table_refuses_an_unknown_column(tmp_path):
    with CsvTable(tmp_path / "a.csv", ("n",)) as table, pytest.raises(KeyError, match="no column m"):
        table.append({"m": 1})


def test_progress_is_silent_unless_watched(capsys):
    with Progress(3, "x") as bar:
        bar.advance(3)
    assert capsys.readouterr() == ("", "")
    assert clock(3723) == "1:02:03"
    assert clock(62.4) == "1:02"


def test_progress_without_tqdm_is_a_line(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    with Progress(4, "clip", enabled=True) as bar:
        for _ in range(4):
            bar.advance()
    line = capsys.readouterr().err.split("\r")[-1]
    assert re.match(r"clip: 4/4 frames, [\d.]+ frames/s, 0:00 gone, 0:00 left\s*\n", line), line


def test_progress_with_tqdm(capsys):
    with Progress(None, "clip", enabled=True) as bar:
        bar.advance(7)
    assert "7 frames" in capsys.readouterr().err


def test_ticks_are_round():
    assert axes.ticks(0.0, 1.0) == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert axes.ticks(-3.2, 7.9, 4) == [0.0, 5.0]
    assert axes.ticks(2.0, 2.0) == [2.0]


def test_thinning_keeps_peaks_and_gaps():
    x = np.arange(100_000.0)
    y = np.zeros(100_000)
    y[54_321] = 9.0
    y[10_000:20_000] = np.nan
    thin_x, thin_y = axes.thinned(x, y)
    assert len(thin_x) == len(thin_y) <= 1600
    assert (np.diff(thin_x) > 0).all()
    assert thin_x[np.nanargmax(thin_y)] == 54_321
    assert np.isnan(thin_y[(thin_x > 10_200) & (thin_x < 19_800)]).all()
    band_x, low, high = axes.envelope(x, y - 1, y + 1)
    assert len(band_x) == len(low) == len(high) <= 800
    assert (np.nanmax(high), np.nanmin(low)) == (10.0, -1.0)
    assert np.isnan(low).any()


def test_plot_leaves_gaps_open():
    y = np.array([0.0, 1.0, np.nan, 3.0, 2.0, np.nan, 5.0])
    curve = time_plot.Curve("a <b>", y)
    drawn = time_plot.time_plot(np.arange(7.0), [curve], title="t", y_label="px", valid=np.isfinite(y))
    for text in (drawn.file(), drawn.inline()):
        assert text.count("<polyline") == 3
        assert text.count('stroke-linecap="round"') == 1
        assert "a &lt;b&gt;" in text
        assert "not measured" in text
        assert "a <b>" not in text
    nothing = np.full(3, np.nan)
    drawn = time_plot.time_plot(nothing, [time_plot.Curve("a", nothing)], title="t", y_label="px")
    assert drawn.file().startswith("<svg")
    assert "nan" not in drawn.file()


def test_runs_as_ranges():
    frames = np.array([0.0, 2, 4, 6, 8, 10])
    assert runs(frames, np.array([1, 1, 0, 1, 0, 1], bool)) == "0-2, 6, 10"
    assert runs(frames, np.array([1, 0, 1, 0, 1, 0], bool), limit=2) == "0, 4, ..."
    series = Series(["a"], ["w"])
    series.append({"a": 1, "w": "x"})
    series.append({"w": "x"})
    assert np.isnan(series["a"][1])
    assert series.counts("w") == {"x": 2}


def test_track_follows_a_turning_camera():
    flight = synthetic.flight(
        frames=20, height_m=HEIGHT_M, velocity_m_s=(0.05, 0.0, 0.0), rate_rad_s=(0.0, 0.0, 0.6), seed=4
    )
    estimator = rsflow.VelocityEstimator(flight.camera, height_m=HEIGHT_M)
    track = Trajectory()
    rows = [
        track.add(estimator.update(image, t_s), index)
        for index, (image, t_s) in enumerate(zip(flight.images, flight.t_s, strict=True))
    ]
    end = flight.position_m[-1] - flight.position_m[0]
    assert rows[-1]["heading_rad"] == pytest.approx(0.6 * flight.t_s[-1], rel=0.02)
    assert (rows[-1]["x_m"], rows[-1]["y_m"]) == pytest.approx((end[0], end[1]), abs=3e-4)
    assert 0 < rows[-1]["x_std_m"] < 1e-3


def test_every_status_has_its_meaning_in_the_report():
    for status in (*rsflow.ShiftStatus, *rsflow.VelocityStatus):
        word = status_word(status)
        assert meaning(word) not in {"", word}, status


def test_a_worker_does_all_in_order_and_raises_its_first_error_once():
    done = []
    worker = BackgroundWorker(lambda item: done.append(1 // item), name="test", depth=1)
    for item in (1, 1, 0, 1):
        with contextlib.suppress(ZeroDivisionError):
            worker.put(item)
    with contextlib.suppress(ZeroDivisionError):
        worker.wait()
    assert done == [1, 1]
    worker.wait()
    worker.close()
    failing = BackgroundWorker(lambda item: done.append(1 // item), name="test")
    failing.put(0)
    with pytest.raises(ZeroDivisionError):
        failing.wait()


def test_waiting_ends_when_all_that_was_put_is_done():
    done = []
    worker = BackgroundWorker(lambda seconds: (time.sleep(seconds), done.append(seconds)), name="test")
    worker.put(0.05)
    worker.put(0.0)
    worker.wait()
    assert done == [0.05, 0.0]
    worker.close()
