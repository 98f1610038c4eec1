"""Calibration: a known camera is recovered from rendered boards within the deviations; failures are named."""

from __future__ import annotations

import json
import math
import time

import cv2
import numpy as np
import pytest

import rsflow
from calibration_helpers import (
    BOARD,
    SQUARE_M,
    TRUTH,
    blank,
    calibration,
    chessboard,
    corners_in_camera,
    poses,
    render,
    views,
)
from rsflow.calibration import detect_process, solve
from rsflow.calibration.board import Board
from rsflow.calibration.detect import charuco_detector, find_corners
from rsflow.synthetic.boards import DOTS


def errors_in_deviations(result: rsflow.Calibration) -> dict[str, float]:
    got, std = result.camera, result.std
    values = (got.fx, got.fy, got.cx, got.cy, *got.distortion)
    true = (TRUTH.fx, TRUTH.fy, TRUTH.cx, TRUTH.cy, *TRUTH.distortion)
    return {name: (g - t) / std[name] for name, g, t in zip(std, values, true, strict=True)}


def test_a_known_camera_is_recovered_within_the_stated_deviations():
    result = calibration()
    assert len(result.used) >= 11
    off = errors_in_deviations(result)
    assert max(map(abs, off.values())) < 3.0, off
    assert abs(result.camera.fx / TRUTH.fx - 1) < 0.002
    assert result.focal_deviation < 0.002
    assert result.rms < 0.12
    assert result.camera.size == (480, 360)
    # What the parameters are for: where rays go, over the part of the picture where corners were.
    grid = np.mgrid[60:421:40, 50:311:40].reshape(2, -1).T.astype(float)
    apart = result.camera.undistort_points(grid, normalized=True) - TRUTH.undistort_points(grid, normalized=True)
    assert np.linalg.norm(apart - apart.mean(axis=0), axis=1).max() * TRUTH.fx < 0.4


def test_it_tells_what_it_found():
    result = calibration()
    assert len(result.per_view_errors) == len(result.used)
    assert np.sqrt(np.mean(np.concatenate([v.residuals for v in result.used]) ** 2 * 2)) == pytest.approx(
        result.rms, rel=1e-3
    )
    assert 0.6 < result.covered <= 1.0
    assert result.coverage(4, 3).shape == (3, 4)
    assert result.coverage().sum() == sum(len(view.corners) for view in result.used)
    text = result.summary()
    assert f"f is known to {result.focal_deviation:.2%}" in text
    assert "frame 3" in text
    data = result.to_dict()
    assert json.loads(json.dumps(data, allow_nan=False))["camera"]["fx"] == result.camera.fx
    tilts = [view.tilt_rad for view in result.used]
    assert min(tilts) > 0.25
    assert max(tilts) < 0.7


@pytest.mark.parametrize("bend", [0.0, 0.15])
def test_deviations_cover_the_errors(bend):
    """Corners with independent noise, and with an error that all corners of a view share (a board that bends)."""
    board = Board(BOARD, SQUARE_M)
    rng = np.random.default_rng(11)
    flat = board.points()
    scaled = (flat[:, :2] - flat[:, :2].mean(axis=0)) / np.ptp(flat[:, 0])
    true = np.array([TRUTH.fx, TRUTH.fy, TRUTH.cx, TRUTH.cy, *TRUTH.distortion])
    off = []
    for run in range(24):
        seen = []
        for pose in poses(10, seed=100 + run):
            rotation, translation, _ = corners_in_camera(pose, board)
            exact = cv2.projectPoints(flat, rotation, translation, TRUTH.matrix, np.array(TRUTH.distortion))[0]
            shared = bend * 4 * (scaled**2 @ rng.normal(0, 1, (2, 2)))
            seen.append((exact.reshape(-1, 2) + rng.normal(0, 0.05, (len(flat), 2)) + shared).astype(np.float32))
        solution = solve.solve([flat] * len(seen), seen, TRUTH.size, 5, False)
        off.append((solution.values - true) / solution.std)
    off = np.abs(np.array(off))
    # The board may be bent and its corners off by what is usual, and the views are few: more than 68 % and 95 % lie
    # inside, yet not by far.
    assert 0.68 < np.mean(off < 1) < 0.97, np.mean(off < 1)
    assert np.mean(off < 2) > 0.95, np.mean(off < 2)


def test_corners_beside_a_cut_square_are_set_right_and_counted_as_uncertain():
    # The paper ends a quarter of a square beyond the last corners, on one side.
    cut = [render(pose, chessboard(cut=0.75), seed=i) for i, pose in enumerate(poses(12))]
    result = rsflow.calibrate(cut, board=BOARD, square_size_m=SQUARE_M)
    repaired = sum(view.repaired for view in result.used)
    assert repaired > 5
    off = errors_in_deviations(result)
    assert max(map(abs, off.values())) < 3.0, off
    assert result.std_repair["fx"] > 0
    assert all(result.std[name] >= result.std_views[name] for name in result.std)
    assert any("were set right" in line for line in result.advice()) or result.std_repair["fx"] < result.std["fx"] / 2


