"""The commands flow, segment and convert: what they write, say and refuse."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import skimage.data

import rsflow
from rsflow.cli import main


@pytest.fixture
def pair(tmp_path: Path) -> tuple[str, str]:
    ground = skimage.data.gravel()
    paths = []
    for k in range(2):
        # The content moves by (-3, +2).
        paths.append(str(tmp_path / f"picture{k}.png"))
        cv2.imwrite(paths[-1], ground[100 - 2 * k : 220 - 2 * k, 100 + 3 * k : 260 + 3 * k])
    return paths[0], paths[1]


@pytest.fixture
def clip(tmp_path: Path) -> str:
    path = tmp_path / "clip.mp4"
    ground = skimage.data.gravel()
    with rsflow.VideoWriter(path, frame_rate=20) as video:
        for k in range(8):
            picture = ground[100:220, 100:260].copy()
            picture[40:70, 20 + 5 * k : 60 + 5 * k] = skimage.data.grass()[100:130, 100:140]
            video.write(picture)
    return str(path)


def test_flow_of_a_pair(tmp_path: Path, pair: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    flo, svg = tmp_path / "out" / "a.flo", tmp_path / "a.svg"
    assert main(["flow", *pair, "-o", str(flo), "--picture", str(svg)]) == 0
    assert "median motion (-3.00, +2.00) px" in capsys.readouterr().out
    uv = rsflow.read_flow(flo)
    assert np.nanmedian(uv, axis=(0, 1)) == pytest.approx([-3, 2], abs=0.05)
    assert svg.read_text().startswith("<svg ")
    for style in ("color", "overlay"):
        picture = tmp_path / f"{style}.png"
        assert main(["flow", *pair, "--picture", str(picture), "--style", style, "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert said["median_u_px"] == pytest.approx(-3, abs=0.05)
        assert said["t0_s"] is None
        assert cv2.imread(str(picture)).shape == (120, 160, 3)
    assert main(["flow", *pair, "--picture", str(tmp_path / "b.svg"), "--style", "color"]) == 1
    assert "an .svg has arrows" in capsys.readouterr().err


def test_flow_of_a_pair_with_a_mask_and_a_start(tmp_path: Path, pair: tuple[str, str]) -> None:
    mask = np.zeros((120, 160), np.uint8)
    mask[:, :80] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    assert main(["flow", *pair, "-o", str(tmp_path / "a.flo"), "--mask", str(tmp_path / "mask.png")]) == 0
    known = ~np.isnan(rsflow.read_flow(tmp_path / "a.flo")).any(axis=2)
    assert known[10:110, 10:80].mean() > 0.95
    assert not known[:, 80:].any()
    # Farther than the picture's size lets it look without a start.
    ground = skimage.data.gravel()
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"far{k}.png"), ground[100:200, 100 + 60 * k : 220 + 60 * k])
    rsflow.write_flow(tmp_path / "start.npy", np.full((100, 120, 2), (-57, 2), np.float32))
    far = ["flow", str(tmp_path / "far0.png"), str(tmp_path / "far1.png"), "-o", str(tmp_path / "far.flo")]
    assert main([*far, "--initial", str(tmp_path / "start.npy")]) == 0
    uv = rsflow.read_flow(tmp_path / "far.flo")
    assert np.nanmedian(uv, axis=(0, 1)) == pytest.approx([-60, 0], abs=0.1)


def test_flow_tells_before_it_measures_what_it_cannot_write(
    tmp_path: Path, pair: tuple[str, str], clip: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, message in (
        ([*pair, "-o", "a.txt"], '"a.txt", expected a name that ends in .flo'),
        ([*pair, "-o", "a.txt"], "--output: got"),
        (
            [*pair, "--picture", "a.mp4"],
            '--picture: got "a.mp4", expected a name that ends in .png, .jpg, .jpeg or .svg',
        ),
        (
            [*pair, "--picture", "a.mp4", "--style", "color"],
            '--picture: got "a.mp4", expected a name that ends in .png, .jpg or .jpeg',
        ),
        ([*pair, "--stop", "3"], "--stop: got one for two pictures, expected a source"),
        ([clip, "-o", str(tmp_path / "a.flo")], "expected a folder, since a source has a flow for each pair"),
        ([*pair, "--mask", str(tmp_path / "none.png")], "none.png: no such file or folder"),
        ([*pair, "--initial", str(tmp_path / "none.flo")], "No such file or directory"),
    ):
        assert main(["flow", *arguments]) == 1
        out, err = capsys.readouterr()
        assert message in err
        assert out == ""
    assert not (tmp_path / "a.flo").exists()


@pytest.mark.parametrize("command", ["flow", "shift", "grid"])
def test_a_pair_that_is_none_is_refused_by_the_names_of_the_files(
    tmp_path: Path,
    pair: tuple[str, str],
    clip: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    first = cv2.imread(pair[0], cv2.IMREAD_GRAYSCALE)
    cv2.imwrite("small.png", first[:60, :80])
    cv2.imwrite("deep.png", first.astype(np.uint16) * 256)
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("no picture")
    for second, message in (
        (
            "small.png",
            f"pictures of different sizes: small.png: got 80 x 60 pixels, expected 160 x 120 as {pair[0]} has",
        ),
        ("deep.png", f"pictures of different types: deep.png: got uint16, expected uint8 as {pair[0]} has"),
        (clip, f"{clip}: cannot be decoded as a picture"),
        ("none.png", "none.png: cannot be read: No such file or directory"),
        ("empty.png", "empty.png: the file is empty"),
        ("text.png", "text.png: cannot be decoded as a picture"),
        (str(tmp_path), f"{tmp_path}: got a folder, expected a regular file"),
    ):
        assert main([command, pair[0], second]) == 1
        out, err = capsys.readouterr()
        assert err.startswith(f"rsflow {command}: {message}"), err
        assert out == ""


def test_pictures_have_the_rate_that_is_given(tmp_path: Path, pair: tuple[str, str]) -> None:
    assert main(["flow", str(tmp_path / "picture*.png"), "--rate", "50", "-o", str(tmp_path), "--format", "npz"]) == 0
    assert rsflow.io.read_flow_times(tmp_path / "flow_000001.npz") == (0.0, 0.02)
    assert main(["segment", str(tmp_path / "picture*.png"), "--rate", "50", "-o", str(tmp_path / "segments")]) == 0
    capture = cv2.VideoCapture(str(tmp_path / "segments" / "moving.mp4"))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(50)


def test_flow_of_a_clip(tmp_path: Path, clip: str, capsys: pytest.CaptureFixture[str]) -> None:
    out, video = tmp_path / "flows", tmp_path / "arrows.mp4"
    assert main(["flow", clip, "-o", str(out), "--format", "npz", "--picture", str(video)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 7
    files = sorted(out.glob("[!.]*"))
    assert [f.name for f in files] == [f"flow_{k:06d}.npz" for k in range(1, 8)]
    assert rsflow.io.read_flow_times(files[2]) == pytest.approx((0.1, 0.15), abs=1e-3)
    capture = cv2.VideoCapture(str(video))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 7
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(20, rel=0.01)
    assert main(["flow", clip, "--stop", "1"]) == 1
    assert "expected at least two" in capsys.readouterr().err


def test_segment(tmp_path: Path, clip: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["segment", clip, "-o", str(out), "--camera-motion", "static", "--masks", "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["frame"] for line in lines] == list(range(8))
    assert lines[0]["status"] == "first_frame"
    assert lines[-1]["objects"]
    assert sorted(p.name for p in out.glob("[!.]*")) == [
        "masks",
        "moving.mp4",
        "objects.csv",
        "objects.json",
        "paths.svg",
        "static.mp4",
    ]
    mask = cv2.imread(str(out / "masks" / "000005.png"), cv2.IMREAD_GRAYSCALE) > 0
    truth = np.zeros_like(mask)
    truth[40:70, 45:85] = True
    assert np.count_nonzero(mask & truth) / np.count_nonzero(mask | truth) > 0.6
    for name in ("moving", "static"):
        assert cv2.VideoCapture(str(out / f"{name}.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 8
    rows = (out / "objects.csv").read_text().splitlines()
    assert rows[0].startswith("frame,t_s,id,age_frames,x_px,y_px,")
    assert main(["segment", clip, "-o", str(out / "one"), "--stop", "1"]) == 1
    assert "expected at least two" in capsys.readouterr().err


def test_segment_says_in_how_many_frames_nothing_could_be_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"blank{number}.png"), np.full((48, 64), 90, np.uint8))
    assert main(["segment", str(tmp_path / "blank*.png"), "-o", str(tmp_path / "out")]) == 0
    assert "In 2 of 3 frames what moves could not be told: " in capsys.readouterr().out


def test_convert_says_what_it_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, kind in (("", "a folder"), ("a.csv", "a name that ends in '.csv'")):
        assert main(["convert", str(tmp_path / name), "out.flo"]) == 1
        err = capsys.readouterr().err
        assert f"{tmp_path / name}: got {kind}, expected a flow file (.flo, .png" in err
        assert "or a camera file (.json" in err


def test_convert(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    uv = np.random.default_rng(3).normal(0, 4, (20, 30, 2)).astype(np.float32)
    uv[3, 4] = np.nan
    first = tmp_path / "a.npz"
    rsflow.write_flow(first, uv, t0_s=1.0, t1_s=1.5)
    for suffix in ("flo", "pfm", "npy", "npz"):
        assert main(["convert", str(first), str(tmp_path / f"b.{suffix}")]) == 0
        np.testing.assert_array_equal(rsflow.read_flow(tmp_path / f"b.{suffix}"), uv)
    assert rsflow.io.read_flow_times(tmp_path / "b.npz") == (1.0, 1.5)
    for suffix in ("png", "jpg", "svg"):
        assert main(["convert", str(first), str(tmp_path / f"b.{suffix}")]) == 0
    camera = rsflow.Camera(600, 601, 319.5, 239.5, width=640, height=480)
    camera.save(tmp_path / "cam.json")
    assert main(["convert", str(tmp_path / "cam.json"), str(tmp_path / "cam.yml")]) == 0
    assert rsflow.Camera.load(tmp_path / "cam.yml").fy == pytest.approx(601)
    assert main(["convert", str(first), str(tmp_path / "b.txt")]) == 1
    line = capsys.readouterr().err
    assert "got another format, expected .flo" in line
    assert "is a flow file" in line
    assert main(["convert", str(tmp_path / "cam.json"), str(tmp_path / "b.flo")]) == 1
    line = capsys.readouterr().err
    assert "got another format, expected .json" in line
    assert "is a camera file" in line
    assert main(["convert", str(tmp_path / "none.flo"), str(tmp_path / "b.npy")]) == 1
    assert "none.flo" in capsys.readouterr().err
