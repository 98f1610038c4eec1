"""What every command refuses alike: a single frame, a stride of none, an empty name, two outputs of one name."""

from __future__ import annotations

import errno
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import synthetic
from rsflow.cli import main

COMMANDS = {
    "flow": ["-o", "out"],
    "grid": ["-o", "out"],
    "segment": ["-o", "out"],
    "track": ["-o", "out", "--no-video"],
    "extract": ["-o", "out", "--no-videos", "-q"],
    "velocity": ["-o", "out", "--camera", "camera.json", "--height", "0.2"],
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    flight = synthetic.flight(frames=6, height_m=0.2, seed=2)
    (tmp_path / "in").mkdir()
    for k, image in enumerate(flight.images):
        cv2.imwrite(str(tmp_path / "in" / f"{k}.png"), image)
    flight.camera.save(tmp_path / "camera.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("limits", [("--start", "5"), ("--stop", "1"), ("--stride", "100")])
def test_a_single_frame_is_one_error(here, capsys, command, limits):
    assert main([command, "in", "--rate", "30", *COMMANDS[command], *limits]) == 1
    line = capsys.readouterr().err
    assert "in has 6 frames, and 1 is left by start=" in line
    assert "expected at least two" in line
    assert not (here / "out").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_a_stride_of_none_is_refused(here, capsys, command):
    assert main([command, "in", "--rate", "30", *COMMANDS[command], "--stride", "0"]) == 1
    assert "stride: got 0" in capsys.readouterr().err
    assert not (here / "out").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_an_empty_name_is_not_this_folder(here, capsys, command):
    with_nothing = ["" if word == "out" else word for word in COMMANDS[command]]
    assert main([command, "in", "--rate", "30", *with_nothing]) == 2
    assert "argument --output: got ''" in capsys.readouterr().err
    assert sorted(path.name for path in here.iterdir()) == ["camera.json", "in"]


@pytest.mark.parametrize("other", ["z.png", "./z.png", "in/../z.png", "linked/z.png", "again.png"])
def test_two_outputs_are_two_files(here, capsys, other):
    Path("linked").symlink_to(here)
    Path("again.png").symlink_to("z.png")
    assert main(["flow", "in/0.png", "in/1.png", "-o", "z.png", "--picture", other]) == 1
    assert "--picture" in capsys.readouterr().err
    assert not Path("z.png").exists()


@pytest.mark.parametrize("command", ["flow", "segment", "track"])
def test_a_folder_that_is_none_is_said(here, capsys, command):
    Path("out").symlink_to("out")
    assert main([command, "in", "--rate", "30", *COMMANDS[command]]) == 1
    assert "out: got a file, or a link that leads nowhere, expected a folder" in capsys.readouterr().err


def test_a_flow_of_negative_size_is_no_flow(tmp_path):
    with (tmp_path / "a.npy").open("wb") as file:
        header = {"descr": "<f4", "fortran_order": False, "shape": (-2, -2, 2)}
        np.lib.format.write_array_header_1_0(file, header)
        file.write(bytes(32))
    with pytest.raises(rsflow.FormatError, match=r"says \(-2, -2, 2\)"):
        rsflow.read_flow(tmp_path / "a.npy")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device here")
@pytest.mark.parametrize("suffix", ["npy", "flo", "pfm", "npz"])
def test_a_full_disk_is_said(tmp_path, monkeypatch, suffix):
    from rsflow.io import atomic

    # The file beside is on a disk that is full.
    monkeypatch.setattr(atomic.Working, "_beside", lambda _: Path("/dev/full"))
    monkeypatch.setattr(atomic.Working, "discard", lambda _: None)
    with pytest.raises(OSError, match=r"cannot write .*x\.\w+: No space left on device") as caught:
        rsflow.write_flow(tmp_path / f"x.{suffix}", np.random.default_rng(1).normal(0, 1, (200, 200, 2)))
    assert caught.value.errno == errno.ENOSPC


def test_a_camera_file_with_entities_is_refused_in_words(tmp_path):
    path = tmp_path / "camera.xml"
    path.write_text(
        '<?xml version="1.0"?>\n<!DOCTYPE x [<!ENTITY a "b"><!ENTITY c "&a;&a;">]>\n<opencv_storage><k>&c;</k>'
        "</opencv_storage>\n"
    )
    with pytest.raises(rsflow.FormatError, match=r"camera\.xml") as caught:
        rsflow.Camera.load(path)
    assert "<class" not in str(caught.value)
