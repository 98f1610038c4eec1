"""`rsflow bench extract`: it times what a frame takes, its parts are all of it, and its clocks come off again."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import pytest

import rsflow
from rsflow import cli
from rsflow.bench import EXTRACT_MARKS, ExtractBench, ExtractRow, PartRow, extract_run
from rsflow.bench.extract_run import measure_extract

SMALL = (64, 48)


@pytest.fixture(scope="module")
def found() -> ExtractBench:
    before = rsflow.get_num_threads(), cv2.getNumThreads()
    hooks = {part: getattr(owner, name) for part, (owner, name) in extract_run.parts().items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(extract_run, "SIZES", (SMALL,))
        result = measure_extract(quick=True)
    assert (rsflow.get_num_threads(), cv2.getNumThreads()) == before
    assert {part: getattr(owner, name) for part, (owner, name) in extract_run.parts().items()} == hooks
    return result


def test_the_whole_is_timed_beside_dense_flow_of_the_same_frames(found: ExtractBench) -> None:
    tables, both = found.rows
    assert (tables.size, tables.outputs, both.outputs) == (SMALL, "tables", "tables and videos")
    for row in found.rows:
        assert 0 < row.dis_time_ms < row.time_ms
        assert row.times == pytest.approx(row.time_ms / row.dis_time_ms)
        # Two threads and an encoder's own: no more of the processors than there are threads.
        assert 0 < row.cpu_ms < 8 * row.time_ms
    assert found.frames == 40


def test_every_part_is_called_and_together_they_are_the_whole(found: ExtractBench) -> None:
    assert {row.part for row in found.parts} == {*extract_run.parts(), "all else"}
    shares = {row.part: row.cpu_ms for row in found.parts}
    assert all(math.isfinite(share) and share > 0 for share in shares.values()), shares
    assert shares["dense flow"] > 0.02
    assert shares["videos encoded"] > 0.02
    # What no part names must not be most of it.
    assert shares["all else"] < 0.6 * sum(shares.values())


def test_time_of_a_part_within_another_counts_once() -> None:
    class Work:
        def outer(self) -> int:
            return self.inner() + sum(range(200_000))

        def inner(self) -> int:
            return sum(range(400_000))

    spent: dict[str, float] = {"outer": 0.0, "inner": 0.0}
    with extract_run._clocked({"outer": (Work, "outer"), "inner": (Work, "inner")}, spent):
        Work().outer()
    assert 0 < spent["outer"] < spent["inner"]


def test_command_prints_both_tables_and_rewrites_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = (ExtractRow((640, 480), "tables", 12.0, 21.0, 10.0, 20.0),)
    made = ExtractBench(rows, (PartRow((640, 480), "velocity", 1.5),), 2, "avx2", 150, {"rsflow": "0.1.0"})
    asked: list[dict[str, object]] = []
    monkeypatch.setattr(extract_run, "measure_extract", lambda **options: asked.append(options) or made)
    first, last = EXTRACT_MARKS
    page = tmp_path / "page.md"
    page.write_text(f"{first}\n{last}\n", encoding="utf-8")
    assert cli.main(["bench", "extract", "--rounds", "60", "--update", str(page)]) == 0
    assert made.tables() in capsys.readouterr().out
    assert page.read_text(encoding="utf-8") == f"{first}\n\n{made.tables()}\n\n{last}\n"
    assert asked == [{"threads": 2, "frames": 60, "quick": False}]
    assert cli.main(["bench", "extract", "--threads", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parts"][0]["cpu_ms"] == 1.5
    assert asked[1]["threads"] == 1


@pytest.mark.parametrize("options", [{"frames": 39}, {"threads": 0}, {"quick": 1}])
def test_misuse_says_what_was_got(options: dict[str, object]) -> None:
    with pytest.raises(
        rsflow.OptionError, match=f"{next(iter(options))}: got {next(iter(options.values()))}, expected"
    ):
        measure_extract(**options)  # type: ignore[arg-type]
