"""Folders of results: what stands in them, whose it is, and what does not belong there."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

import rsflow
from rsflow import synthetic
from rsflow._results.folder import MANIFEST, Identity, ResultFolder


def folder_of(path: Path, settings: str, *, overwrite: bool = True) -> ResultFolder:
    return ResultFolder(path, "flow", ("flow_*.flo",), Identity("source", settings), overwrite=overwrite)


def test_files_of_two_runs_are_told_apart_until_the_second_is_complete(tmp_path):
    with folder_of(tmp_path, "first") as first:
        first.record()
        for k in range(3):
            (tmp_path / f"flow_{k}.flo").write_text("first")
        first.finish(tmp_path.glob("flow_*"))
    # A second one is killed after a file; a third one, of the same settings, completes with as many.
    with folder_of(tmp_path, "second") as second:
        second.record()
        (tmp_path / "flow_0.flo").write_text("second")
    with folder_of(tmp_path, "second", overwrite=False) as third:
        third.record()
        (tmp_path / "flow_0.flo").write_text("second")
        third.finish([tmp_path / "flow_0.flo"])
    assert [path.name for path in tmp_path.glob("flow_*")] == ["flow_0.flo"]
    assert json.loads((tmp_path / MANIFEST).read_text())["flow"] == {"source": "source", "settings": "second"}


def test_a_record_names_no_file_outside_its_own(tmp_path):
    (tmp_path / "mine.txt").touch()
    entry = {"source": "source", "settings": "a", "earlier": ["mine.txt", "../x", 3, None]}
    (tmp_path / MANIFEST).write_text(json.dumps({"flow": entry}))
    with folder_of(tmp_path, "a") as again:
        again.record()
        again.finish([])
    assert (tmp_path / "mine.txt").exists()


def test_a_folder_that_cannot_be_written_into_is_told_before_the_work(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.raises(rsflow.OptionError, match="file: got a file, or a link that leads nowhere"):
        folder_of(tmp_path / "file", "a").__enter__()
    with pytest.raises(NotADirectoryError, match=r"cannot make the folder .*file/below: Not a directory"):
        folder_of(tmp_path / "file" / "below", "a").__enter__()
    # Root may write anywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(PermissionError, match=f"cannot write into the folder {tmp_path}: Permission denied"):
        folder_of(tmp_path, "a").__enter__()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
@pytest.mark.parametrize("name", [MANIFEST, "flow_0.flo"])
@pytest.mark.parametrize("device", [False, True])
def test_a_pipe_or_device_among_results_is_refused_unread(tmp_path, name, device):
    if device:
        (tmp_path / name).symlink_to("/dev/zero")
    else:
        os.mkfifo(tmp_path / name)
    with pytest.raises(rsflow.OptionError, match=rf"{name}: got a (pipe|device), expected a regular file"):
        folder_of(tmp_path, "a")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_extract_refuses_a_pipe_in_the_place_of_its_summary(tmp_path):
    pair = synthetic.shifted_pair(1.0, 0.0, size=(64, 48), seed=1)
    os.mkfifo(tmp_path / "summary.json")
    with pytest.raises(rsflow.OptionError, match=r"summary\.json: got a pipe"):
        rsflow.extract([pair.prev, pair.next], tmp_path, frame_rate=10, videos=False, overwrite=True)
