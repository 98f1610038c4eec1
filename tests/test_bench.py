"""`rsflow bench`: its figures hold, and it rewrites nothing but its own lines of a file."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import bench, cli
from rsflow.bench import BEGIN, END, Bench, Row

PAGE = f"# Title\n\nBefore.\n\n{BEGIN}\nold\n{END}\n\nAfter.\n"


@pytest.fixture(scope="module")
def found() -> Bench:
    before = rsflow.get_num_threads(), cv2.getNumThreads()
    result = bench.measure(rounds=1, quick=True)
    assert (rsflow.get_num_threads(), cv2.getNumThreads()) == before
    return result


def _row(found: Bench, scene: str, method: str) -> Row:
    rows = [row for row in found.rows if scene in row.scene and row.method == method]
    assert len(rows) == 1, (scene, method, [(row.scene, row.method) for row in found.rows])
    return rows[0]


def test_dense_flow_is_right_in_any_light_and_beside_an_object(found: Bench):
    for preset, bound in (("fast", 0.06), ("balanced", 0.03), ("accurate", 0.03)):
        for scene in ("320 x 240, steady light", "320 x 240, gain 0.7, plus 20"):
            row = _row(found, scene, f"rsflow dense_flow, {preset}")
            assert row.median_px < bound
            assert row.answered == 1.0
        assert _row(found, "flight with an object", f"rsflow dense_flow, {preset}").median_px < 0.12
    # What is known of OpenCV, so that a wrong sign or a wrong pair would show: within a quarter of a pixel.
    for method in ("OpenCV DIS, ultrafast", "OpenCV DIS, fast", "OpenCV DIS, medium", "OpenCV Farneback"):
        assert _row(found, "320 x 240, steady light", method).median_px < 0.25


def test_points_are_right_with_the_light_compensated(found: Bench):
    for row in found.rows:
        if row.method == "rsflow track_points":
            assert row.median_px < 0.02
            assert row.answered > 0.85
    steady = [row for row in found.rows if row.subject == "points" and "steady light" in row.scene]
    assert len(steady) == 3
    assert all(row.median_px < 0.05 for row in steady)


def test_displacements_are_right(found: Bench):
    rows = [row for row in found.rows if row.subject == "displacement"]
    assert len(rows) == 8
    for row in rows:
        assert row.answered == 1.0
        assert row.p95_px < (0.02 if row.method.startswith("rsflow") else 1.0)


def test_times_and_conditions(found: Bench):
    assert all(0.001 < row.time_ms < 60_000 for row in found.rows)
    assert found.conditions().startswith(f"CPU level {rsflow.build_info()['cpu_level']}, 1 thread, times are")
    assert f"OpenCV {cv2.__version__}" in found.conditions()


def test_tables_are_markdown(found: Bench):
    blocks = found.tables().split("\n\n")
    assert len(blocks) == 4
    for block in blocks[:3]:
        lines = block.splitlines()
        assert {(line.count("|"), line[0], line[-1]) for line in lines} == {(7, "|", "|")}
        assert set(lines[1]) == {"|", "-", ":"}


def test_no_answer_is_a_dash():
    row = Row("points", "scene", "method", np.nan, np.nan, 0.0, 250.0)
    text = Bench((row,), "baseline", 2, 3, {"rsflow": "1"}).tables()
    assert "|             - |    - |    0.0 % | 250 ms |" in text
    assert text.endswith("CPU level baseline, 2 threads, times are medians of 3 rounds; rsflow 1.")


@pytest.mark.parametrize("name", ["threads", "rounds"])
def test_counts_below_one(name: str):
    with pytest.raises(rsflow.OptionError, match=f"{name}: got 0, expected an integer from 1"):
        bench.measure(**{name: 0})


@pytest.fixture
def quickly(found: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "measure", lambda **_: found)


def test_command_prints_json(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["bench", "--quick", "--rounds", "1", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["rounds"] == figures["threads"] == 1
    assert {row["subject"] for row in figures["rows"]} == {"dense flow", "points", "displacement"}


@pytest.mark.usefixtures("quickly")
def test_json_has_no_nan(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    row = Row("points", "scene", "method", np.nan, np.nan, 0.0, 1.0)
    monkeypatch.setattr(bench, "measure", lambda **_: Bench((row,), "baseline", 1, 1, {}))
    assert cli.main(["bench", "--json"]) == 0
    out = capsys.readouterr().out
    assert "NaN" not in out
    assert json.loads(out)["rows"][0]["median_px"] is None


@pytest.mark.usefixtures("quickly")
def test_update_rewrites_what_is_between_the_marks(found: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    for _ in range(2):
        assert cli.main(["bench", "--update", str(page)]) == 0
        assert page.read_text(encoding="utf-8") == PAGE.replace("old", f"\n{found.tables()}\n")
    assert found.tables() in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == [page]


@pytest.mark.parametrize(
    "text", ["no marks\n", f"{BEGIN}\n", f"{END}\n{BEGIN}\n", PAGE + PAGE], ids=["none", "one", "swapped", "twice"]
)
def test_update_without_marks(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(bench, "measure", lambda **_: pytest.fail("measured before the file was checked"))
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    assert cli.main(["bench", "--update", str(page)]) == 1
    error = capsys.readouterr().err
    assert f"lines '{BEGIN}' and" in error
    assert "expected one of each, in this order" in error
    assert page.read_text(encoding="utf-8") == text


def test_update_of_what_is_no_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    page = tmp_path / "page.md"
    page.write_bytes(b"\xff\xfe")
    assert cli.main(["bench", "--update", str(page)]) == 1
    assert "not a text file in UTF-8" in capsys.readouterr().err
    assert cli.main(["bench", "--update", str(tmp_path / "none.md")]) == 1
    assert "none.md" in capsys.readouterr().err
