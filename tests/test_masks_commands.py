"""Masks of what is fixed to the sensor, from a file: the commands, live readings, extraction and batch leave it out."""

from __future__ import annotations

import csv
import json
import os
import signal
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from mask_scenes import SHAPE, overlay, overlay_mask
from rsflow import cli, synthetic
from rsflow.capture.masks import read_mask
from rsflow.errors import CaptureError, OptionError
from rsflow.extraction import checkpoint


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pictures of a flight under an overlay that covers 46 %, its camera, and the mask."""
    folder = tmp_path_factory.mktemp("overlay")
    (folder / "pictures").mkdir()
    keep = overlay_mask("letters", 0.46)
    flight = synthetic.flight_with_object(frames=26, height_m=0.2, velocity_m_s=(0.04, -0.015, 0.0), seed=3)
    for k, image in enumerate(flight.images):
        cv2.imwrite(str(folder / "pictures" / f"{k:03d}.png"), np.where(keep, image, overlay()))
    flight.camera.save(folder / "camera.json")
    # Dark blue is not black.
    colour = np.zeros((*SHAPE, 3), np.uint8)
    colour[keep] = (3, 0, 0)
    cv2.imwrite(str(folder / "mask.png"), colour)
    cv2.imwrite(str(folder / "small.png"), np.full((20, 30), 255, np.uint8))
    (folder / "text.png").write_text("no picture")
    return folder


@pytest.fixture
def here(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(made)
    return made


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def column(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row[name]) for row in rows[1:]])


def test_a_mask_file_is_what_is_not_black(here: Path) -> None:
    np.testing.assert_array_equal(read_mask("mask.png"), overlay_mask("letters", 0.46))
    with_alpha = np.zeros((4, 5, 4), np.uint8)
    with_alpha[..., 3] = 255
    with_alpha[1, 2, 1] = 1
    cv2.imwrite("alpha.png", with_alpha)
    assert np.argwhere(read_mask("alpha.png")).tolist() == [[1, 2]]
    with pytest.raises(CaptureError, match=r"text\.png"):
        read_mask("text.png")


METRIC = ["--camera", "camera.json", "--height", "0.2", "--height-std", "0"]


COMMANDS = {
    "velocity": ["velocity", "pictures", "--rate", "30", *METRIC],
    "track": ["track", "pictures", "--no-video"],
    "segment": ["segment", "pictures"],
    "extract": ["extract", "pictures", "--no-videos", "-q"],
    "batch": ["batch", "pictures", "--no-videos", "-q", "--jobs", "1"],
    "live": ["live", "pictures"],
    "flow": ["flow", "pictures"],
    "flow of a pair": ["flow", "pictures/000.png", "pictures/001.png"],
    "shift": ["shift", "pictures/000.png", "pictures/001.png"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_mask_file_that_does_not_fit_is_one_line(
    here: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [] if command in ("live", "shift") else ["-o", str(tmp_path / "out.flo" if "pair" in command else tmp_path)]
    for name, said in (
        ("small.png", "small.png: got 30 x 20 pixels, expected those of the "),
        ("text.png", "text.png: cannot be decoded as a picture"),
        ("none.png", "none.png: no such file or folder"),
    ):
        assert cli.main([*COMMANDS[command], *out, "--mask", name]) == 1
        printed = capsys.readouterr()
        told = printed.out if command == "batch" else printed.err
        if command == "batch":
            continue
        assert said in told
        assert told.count("\n") == 1
        assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == []


def test_the_velocity_command_leaves_the_mask_out(here: Path, tmp_path: Path) -> None:
    arguments = ["velocity", "pictures", "--rate", "30", *METRIC]
    assert cli.main([*arguments, "--mask", "mask.png", "-o", str(tmp_path / "with")]) == 0
    assert cli.main([*arguments, "-o", str(tmp_path / "without")]) == 0
    speed = {name: column(rows_of(tmp_path / name / "velocity.csv"), "vx_m_s") for name in ("with", "without")}
    assert np.abs(speed["with"] - 0.04).max() < 0.002
    assert np.nanmedian(np.abs(speed["without"] - 0.04)) > 0.02
    # Another mask is another run.
    cv2.imwrite("other.png", np.full(SHAPE, 255, np.uint8))
    assert cli.main([*arguments, "--mask", "other.png", "-o", str(tmp_path / "with")]) == 1


def test_the_track_command_leaves_the_mask_out(here: Path, tmp_path: Path) -> None:
    keep = read_mask("mask.png")
    assert cli.main(["track", "pictures", "--no-video", "--mask", "mask.png", "-o", str(tmp_path)]) == 0
    rows = [row for row in rows_of(tmp_path / "tracks.csv") if row["status"] in ("tracked", "new")]
    at = np.array([[float(row["y_px"]), float(row["x_px"])] for row in rows]).round().astype(int)
    assert len(at) > 300
    assert keep[at[:, 0], at[:, 1]].all()
    steps = [float(row["dx_px"]) for row in rows if row["status"] == "tracked"]
    assert np.median(steps) == pytest.approx(-1.2, abs=0.05)


def test_the_segment_command_leaves_the_mask_out(
    here: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keep = read_mask("mask.png")
    arguments = ["segment", "pictures", "--masks", "--json", "--mask", "mask.png", "-o", str(tmp_path)]
    assert cli.main(arguments) == 0
    moving = np.array([read_mask(path) for path in sorted((tmp_path / "masks").glob("*.png"))])
    assert moving.any()
    assert not moving[:, ~keep].any()
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[-1]["moving_share"] == pytest.approx(moving[-1].sum() / keep.sum())


def test_live_readings_leave_the_mask_out(here: Path) -> None:
    keep = read_mask("mask.png")
    roi = (8, 8, 152, 120)
    images = [frame.image for frame in rsflow.frames("pictures")]
    for mask in (keep, "mask.png"):
        readings = list(rsflow.live.readings(images, roi=roi, mask=mask))
        assert np.median([reading.dx_px for reading in readings]) == pytest.approx(-1.2, abs=0.05)
    assert abs(np.median([reading.dx_px for reading in rsflow.live.readings(images, roi=roi)])) < 0.2


@pytest.mark.parametrize("roi", [None, (8, 8, 152, 120)])
def test_an_extraction_leaves_the_mask_out(here: Path, tmp_path: Path, roi: tuple[int, int, int, int] | None) -> None:
    keep = read_mask("mask.png")
    seen: list[rsflow.extraction.Measured] = []
    options = {"camera": "camera.json", "height_m": 0.2, "height_std_m": 0.0, "frame_rate": 30, "roi": roi}
    done = rsflow.extract("pictures", tmp_path, mask="mask.png", on_frame=seen.append, **options)
    if roi is not None:
        keep = keep[8:128, 8:160]
    motion = rows_of(tmp_path / "motion.csv")
    assert np.abs(column(motion, "dx_px") + 1.2).max() < 0.1
    assert np.abs(column(motion, "flow_median_x_px") + 1.2).max() < 0.1
    assert np.abs(column(motion, "camera_dx_px") + 1.2).max() < 0.1
    assert np.abs(column(rows_of(tmp_path / "velocity.csv"), "vx_m_s") - 0.04).max() < 0.002
    for measured in seen[1:]:
        assert not measured.flow.valid[~keep].any()
        assert np.isnan(measured.flow.uv[~keep]).all()
        assert not measured.segmentation.moving[~keep].any()
        share = np.count_nonzero(measured.flow.valid) / np.count_nonzero(keep)
        assert measured.motion["flow_valid_share"] == pytest.approx(share)
        share = np.count_nonzero(measured.segmentation.moving) / np.count_nonzero(keep)
        assert measured.motion["moving_share"] == pytest.approx(share)
    assert f"{100 * (1 - keep.mean()):.1f} % of the pixels do not count" in "".join(done.summary["notes"])
    assert done.summary["settings"]["mask"] == "mask.png"
    # The overlay is not part of the scene behind it.
    behind = cv2.imread(str(tmp_path / "background.png"), cv2.IMREAD_GRAYSCALE)
    shown = overlay()[: behind.shape[0], : behind.shape[1]] if roi is None else overlay()[8:128, 8:160]
    assert np.mean(np.abs(behind.astype(int) - shown)[~keep] < 3) < 0.1
    # An array is a mask as well, and as good.
    again = rsflow.extract("pictures", tmp_path / "array", mask=read_mask("mask.png"), videos=False, **options)
    assert (again.folder / "motion.csv").read_bytes() == (tmp_path / "motion.csv").read_bytes()


def test_a_run_goes_on_with_the_same_mask_alone(here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("_EVERY_S", 0.0), ("_SHARE", 1e9), ("_GROWTH", 0.0)):
        monkeypatch.setattr(checkpoint, name, value)
    keep = read_mask("mask.png")
    other = keep.copy()
    other[0, 0] ^= True
    cv2.imwrite(str(tmp_path / "m.png"), keep * np.uint8(255))
    options = {"camera": "camera.json", "height_m": 0.2, "frame_rate": 30, "videos": False}

    def press(measured: rsflow.extraction.Measured) -> None:
        if measured.frame.index == 15:
            os.kill(os.getpid(), signal.SIGINT)

    for number, (mask, others) in enumerate(((keep, (other, None, "mask.png")), (tmp_path / "m.png", (None, other)))):
        out = tmp_path / f"out{number}"
        whole = rsflow.extract("pictures", tmp_path / f"whole{number}", mask=mask, **options)
        with pytest.raises(rsflow.ExtractionInterrupted):
            rsflow.extract("pictures", out, mask=mask, on_frame=press, **options)
        for wrong in others:
            with pytest.raises(OptionError, match="other settings"):
                rsflow.extract("pictures", out, mask=wrong, resume=True, **options)
        if number == 1:
            # The file was changed meanwhile.
            cv2.imwrite(str(tmp_path / "m.png"), other * np.uint8(255))
            with pytest.raises(OptionError, match="other settings"):
                rsflow.extract("pictures", out, mask=mask, resume=True, **options)
            cv2.imwrite(str(tmp_path / "m.png"), keep * np.uint8(255))
        rsflow.extract("pictures", out, mask=mask, resume=True, **options)
        for table in ("motion.csv", "objects.csv", "velocity.csv", "trajectory.csv"):
            assert (out / table).read_bytes() == (whole.folder / table).read_bytes(), table


def test_a_batch_takes_a_mask(here: Path, tmp_path: Path) -> None:
    arguments = ["batch", "pictures", "-o", str(tmp_path), "--no-videos", "-q", "--jobs", "1", "--mask"]
    assert cli.main([*arguments, "mask.png"]) == 0
    assert np.abs(column(rows_of(tmp_path / "pictures" / "motion.csv"), "dx_px") + 1.2).max() < 0.1


def test_an_extraction_is_not_written_over_its_mask(here: Path, tmp_path: Path) -> None:
    mask = tmp_path / "background.png"
    mask.write_bytes(Path("mask.png").read_bytes())
    with pytest.raises(OptionError, match=r"cannot write .*background\.png"):
        rsflow.extract("pictures", tmp_path, mask=mask, videos=False)
