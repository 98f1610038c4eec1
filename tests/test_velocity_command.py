"""``rsflow velocity``, its table, its heights and its plot."""

from __future__ import annotations

import csv
import dataclasses
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from rsflow import FormatError, OptionError, _extras, cli
from rsflow.synthetic import Flight, flight
from rsflow.velocity import COLUMNS, Heights, plot_velocity

RATE = 20.0


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Flight]:
    """A folder with pictures of a flight that climbs, and its camera."""
    folder = tmp_path_factory.mktemp("flight")
    f = flight(frames=5, rate_hz=RATE, velocity_m_s=(0.06, -0.03, -0.2), seed=3)
    for k, image in enumerate(f.images):
        cv2.imwrite(str(folder / f"{k:03d}.png"), image)
    f.camera.save(folder / "cam.json")
    for name, keys in (("t_s", f.t_s), ("frame", range(5))):
        rows = [f"{key},{h}" for key, h in zip(keys, f.height_m, strict=True)]
        (folder / f"by_{name}.csv").write_text("\n".join([f"{name},height_m", *rows]) + "\n", encoding="utf-8")
    return folder, f


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("by", ["t_s", "frame"])
def test_writes_table_and_plot(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str], by: str
) -> None:
    folder, f = flown
    out = tmp_path / "out"
    arguments = ["velocity", str(folder / "*.png"), "--rate", str(RATE), "--camera", str(folder / "cam.json")]
    assert cli.main([*arguments, "--height-csv", str(folder / f"by_{by}.csv"), "-o", str(out)]) == 0
    printed = capsys.readouterr()
    assert "4 of 5 frames measured (1 first frame)" in printed.out
    assert printed.err == ""
    rows = table(out / "velocity.csv")
    assert tuple(rows[0]) == COLUMNS
    assert (rows[0]["status"], rows[0]["vx_m_s"], rows[0]["vx_std_m_s"]) == ("first_frame", "nan", "inf")
    for row, height in zip(rows[1:], f.height_m[1:], strict=True):
        assert row["status"] == "ok"
        assert float(row["vx_m_s"]) == pytest.approx(0.06, abs=0.0006)
        assert float(row["vy_m_s"]) == pytest.approx(-0.03, abs=0.0006)
        assert float(row["vz_m_s"]) == pytest.approx(-0.2, abs=0.005)
        assert float(row["height_m"]) == pytest.approx(height, abs=1e-6)
    picture = cv2.imread(str(out / "velocity.png"))
    assert picture is not None
    assert picture.shape[0] > 500
    assert picture.std() > 10


