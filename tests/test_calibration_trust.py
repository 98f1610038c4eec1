"""What a calibration calls certain: its deviations cover the truth, and what cannot be known is refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

import rsflow
from calibration_helpers import BOARD as SEEN_BOARD
from calibration_helpers import SQUARE_M, TRUTH, chessboard, render, views
from calibration_sets import BOARD, SIZE, MadeSet, made_camera, made_poses, made_set, seen
from rsflow.calibration import lens_doubts, multi_start, solve
from rsflow.cli import main


def solved(made: MadeSet, coefficients: int, model: str = "pinhole") -> solve.Solution:
    return solve.solve(made.boards, made.corners, made.camera.size, coefficients, False, model=model)


def outcome(made: MadeSet, coefficients: int, model: str = "pinhole") -> solve.Solution | str:
    """Give the solution, or why there is none."""
    try:
        return solved(made, coefficients, model)
    except rsflow.CalibrationError as error:
        return str(error)


@pytest.mark.parametrize(
    ("model", "coefficients", "count"), [("pinhole", 5, 18), ("pinhole", 8, 5), ("pinhole", 12, 5), ("fisheye", 4, 12)]
)
def test_deviations_cover_the_truth_and_only_what_is_not_known_is_refused(model, coefficients, count):
    off = []
    for seed in range(5000, 5000 + count):
        made = made_set(seed, model=model)
        solution = outcome(made, coefficients, model)
        if isinstance(solution, str):
            assert re.search(r"normals in \d+ views lie within \d+\.\d degrees of each other; it takes more", solution)
            # What is good and ordinary is never refused.
            assert made.tilt_deg < 10 or len(made.corners) < 8, (made.tilt_deg, len(made.corners), solution)
            continue
        assert made.tilt_deg > 1.5, "hardly tilted, yet accepted"
        off.append(np.abs(solution.values - made.truth(coefficients)) / solution.std)
    off = np.array(off)
    assert len(off) > 0.6 * count
    assert np.mean(off < 1) > 0.68, np.mean(off < 1, axis=0)
    assert np.mean(off < 2) > 0.95, np.mean(off < 2, axis=0)
    assert off.max() < 5, off.max(axis=0)
    # Deviations that cover everything say nothing.
    assert np.median(off) > 0.2


def test_tilt_is_what_tells_the_focal_length():
    shares = [solved(made_set(7, tilt_deg=tilt, count=12), 5) for tilt in (8.0, 20.0, 40.0)]
    relative = [float(solution.std[0] / solution.values[0]) for solution in shares]
    assert relative[0] > 2 * relative[1] > 2 * relative[2], relative
    assert relative[2] < 0.005


def test_nearly_parallel_views_are_refused_with_what_was_measured_and_what_is_needed():
    rng = np.random.default_rng(3)
    images = []
    for number in range(12):
        axis, tilt = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(0, 0.3))
        distance = rng.uniform(0.3, 0.45)
        place = np.array([(number % 3 - 1) * 0.1 * distance, (number // 3 % 3 - 1) * 0.08 * distance, distance])
        pose = tilt * np.array([math.cos(axis), math.sin(axis), 0.0]), place
        images.append(render(pose, chessboard(), seed=number))
    with pytest.raises(rsflow.CalibrationError) as error:
        rsflow.calibrate(images, board=SEEN_BOARD, square_size_m=SQUARE_M)
    said = re.search(r"in 12 views lie within (\d+\.\d) degrees of each other; it takes more than 2", str(error.value))
    assert said
    assert float(said[1]) < 4.0
    assert "tilt the board by 20 to 45 degrees, in different directions" in str(error.value)


def test_starts_that_end_apart_with_sums_as_good_are_refused():
    made = made_set(11, tilt_deg=30.0, count=8)
    solution = solved(made, 5)
    ends = multi_start.ends(solution.problem)
    assert len(ends) >= 4
    focals = [end.camera[0] for end in ends]
    assert np.ptp(focals) < 1e-3 * focals[0]
    std = float(solution.std[0])
    solve._agree(ends, solution.found, std, solution.span_rad)
    ends[1].camera[0] *= 1.3
    with pytest.raises(rsflow.CalibrationError, match=r"focal lengths from \d+ to \d+ px explain them equally well"):
        solve._agree(ends, solution.found, std, solution.span_rad)


def test_every_number_of_coefficients_calibrates():
    results = {
        count: rsflow.calibrate(list(views()), board=SEEN_BOARD, square_size_m=SQUARE_M, coefficients=count)
        for count in (0, 4, 5, 8, 12)
    }
    for count, result in results.items():
        assert len(result.camera.distortion) == count
        assert result.covariance.shape == (4 + count, 4 + count)
        np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), list(result.std.values()))
        assert abs(result.camera.fx - TRUTH.fx) < 3 * result.std["fx"], count
        if count:
            assert result.doubts == ()
            assert result.rms < 0.12
            # Whatever single terms are worth, where rays go is known.
            grid = np.mgrid[100:381:40, 80:281:40].reshape(2, -1).T.astype(float)
            apart = result.camera.undistort_points(grid, normalized=True) - TRUTH.undistort_points(
                grid, normalized=True
            )
            assert np.linalg.norm(apart - apart.mean(axis=0), axis=1).max() * TRUTH.fx < 0.5
    # Without any the lens does not fit: that is said, and the deviation includes what it does to f.
    assert "the lens needs more terms: with coefficients=5" in results[0].doubts[0]
    assert results[0].doubts[0] in results[0].advice()
    assert results[0].std_model["fx"] > 10 * results[5].std["fx"]


def fisheye_views(count: int) -> tuple[rsflow.Camera, list[np.ndarray]]:
    camera = rsflow.Camera(
        122.0, 122.6, 158.3, 121.2, width=320, height=240, model="fisheye", distortion=(0.03, -0.004, 0.001, 0.0)
    )
    return camera, list(rsflow.synthetic.chessboard_views(camera, count=count, seed=2))


def test_a_fisheye_lens_is_calibrated_reported_and_written(tmp_path, capsys):
    true, images = fisheye_views(10)
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"v{number}.png"), image)
    arguments = ["calibrate", f"{tmp_path}/v*.png", "--board", "8x6", "--square", "0.025", "--model", "fisheye"]
    for name in ("cam.json", "cam.yaml", "cam.yml"):
        assert main([*arguments, "-o", str(tmp_path / name)]) == 0
        again = rsflow.Camera.load(tmp_path / name)
        assert again.model == "fisheye"
        for axis in ("fx", "fy", "cx", "cy"):
            assert abs(getattr(again, axis) - getattr(true, axis)) < 1.0
    printed = capsys.readouterr().out
    assert re.search(r"camera 320 x 240, fisheye, (9|10) of 10 views used", printed)
    assert re.search(r"^k4 ", printed, re.M)
    result = rsflow.calibrate(images, board=(8, 6), square_size_m=0.025, model="fisheye")
    assert result.doubts == ()
    off = [
        abs(getattr(result.camera, axis) - getattr(true, axis)) / result.std[axis] for axis in ("fx", "fy", "cx", "cy")
    ]
    assert max(off) < 3, off
    assert result.covariance.shape == (8, 8)


def test_a_pinhole_model_on_a_fisheye_lens_is_told():
    for seed in (50, 51, 53):
        found = outcome(made_set(seed, model="fisheye", tilt_deg=35.0, count=10), 5)
        said = found if isinstance(found, str) else lens_doubts.doubts(found.problem, found.found).said[0]
        assert "fisheye" in said
    _, images = fisheye_views(8)
    result = rsflow.calibrate(images, board=(8, 6), square_size_m=0.025, coefficients=4)
    assert 'the residuals look like those of a fisheye lens: with model="fisheye"' in result.doubts[0]
    assert result.doubts[0] in result.summary()


def test_motion_while_rows_are_read_is_told_and_noise_is_not():
    for amount, told in ((0.0, False), (0.004, True)):
        rng = np.random.default_rng(5)
        camera = made_camera(rng, "pinhole")
        points, corners = BOARD.points().astype(float), []
        for rotation, translation in made_poses(rng, camera, 12, 35.0):
            turn, move = rng.normal(0, amount, 3), rng.normal(0, amount, 3) * translation[2]
            pixels = seen(camera, (rotation, translation), points)
            for _ in range(3):
                when = pixels[:, 1] / SIZE[1] - 0.5
                turned = [
                    cv2.Rodrigues(turn * t)[0] @ rotation @ point + translation + t * move
                    for t, point in zip(when, points, strict=True)
                ]
                at = np.array(turned)
                pixels = camera.distort_points(at[:, :2] / at[:, 2:], normalized=True)
            corners.append((pixels + rng.normal(0, 0.06, pixels.shape)).astype(np.float32))
        solution = solved(MadeSet(camera, corners, 35.0, 0.06), 5)
        said = lens_doubts.doubts(solution.problem, solution.found).said
        assert any("rolling shutter" in line for line in said) is told, said


@pytest.mark.parametrize(("seed", "zoom"), [(1, 1.15), (1, 1.4), (2, 1.4), (3, 1.15)])
def test_views_of_two_zooms_are_told(seed: int, zoom: float):
    rng = np.random.default_rng(seed)
    camera = made_camera(rng, "pinhole")
    zoomed = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom)
    points, corners = BOARD.points().astype(float), []
    for place, pose in enumerate(made_poses(rng, zoomed, 12, 35.0)):
        pixels = seen(zoomed if place % 2 else camera, pose, points)
        corners.append((pixels + rng.normal(0, 0.06, pixels.shape)).astype(np.float32))
    solution = solved(MadeSet(camera, corners, 35.0, 0.06), 5)
    said = lens_doubts._zoomed(solution.problem, solution.found)
    assert "the focal length differs from view to view" in said
    assert not any("rolling" in line for line in lens_doubts.doubts(solution.problem, solution.found).said)


def test_a_trend_along_the_radius_is_told():
    made = made_set(21, tilt_deg=35.0, count=12, perfect=True)
    solution = solved(made, 5)
    assert lens_doubts._radial(solution.problem, solution.found) == ""
    away = solution.problem.seen - solution.found.camera[2:4]
    radius = np.linalg.norm(away, axis=-1, keepdims=True)
    wave = 0.2 * np.sin(radius / 20) * away / np.maximum(radius, 1.0)
    corners = [(seen_in + wave[i]).astype(np.float32) for i, seen_in in enumerate(made.corners)]
    solution = solved(MadeSet(made.camera, corners, 35.0, 0.1), 5)
    assert "trend along the radius" in lens_doubts._radial(solution.problem, solution.found)


def test_corners_that_lie_off_hardly_move_the_camera():
    made = made_set(31, tilt_deg=35.0, count=10, perfect=True)
    plain = solved(made, 5)
    rng = np.random.default_rng(1)
    corners = [part.copy() for part in made.corners]
    for part in corners:
        part[rng.integers(0, len(part))] += rng.normal(0, 4, 2).astype(np.float32)
    moved = solved(MadeSet(made.camera, corners, 35.0, 0.1), 5)
    assert (np.abs(moved.values - plain.values)[:4] < 1.5 * plain.std[:4]).all()
    assert moved.sigma < 1.5 * plain.sigma


def test_of_many_corners_some_are_taken_and_all_are_told(monkeypatch):
    made = made_set(33, tilt_deg=35.0, count=8, perfect=True)
    full = solved(made, 5)
    monkeypatch.setattr(solve, "MOST_CORNERS", 200)
    monkeypatch.setattr(multi_start, "_START_CORNERS", 100)
    some = solved(made, 5)
    assert [len(part) for part in some.residuals] == [BOARD.corners] * 8
    assert (np.abs(some.values - full.values) < 3 * some.std).all()
    assert some.std[0] > full.std[0]
    assert some.rms < 1.5 * full.rms
    np.testing.assert_allclose(solve.again(full, made.corners)[:4], full.values[:4], atol=0.02)
