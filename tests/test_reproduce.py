"""The report's experiments: its figures are carried over whole, and rsflow does better in every row."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rsflow import OptionError, _extras, cli, reproduce
from rsflow.errors import MissingExtraError
from rsflow.reproduce import CONDITIONS, RealMotion, groups, implied_focal_length, real_motion, report, synthetic_motion

CONDITION = {condition.name: condition for condition in CONDITIONS}


def test_report_has_all_rows() -> None:
    assert [len(report()[name]) for name in report() if name.startswith("table")] == [39, 36, 24]
    assert report()["table_4_1_with_illumination_correction"][38] == {
        "actual_px": [10, 10], "estimated_px": [9.6542, 10.4288],
    }  # fmt: skip
    assert report()["calibration"]["focal_length_px"] == [657.64375, 658.04112]


def test_printed_velocities_follow_from_one_focal_length() -> None:
    f = implied_focal_length()
    assert len(f.rows_px) == 24
    assert f.mean_px == pytest.approx(1217.3, abs=0.05)
    assert f.spread_px < 0.05
    assert np.ptp(f.rows_px) < 0.2
    assert f.calibrated_px == pytest.approx(657.84, abs=0.01)


def test_real_motion_is_within_one_percent_in_every_row() -> None:
    rows = real_motion(frames=5, seed=1)
    assert len(rows) == 24
    assert sum(row.missed for row in rows) == 0
    for row in rows:
        assert abs(row.frame_error) < 0.01, row
        assert abs(row.window_error) < 0.01, row
        assert row.frame_worst < 0.01, row
        assert abs(row.frame_flow_px - row.true_flow_px) < 0.02, row
    # As printed in the last column: 11.28, 36.07, 13.28 and 23.14 % at 2 cm/s.
    at_two = [abs(g.report_error) for g in groups(rows) if g.actual_cm_s == 2]
    np.testing.assert_allclose(at_two, [0.1128, 0.3607, 0.1328, 0.2314], atol=1e-4)


@pytest.mark.parametrize("name", ["brighter, compensated", "steady light", "gain 0.8", "ramp 0.7 to 1.0"])
def test_displacements_without_noise_are_within_two_hundredths(name: str) -> None:
    table = synthetic_motion(reproduce.photographs(), CONDITION[name])
    assert table.measured_px.shape == (4, 39, 2)
    assert np.isfinite(table.measured_px).all()
    assert table.errors_px.max() <= 0.02


def test_noise_costs_little() -> None:
    table = synthetic_motion(reproduce.photographs(), CONDITION["brighter, noise 2 levels"])
    assert np.isfinite(table.measured_px).all()
    assert np.sqrt(np.mean(table.errors_px**2)) < 0.05


def test_without_compensation_a_brighter_picture_is_wrong_or_said_not_to_be_valid() -> None:
    good = synthetic_motion(reproduce.photographs(), CONDITION["brighter, compensated"])
    plain = synthetic_motion(reproduce.photographs(), CONDITION["brighter, not compensated"])
    known = plain.errors_px[np.isfinite(plain.errors_px)]
    assert known.size < plain.errors_px.size or known.mean() > 3 * good.errors_px.mean()
    assert plain.report_px is not None
    assert np.isnan(plain.report_px[36:]).all()
    assert np.isfinite(plain.report_px[:36]).all()


def test_textures_serve_where_there_are_no_photographs() -> None:
    table = synthetic_motion(reproduce.textures(), CONDITION["brighter, compensated"])
    assert table.errors_px.max() <= 0.02


def test_missing_scikit_image_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(module: str) -> object:
        raise ModuleNotFoundError(f"No module named {module!r}", name=module.split(".")[0])

    monkeypatch.setattr(_extras.importlib, "import_module", gone)
    with pytest.raises(MissingExtraError, match=r"the package 'skimage'.*pip install 'rsflow-motion\[reproduce\]'"):
        reproduce.photographs()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: real_motion(frames=1), "frames: got 1, expected an integer from 2"),
        (
            lambda: synthetic_motion({"tiny": np.zeros((70, 90), np.uint8)}, CONDITIONS[0]),
            r"pictures\['tiny'\]: got dtype uint8, shape \(70, 90\), expected grey uint8 of at least 81 x 81 pixels",
        ),
        (
            lambda: synthetic_motion({"deep": np.zeros((90, 90), np.uint16)}, CONDITIONS[0]),
            r"pictures\['deep'\]: got dtype uint16, shape \(90, 90\)",
        ),
    ],
)
def test_misuse(call: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        call()  # type: ignore[operator]


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole command with one flight in place of 24: the figures have their own test."""
    one = RealMotion(10, 30, 2, 6.9, 1.7, 8.1, 8.1, 1.99, 8.1, 2.0, 0.01, 0.002, 0)
    monkeypatch.setattr(reproduce, "real_motion", lambda **_: (one,))


@pytest.mark.usefixtures("short")
def test_command_prints_the_tables(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert cli.main(["reproduce", "-o", str(tmp_path / "out")]) == 0
    text = capsys.readouterr().out
    assert "photographs of scikit-image: brick, grass, gravel, camera" in text
    assert "f = 1217.3 px" in text
    assert "657.8 px at 640 x 480" in text
    assert "10, 10" in text
    assert "9.6542, 10.4288" in text
    assert (tmp_path / "out" / "reproduce.txt").read_text(encoding="utf-8") == text
    figures = json.loads((tmp_path / "out" / "reproduce.json").read_text(encoding="utf-8"))
    assert len(figures["synthetic_motion"]) == len(CONDITIONS)


@pytest.mark.usefixtures("short")
def test_command_gives_json_and_runs_without_scikit_image(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def photographs() -> dict[str, np.ndarray]:
        raise MissingExtraError("reproducing needs the package 'skimage'")

    monkeypatch.setattr(reproduce, "photographs", photographs)
    assert cli.main(["reproduce", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["pictures"].startswith("textures of rsflow, not photographs: reproducing needs")
    assert figures["implied_focal_length_px"]["mean"] == pytest.approx(1217.3, abs=0.05)
    assert figures["real_motion"][0]["report_error"] == pytest.approx(-0.15)


@pytest.mark.usefixtures("short")
def test_command_takes_pictures_of_ones_own(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    import cv2

    own = tmp_path / "floor.png"
    cv2.imwrite(str(own), reproduce.textures()["fine texture"])
    assert cli.main(["reproduce", str(own)]) == 0
    assert "pictures: floor.png" in capsys.readouterr().out
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((20, 30), np.uint8))
    assert cli.main(["reproduce", str(small)]) == 1
    assert "expected grey uint8 of at least 81 x 81 pixels" in capsys.readouterr().err
    assert cli.main(["reproduce", str(tmp_path / "none.png")]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1