def test_json_summary(flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, _ = flown
    arguments = ["velocity", str(folder / "*.png"), "--rate", "20", "--camera", str(folder / "cam.json")]
    assert cli.main([*arguments, "--height", "0.2", "--json", "--stop", "3", "-o", str(tmp_path)]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["frames"], summary["measured"], summary["status"]) == (3, 2, {"first_frame": 1, "ok": 2})
    assert summary["csv"] == str(tmp_path / "velocity.csv")
    assert summary["mean_vx_m_s"] == pytest.approx(0.06, rel=0.1)
    assert summary["std_without"] == ["height", "focal length", "principal point"]
    unstated = "deviations of the height, focal length and principal point not stated"
    assert any(unstated in note for note in summary["notes"])
    assert table(tmp_path / "velocity.csv")[1]["std_without"] == "height+focal_length+principal_point"


def test_a_height_without_a_deviation_is_not_called_exact(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, f = flown
    dataclasses.replace(f.camera, std=dict.fromkeys(("fx", "fy", "cx", "cy"), 0.0)).save(tmp_path / "cam.json")
    arguments = ["velocity", str(folder / "*.png"), "--rate", "20", "--camera", str(tmp_path / "cam.json")]
    arguments += ["--height", "0.2", "--stop", "3", "-o", str(tmp_path), "--overwrite"]
    assert cli.main(arguments) == 0
    printed = capsys.readouterr().out
    assert "height          not stated" in printed
    assert "total           unknown" in printed
    assert "note: deviation of the height not stated: velocities are only as exact as the height" in printed
    for std, height in (("0", False), ("0.01", True)):
        assert cli.main([*arguments, "--height-std", std]) == 0
        printed = capsys.readouterr().out
        assert re.search(r"total +\d", printed)
        assert ("height          5.00 %" in printed) == height
        assert "not stated" not in printed
    assert table(tmp_path / "velocity.csv")[1]["std_without"] == ""


def test_camera_is_scaled_to_pictures_of_the_same_proportions(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, f = flown
    f.camera.scaled(352, 288).save(tmp_path / "large.json")
    f.camera.cropped((0, 0, 176, 100)).save(tmp_path / "other.json")
    arguments = ["velocity", str(folder / "*.png"), "--rate", "20", "--height-csv", str(folder / "by_frame.csv")]
    arguments += ["--overwrite"]
    assert cli.main([*arguments, "--camera", str(tmp_path / "large.json"), "-o", str(tmp_path)]) == 0
    assert float(table(tmp_path / "velocity.csv")[1]["vx_m_s"]) == pytest.approx(0.06, abs=0.0006)
    assert "The camera, calibrated at 352 x 288 pixels, was scaled to 176 x 144." in capsys.readouterr().out
    assert cli.main([*arguments, "--camera", str(tmp_path / "other.json"), "-o", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "camera: got one that is calibrated at 176 x 100 pixels, expected the shape of " in error
    assert "176 x 144, which cannot be this camera's uncropped picture" in error
    assert len(error.splitlines()) == 1
    # One row less is a crop, not a picture resized.
    f.camera.cropped((0, 0, 176, 143)).save(tmp_path / "row.json")
    assert cli.main([*arguments, "--camera", str(tmp_path / "row.json"), "-o", str(tmp_path)]) == 1


def test_pictures_without_times_ask_for_the_rate(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = flown
    arguments = ["velocity", str(folder / "*.png"), "--camera", str(folder / "cam.json"), "--height", "0.2"]
    assert cli.main([*arguments, "-o", str(tmp_path)]) == 1
    assert "--rate 30 on the command line" in capsys.readouterr().err
    assert not (tmp_path / "velocity.csv").exists()


def test_without_matplotlib_the_table_is_written(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _ = flown
    real = _extras.importlib.import_module

    def gone(module: str) -> object:
        if module.startswith("matplotlib"):
            raise ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")
        return real(module)

    monkeypatch.setattr(_extras.importlib, "import_module", gone)
    arguments = ["velocity", str(folder / "*.png"), "--rate", "20", "--camera", str(folder / "cam.json")]
    assert cli.main([*arguments, "--height", "0.2", "-o", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    assert "no velocity.png: drawing the velocity needs the package 'matplotlib'" in printed.err
    assert "pip install 'rsflow-motion[plot]'" in printed.err
    assert len(table(tmp_path / "velocity.csv")) == 5
    assert not (tmp_path / "velocity.png").exists()
    assert (tmp_path / "velocity.svg").read_text().startswith("<svg xmlns=")


def test_ctrl_c_keeps_what_is_measured(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _ = flown
    from rsflow.velocity import VelocityEstimator

    real, calls = VelocityEstimator.update, []

    def update(self: VelocityEstimator, *args: object, **named: object) -> object:
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return real(self, *args, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(VelocityEstimator, "update", update)
    arguments = ["velocity", str(folder / "*.png"), "--rate", "20", "--camera", str(folder / "cam.json")]
    assert cli.main([*arguments, "--height", "0.2", "-o", str(tmp_path)]) == 130
    assert "interrupted after 3 frames" in capsys.readouterr().err
    assert len(table(tmp_path / "velocity.csv")) == 3


def test_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["velocity", "clip.mp4", "--camera", "cam.yaml"]) == 2
    assert "one of the arguments --height --height-csv --range-csv is required" in capsys.readouterr().err
    assert cli.main(["velocity", "clip.mp4", "--camera", "cam.yaml", "--height", "1", "--height-csv", "h.csv"]) == 2
    capsys.readouterr()
    assert cli.main(["velocity", "no.mp4", "--camera", "no-cam.yaml", "--height", "1"]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_output_that_cannot_be_written_is_said_before_the_work(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = flown
    (tmp_path / "file").write_text("not a folder", encoding="utf-8")
    arguments = ["velocity", str(folder / "*.png"), "--frame-rate", "20", "--camera", str(folder / "cam.json")]
    assert cli.main([*arguments, "--height", "0.2", "-o", str(tmp_path / "file")]) == 1
    error = capsys.readouterr().err
    assert str(tmp_path / "file") in error
    assert len(error.splitlines()) == 1


def test_heights_between_and_outside(tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_text("\ufefft_s,note,height_m\n0,a,1.0\n\n2,b,2.0\n3,c,\n", encoding="utf-8")
    heights = Heights.read(path)
    assert heights.by == "t_s"
    assert [heights.at(frame=0, t_s=t) for t in (-0.0009, 0.0, 0.5, 2.0)] == [1.0, 1.0, 1.25, 2.0]
    assert all(np.isnan(heights.at(frame=0, t_s=t)) for t in (-0.1, 2.5, 3.5))
    path.write_text("frame,height_m\n3,0.5\n5,0.6\n", encoding="utf-8")
    heights = Heights.read(path)
    assert heights.at(frame=5, t_s=0.0) == 0.6
    assert np.isnan(heights.at(frame=4, t_s=0.0))
    assert np.isnan(heights.at(frame=6, t_s=0.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "got an empty file, expected height_m or range_m and one of t_s, t_ms"),
        (
            "time,height_m\n0,1\n",
            "columns time, height_m, expected height_m or range_m and one of t_s, t_ms",
        ),
        ("t_s,height_m\n", "no row after the header"),
        ("t_s,height_m\n0,tall\n", "row 2: got 'tall', expected a number for height_m"),
        ("t_s,height_m\n0,1\n,1\n", "row 3: got '', expected a time in seconds"),
        ("t_s,height_m\n1,1\n1,1\n", "row 3: t_s: got 1 after 1, expected strictly increasing times"),
        ("t_s,height_m\n1,1\n2,-1\n", "row 3: height_m is -1, expected metres above 0"),
        ("t_s,height_m\n1,inf\n", "row 2: height_m is inf"),
    ],
)
def test_bad_heights_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "h.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FormatError, match=message):
        Heights.read(path)
    with pytest.raises(FormatError, match=r"h\.csv"):
        Heights.read(path)


def test_heights_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_bytes(b"\xff\xfe\x00\x81t_s")
    with pytest.raises(FormatError, match="not a text file in UTF-8"):
        Heights.read(path)
    with pytest.raises(OSError, match=r"none\.csv"):
        Heights.read(tmp_path / "none.csv")


def test_plot_of_nothing(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="rows: got none"):
        plot_velocity(tmp_path / "v.png", [])


def test_a_source_that_breaks_off_keeps_what_was_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pictures of which the fourth has another size: the three before are in the table."""
    f = flight(frames=4, height_m=0.2, velocity_m_s=(0.02, 0.0, 0.0))
    for number, frame in enumerate(f):
        cv2.imwrite(str(tmp_path / f"{number}.png"), frame.image[: -20 if number == 3 else None])
    f.camera.save(tmp_path / "camera.json")
    out = tmp_path / "out"
    command = f"velocity {tmp_path}/*.png --camera {tmp_path}/camera.json --height 0.2 --rate 30".split()
    assert cli.main([*command, "-o", str(out)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "pictures of different sizes" in line
    assert line.endswith("velocity.csv has the 3 frames before")
    assert len((out / "velocity.csv").read_text().splitlines()) == 4


@pytest.mark.parametrize(
    ("table", "has", "code"),
    [
        ("t_s,height_m\n10,0.2\n20,0.2\n", "times from 10 to 20 s", 1),
        ("frame,height_m\n0,0.2\n2,0.2\n", "2 frames from 0 to 2, each by its own row", 0),
    ],
)
def test_frames_without_a_height_say_what_the_table_has(
    table: str, has: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    f = flight(frames=3, height_m=0.2, velocity_m_s=(0.02, 0.0, 0.0))
    for number, frame in enumerate(f):
        cv2.imwrite(str(tmp_path / f"{number}.png"), frame.image)
    f.camera.save(tmp_path / "camera.json")
    (tmp_path / "heights.csv").write_text(table)
    command = f"velocity {tmp_path}/*.png --camera {tmp_path}/camera.json --height-csv {tmp_path}/heights.csv --rate 30"
    assert cli.main([*command.split(), "-o", str(tmp_path / "out")]) == code
    err = capsys.readouterr().err
    assert re.search(rf"heights\.csv (has|with) {re.escape(has)}", err)