def test_a_charuco_board_is_found_in_part_and_calibrates():
    board = Board((8, 6), SQUARE_M, "charuco", 0.018)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    sheet = cv2.aruco.CharucoBoard(board.size, SQUARE_M, 0.018, dictionary).generateImage((8 * DOTS, 6 * DOTS))
    images = [render(pose, sheet, first=1.0, seed=i, board=board) for i, pose in enumerate(poses(12))]
    images[0][:, :200] = 128
    result = rsflow.calibrate(images, board=board.size, square_size_m=SQUARE_M, pattern="charuco", marker_size_m=0.018)
    assert len(result.used) >= 10
    assert len(result.used[0].corners) < board.corners
    assert abs(result.camera.fx / TRUTH.fx - 1) < 0.004
    assert max(abs(value) for value in errors_in_deviations(result).values()) < 3.5


def test_pictures_of_the_corners_are_drawn(tmp_path):
    paths = calibration().draw(tmp_path / "corners")
    assert len(paths) == 13
    assert paths[-1].name == "coverage.png"
    plain = cv2.cvtColor(views()[0], cv2.COLOR_GRAY2BGR)
    drawn = cv2.imread(str(paths[0]))[-360:]
    assert drawn.shape == plain.shape
    x, y = calibration().views[0].corners[0]
    patch = np.s_[round(float(y)) - 6 : round(float(y)) + 7, round(float(x)) - 6 : round(float(x)) + 7]
    # Colour, where the picture has none.
    assert np.ptp(drawn[patch].astype(int), axis=2).max() > 60


def test_square_pixels_and_fewer_coefficients_are_held():
    result = rsflow.calibrate(
        list(views())[:6], board=BOARD, square_size_m=SQUARE_M, coefficients=4, square_pixels=True
    )
    assert result.camera.fx == result.camera.fy
    assert len(result.camera.distortion) == 4
    assert result.std["fx"] == result.std["fy"] > 0
    assert any("add views: 6 were used" in line for line in result.advice())


def test_other_depths_are_searched_too():
    deep = [view.astype(np.uint16) * 16 for view in views()[:4]]
    assert len(rsflow.calibrate(deep, board=BOARD, square_size_m=SQUARE_M).used) == 4
    floats = [view.astype(np.float32) / 255 for view in views()[:4]]
    assert len(rsflow.calibrate(floats, board=BOARD, square_size_m=SQUARE_M).used) == 4


