"""``rsflow calibrate``, and calibration from a live camera."""

from __future__ import annotations

import json
import time

import cv2
import pytest

import rsflow
from calibration_helpers import BOARD, SQUARE_M, TRUTH, blank, views
from rsflow.cli import main


@pytest.fixture
def folder(tmp_path):
    for i, view in enumerate(views()):
        cv2.imwrite(str(tmp_path / f"view{i}.png"), view)
    return tmp_path


def test_the_command_writes_a_camera_and_pictures(folder, capsys):
    arguments = [
        "calibrate",
        f"{folder}/view*.png",
        "--board",
        "8x6",
        "--square",
        "0.025",
        "-o",
        f"{folder}/out/cam.yaml",
    ]
    assert main([*arguments, "--pictures", f"{folder}/pictures"]) == 0
    out = capsys.readouterr()
    assert "f is known to" in out.out
    assert "view10.png" in out.out
    assert out.err == ""
    assert rsflow.Camera.load(folder / "out" / "cam.yaml").std["fx"] > 0
    assert len(list((folder / "pictures").glob("*.png"))) == 13


def test_the_command_prints_json_and_takes_many_names(folder, capsys):
    names = [str(folder / f"view{i}.png") for i in range(5)]
    assert main(["calibrate", *names, "--board", "8X6", "--square", "0.025", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert len(data["views"]) == 5
    assert abs(data["camera"]["fx"] / TRUTH.fx - 1) < 0.01


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--board", "8x6", "--square", "0.025", "-o", "cam.txt"], 1, 'cam.txt", expected a name that ends in'),
        (["--board", "8", "--square", "0.025"], 2, "got '8', expected columns and rows"),
        (["--board", "8x6", "--square", "-1"], 2, "got '-1', expected a length in metres above 0"),
        (["--board", "8x6"], 2, "--square"),
        (["--board", "8x6", "--square", "0.025", "--max-views", "1"], 1, "--max-views: got 1"),
    ],
)
def test_the_command_says_in_one_line_what_is_wrong(tmp_path, capsys, arguments, code, message):
    cv2.imwrite(str(tmp_path / "a.png"), blank(1)[0])
    assert main(["calibrate", str(tmp_path / "a.png"), *arguments]) == code
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


class BoardCamera:
    """A made-up live camera before which the board moves from view to view."""

    def __init__(self):
        self.grabbed = 0

    def isOpened(self):  # noqa: N802
        return True

    def get(self, what):
        return {cv2.CAP_PROP_FRAME_WIDTH: TRUTH.width, cv2.CAP_PROP_FRAME_HEIGHT: TRUTH.height}.get(what, 30.0)

    def grab(self):
        time.sleep(0.02)
        self.grabbed += 1
        return True

    def retrieve(self):
        return True, views()[self.grabbed // 5 % len(views())]

    def release(self):
        pass


def test_a_live_camera_is_calibrated_with_hints_where_to_hold_the_board(monkeypatch, capsys):
    monkeypatch.setattr("rsflow.capture.live.LiveReader._opened", lambda _self: BoardCamera())
    views()
    assert main(["calibrate", "0", "--board", "8x6", "--square", "0.025", "--max-views", "5", "--json"]) == 0
    out = capsys.readouterr()
    assert sum(view["used"] for view in json.loads(out.out)["views"]) == 5
    assert "48 corners (1 views); hold the board in the " in out.err
    assert "(5 views)" in out.err


def test_ctrl_c_ends_a_live_source_that_has_shown_enough(monkeypatch):
    monkeypatch.setattr("rsflow.capture.live.LiveReader._opened", lambda _self: BoardCamera())

    def interrupt_after(count):
        def on_view(_view, usable):
            if usable == count:
                raise KeyboardInterrupt

        return on_view

    result = rsflow.calibrate(0, board=BOARD, square_size_m=SQUARE_M, on_view=interrupt_after(4))
    assert len(result.used) == 4
    with pytest.raises(KeyboardInterrupt):
        rsflow.calibrate(0, board=BOARD, square_size_m=SQUARE_M, on_view=interrupt_after(2))
    with pytest.raises(KeyboardInterrupt):
        rsflow.calibrate(list(views()), board=BOARD, square_size_m=SQUARE_M, on_view=interrupt_after(4))