def test_of_a_video_only_views_that_differ_are_used(tmp_path, monkeypatch):
    writer = cv2.VideoWriter(str(tmp_path / "b.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, TRUTH.size)
    for view in views()[:6]:
        for _ in range(3):
            writer.write(cv2.cvtColor(view, cv2.COLOR_GRAY2BGR))
    writer.release()
    result = rsflow.calibrate(tmp_path / "b.avi", board=BOARD, square_size_m=SQUARE_M)
    assert len(result.used) == 6
    assert set(result.rejected.values()) == {"shows the board where an earlier view does"}
    assert "frame 1 " in result.summary()
    monkeypatch.setattr("rsflow.calibration.report._LISTED", 3)
    assert "12 others: shows the board where an earlier view does" in result.summary()
    few = rsflow.calibrate(tmp_path / "b.avi", board=BOARD, square_size_m=SQUARE_M, max_views=4)
    assert len(few.used) == 4
    seen = []
    rsflow.calibrate(
        list(views()),
        board=BOARD,
        square_size_m=SQUARE_M,
        on_view=lambda view, usable: bool(seen.append(view)) or usable == 3,
    )
    assert len(seen) == 3


def test_a_board_that_is_never_found_is_an_error_that_says_what_was_tried():
    with pytest.raises(rsflow.CalibrationError, match=r"8 x 6 inner corners was found in 0 of 4 .*no board found in 4"):
        rsflow.calibrate(blank(), board=BOARD, square_size_m=SQUARE_M)
    with pytest.raises(rsflow.CalibrationError, match=r"in 2 of 4 pictures, expected at least 3: no board found in 2"):
        rsflow.calibrate([*views()[:2], *[np.full_like(views()[0], 99)] * 2], board=BOARD, square_size_m=SQUARE_M)
    with pytest.raises(rsflow.CalibrationError, match=r"squares \(ChArUco\) was found in 0 of 2"):
        rsflow.calibrate(blank(2), board=BOARD, square_size_m=SQUARE_M, pattern="charuco")


def test_squares_counted_instead_of_corners_are_noticed():
    with pytest.raises(rsflow.CalibrationError, match="8 x 6 inner corners is there: count corners, not squares"):
        rsflow.calibrate(list(views()[:1]), board=(9, 7), square_size_m=SQUARE_M)


def test_views_that_do_not_determine_a_camera_are_an_error():
    # A board that is never tilted: nothing tells focal length from distance.
    places = [(0.0, 0.0, 0.4), (-0.05, 0.04, 0.33), (0.05, -0.04, 0.3), (0.03, 0.03, 0.37)]
    frontal = [render((np.zeros(3), np.array(place)), chessboard()) for place in places]
    message = (
        r"the views do not determine a camera: the board's normals in 4 views lie within \d\.\d degrees .* tilt the"
    )
    with pytest.raises(rsflow.CalibrationError, match=message):
        rsflow.calibrate(frontal, board=BOARD, square_size_m=SQUARE_M)
    with pytest.raises(rsflow.CalibrationError, match=r"in 1 of 4 pictures.* where an earlier view does in 3"):
        rsflow.calibrate([views()[0]] * 4, board=BOARD, square_size_m=SQUARE_M)


def test_a_focal_length_with_too_large_a_deviation_is_an_error(monkeypatch):
    monkeypatch.setattr("rsflow.calibration.solve.UNDETERMINED", 1e-6)
    message = r"the 4 views do not .* length: got \d+\.\d \+- \d+\.\d px; the board's normals .* add views"
    with pytest.raises(rsflow.CalibrationError, match=message):
        rsflow.calibrate(list(views()[:4]), board=BOARD, square_size_m=SQUARE_M)


def test_a_search_without_end_is_stopped():
    """A picture full of squares keeps the search busy for many seconds: it is stopped, and the next is searched."""
    busy = np.kron(np.random.default_rng(2).integers(0, 2, (360, 360), np.uint8) * 200, np.ones((8, 8), np.uint8))
    with detect_process.Searcher() as searcher:
        # The process starts before the clock does.
        assert searcher.find(views()[0], Board(BOARD, SQUARE_M), 20.0) is not None
        begin = time.monotonic()
        with pytest.raises(detect_process.SearchTimeoutError, match=r"the search took longer than 0\.3 s"):
            searcher.find(busy, Board(BOARD, SQUARE_M), 0.3)
        assert time.monotonic() - begin < 1.5
        assert searcher.find(views()[0], Board(BOARD, SQUARE_M), 20.0) is not None
    begin = time.monotonic()
    with pytest.raises(rsflow.CalibrationError, match=r"took longer .* in \d.*not looked at: the time budget"):
        rsflow.calibrate([busy] * 12, board=BOARD, square_size_m=SQUARE_M, time_budget_s=1.5, view_time_budget_s=0.4)
    assert time.monotonic() - begin < 12.0


def test_a_search_that_dies_is_an_error(monkeypatch):
    monkeypatch.setattr(detect_process.sys, "executable", "/bin/false")
    with pytest.raises(rsflow.CalibrationError, match="the process that searches for boards cannot run: /bin/false"):
        rsflow.calibrate(blank(), board=BOARD, square_size_m=SQUARE_M)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"board": (2, 6)}, r"board: got \(2, 6\), expected \(columns, rows\), integers from 3 to 200"),
        ({"board": 7}, r"board: got 7, expected \(columns, rows\)"),
        ({"square_size_m": 0.0}, r"square_size_m: got 0\.0"),
        ({"pattern": "circles"}, 'pattern: got "circles", expected "chessboard" or "charuco"'),
        ({"pattern": "charuco", "marker_size_m": 1.0}, r"marker_size_m: got 1\.0, expected less than the square's"),
        ({"pattern": "charuco", "dictionary": "DICT_9"}, 'dictionary: got "DICT_9"'),
        ({"coefficients": 3}, "coefficients: got 3, expected 0, 4, 5, 8 or 12 for the model 'pinhole'"),
        ({"coefficients": 5, "model": "fisheye"}, "coefficients: got 5, expected 0 or 4 for the model 'fisheye'"),
        ({"model": "mirror"}, 'model: got "mirror", expected "pinhole" or "fisheye"'),
        ({"time_budget_s": 0.0}, r"time_budget_s: got 0\.0"),
        ({"view_time_budget_s": math.inf}, "view_time_budget_s: got inf"),
        ({"max_views": 2}, "max_views: got 2, expected an integer of at least 3"),
    ],
)
def test_options_outside_of_their_range_are_refused(options, message):
    with pytest.raises(rsflow.OptionError, match=message):
        rsflow.calibrate(blank(1), **({"board": BOARD, "square_size_m": SQUARE_M} | options))


def test_pictures_of_different_sizes_are_refused():
    with pytest.raises(rsflow.ShapeError, match="pictures of different sizes"):
        rsflow.calibrate([*blank(1), np.zeros((10, 10), np.uint8)], board=BOARD, square_size_m=SQUARE_M)


def test_a_large_picture_is_searched_small_and_refined_at_full_size():
    large = cv2.resize(views()[1], None, fx=4.0, fy=4.0, interpolation=cv2.INTER_CUBIC)
    board = Board(BOARD, SQUARE_M)
    at_full, at_small = find_corners(large, board), find_corners(views()[1], board)
    assert np.abs((at_full.points + 0.5) / 4 - 0.5 - at_small.points).max() < 0.25
    assert charuco_detector(Board((5, 4), 0.03, "charuco")) is not None
