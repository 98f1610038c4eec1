"""`check_scale` against a gyro: what was done to a set-up is found, to its interval, and what cannot be told is not."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import rsflow
from rsflow import Camera, OptionError, ScaleStatus, ShapeError, synthetic
from rsflow._rotation import rotation_matrix
from scale_clips import LENS, SWAPPED, steadily_turned, turned, waves


def checked(clip, camera=None, *, change=None, **gyro):
    options = gyro.pop("options", {})
    log = synthetic.Gyro(**{"rate_hz": 200.0, "noise_rad_s": 0.005, "seed": 1, **gyro}).log(clip)
    rate = log.rate_rad_s if change is None else change(log.rate_rad_s)
    return rsflow.check_scale(clip, camera or clip.camera, t_s=log.t_s, rate_rad_s=rate, **options)


def longer(camera, factor):
    return dataclasses.replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)


def unknown(figure):
    return math.isnan(figure.value) and math.isinf(figure.std) and figure.low == -math.inf and figure.high == math.inf


def test_all_faults_at_once_are_found_and_said():
    yaw = 0.1
    clip = turned(1, readout_s=0.015)
    check = checked(
        clip,
        longer(LENS, 1.07),
        delay_s=0.041,
        bias_rad_s=(0.02, -0.01, 0.0),
        R_body_from_camera=SWAPPED @ rotation_matrix((0.0, 0.0, -yaw)),
    )
    assert check.status is ScaleStatus.CHECKED
    assert not check.ok
    assert check.axes == ("+y", "+x", "+z")
    assert check.focal_px.value == pytest.approx(150.0, rel=0.005)
    assert check.yaw_rad.value == pytest.approx(yaw, abs=0.005)
    # A tenth of a frame is 3.3 ms.
    assert check.delay_s.value == pytest.approx(0.041, abs=0.0005)
    assert check.readout_s.value == pytest.approx(0.015, abs=0.0005)
    assert check.bias_rad_s[0].value == pytest.approx(0.02, abs=0.002)
    said = "\n".join(check.findings)
    assert "x and y are swapped" in check.findings
    assert "the gyro lags by 4" in said
    assert "the focal length is 7" in said
    assert "% too long" in said
    assert "velocities come out too low" in said
    assert "(yaw)" in said
    assert "a rolling shutter" in said
    assert "the gyro has a bias: x +0.0" in said
    assert check.camera is not None
    assert check.camera.fx == pytest.approx(150.0, rel=0.005)
    assert all(text in check.report() for text in check.findings)
    # Its axes are mirrored: no rotation of a body makes them right.
    assert np.isnan(check.R_body_from_camera).all()


def test_where_nothing_is_wrong_nothing_is_found():
    check = checked(turned(2))
    assert check.ok, check.findings
    assert check.untold == ()
    assert check.axes == ("+x", "+y", "+z")
    assert "nothing wrong found" in check.report()
    assert 1.0 in check.focal_ratio
    assert check.focal_ratio.std < 0.01
    assert 0.0 in check.delay_s
    assert check.delay_s.std < 0.001
    assert np.abs(check.R_body_from_camera - np.eye(3)).max() < 0.01


def test_intervals_hold_the_truth_over_seeds():
    inside, rows = [], []
    for seed in range(10, 18):
        clip = turned(seed, readout_s=0.012, frames=50)
        check = checked(clip, longer(LENS, 0.96), delay_s=-0.02, bias_rad_s=(0.01, 0.0, -0.01), seed=seed)
        figures = (check.focal_px, check.delay_s, check.readout_s, *check.mounting_rad, *check.bias_rad_s)
        truth = (150.0, -0.02, 0.012, 0.0, 0.0, 0.0, 0.01, 0.0, -0.01)
        inside.append([true in figure for figure, true in zip(figures, truth, strict=True)])
        rows.append([figure.std for figure in figures])
    # 72 figures of which 95 % should be inside; fewer than 61 have a chance of 1e-4.
    assert np.sum(inside) >= 61, np.mean(inside, axis=0)
    assert np.median(rows, axis=0)[0] < 0.006 * 150
    assert np.median(rows, axis=0)[1] < 0.0005
    assert np.median(rows, axis=0)[2] < 0.0015


@pytest.mark.parametrize(
    ("signs", "axes", "said"),
    [
        ((1, -1, 1), ("+x", "-y", "+z"), "the sign of y is wrong"),
        ((-1, -1, 1), ("-x", "-y", "+z"), "the signs of x and y are wrong"),
        ((-1, -1, -1), ("-x", "-y", "-z"), "the signs of x, y and z are wrong"),
    ],
)
def test_signs(signs, axes, said):
    check = checked(turned(2), change=lambda rate: rate * signs)
    assert check.axes == axes
    assert check.findings == (said,)


def test_a_quarter_turn_is_told_from_a_swap():
    check = checked(turned(2), R_body_from_camera=rotation_matrix((0.0, 0.0, np.pi / 2)))
    assert check.axes == ("+y", "-x", "+z")
    assert check.findings == (
        "x and y are swapped, and the sign of x is wrong: x is +y of the log, y is -x of the log",
    )
    assert np.abs(check.R_body_from_camera - rotation_matrix((0.0, 0.0, np.pi / 2))).max() < 0.01
    # The same, as it was said to be mounted, is right.
    stated = checked(
        turned(2),
        R_body_from_camera=rotation_matrix((0.0, 0.0, np.pi / 2)),
        options={"R_body_from_camera": rotation_matrix((0.0, 0.0, np.pi / 2))},
    )
    assert stated.ok, stated.findings
    assert stated.axes == ("+x", "+y", "+z")


def test_degrees_are_told_from_radians():
    check = checked(turned(2), change=np.rad2deg)
    assert check.findings == ("the gyro's rates are in degrees a second, not in radians a second",)
    assert 1.0 in check.focal_ratio


def test_a_leading_gyro_and_a_slow_log():
    check = checked(turned(2), delay_s=-0.3, rate_hz=50.0)
    assert check.delay_s.value == pytest.approx(-0.3, abs=0.001)
    assert check.findings[0].startswith("the gyro leads by 300 ms")


def test_without_a_turn_about_x_or_y_the_focal_length_is_unknown():
    check = checked(turned(3, axes=(0.0, 0.0, 1.0)))
    assert unknown(check.focal_px)
    assert check.camera is None
    assert check.axes == ("?", "?", "+z")
    assert unknown(check.yaw_rad)
    assert any(text.startswith("the focal length:") for text in check.untold)
    assert check.findings == ()
    assert 0.0 in check.delay_s
    assert check.delay_s.std < 0.003


def test_a_turn_about_one_axis_tells_that_axis_alone():
    check = checked(turned(4, axes=(0.0, 1.0, 0.0)), change=lambda rate: -rate)
    assert check.axes == ("?", "-y", "?")
    assert check.findings == ("the sign of y is wrong",)
    assert unknown(check.mounting_rad[1])
    assert 1.0 in check.focal_ratio
    assert check.focal_ratio.std < 0.02


@pytest.mark.parametrize("rate", [(0.0, 0.4, 0.0), (0.3, 0.2, 0.0)], ids=["pan", "oblique"])
def test_at_a_steady_rate_delay_and_readout_are_unknown(rate):
    check = checked(steadily_turned(rate))
    assert unknown(check.delay_s)
    assert unknown(check.readout_s)
    assert any(text.startswith("the delay:") for text in check.untold)
    assert not check.focal_ratio.known or 1.0 in check.focal_ratio
    assert check.findings == ()


def test_an_even_swing_fits_several_delays():
    clip = synthetic.flight(
        LENS,
        frames=90,
        height_m=1.0,
        velocity_m_s=(0.0, 0.0, 0.0),
        rate_rad_s=lambda t: np.array([0.0, 0.6 * np.sin(4 * np.pi * t), 0.0]),
        seed=5,
    )
    check = checked(clip)
    assert unknown(check.delay_s)
    assert "explains it no better than" in "\n".join(check.untold)
    # Half a period later with the other sign is the same swing.
    assert check.axes == ("?", "?", "?")
    assert check.findings == ()


def test_a_camera_that_travels_is_told():
    moved = synthetic.flight(
        LENS, frames=50, height_m=1.0, velocity_m_s=(0.4, 0.1, 0.0), rate_rad_s=waves(6, 0.3, (1, 1, 1)), seed=6
    )
    check = checked(moved)
    assert check.status is ScaleStatus.NOT_TURNING
    assert unknown(check.focal_px)
    assert unknown(check.delay_s)
    assert check.findings


def test_a_gyro_of_another_clip_is_told():
    log = synthetic.Gyro(seed=1).log(turned(7))
    check = rsflow.check_scale(turned(2), LENS, t_s=log.t_s, rate_rad_s=log.rate_rad_s)
    assert check.status is ScaleStatus.NO_MATCH
    assert not check.ok
    assert unknown(check.focal_px)


def test_a_gyro_with_a_wrong_scale_is_doubted():
    # In a wide view the perspective tells the focal length as well.
    wide = synthetic.flight(
        Camera(90.0, 90.0, 79.5, 59.5, width=160, height=120),
        frames=60,
        height_m=1.0,
        velocity_m_s=(0.0, 0.0, 0.0),
        rate_rad_s=waves(2, 0.5, (1.0, 1.0, 0.0)),
        seed=2,
    )
    check = checked(wide, scale=1.06)
    assert any("the gyro's scale is off" in text for text in check.findings)
    assert 1.0 in check.focal_ratio
    assert checked(wide).ok


def test_a_lens_off_the_axis_is_told():
    # The camera's centre is 6 cm ahead of the axis that it is turned about, and sees the ground from a metre.
    arm = np.array([0.0, 0.0, 0.06])
    turning = waves(2, 0.6, (1.0, 1.0, 1.0))
    clip = synthetic.flight(
        Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240),
        frames=50,
        height_m=1.0,
        velocity_m_s=lambda t: np.cross(turning(t), arm),
        rate_rad_s=turning,
        seed=2,
    )
    check = checked(clip)
    assert any("off the axis" in text for text in check.findings)
    assert 1.0 in check.focal_ratio
    assert 0.0 in check.delay_s


def test_too_little_of_anything():
    clip = turned(2)
    still = synthetic.flight(LENS, frames=40, velocity_m_s=(0.0, 0.0, 0.0), seed=1)
    times, zero = np.arange(100) / 20 - 1, np.zeros((100, 3))
    assert rsflow.check_scale(still, LENS, t_s=times, rate_rad_s=zero).status is ScaleStatus.NO_MOTION
    assert rsflow.check_scale(list(clip)[:5], LENS, t_s=times, rate_rad_s=zero).status is ScaleStatus.TOO_FEW_FRAMES
    assert rsflow.check_scale(clip, LENS, t_s=times + 50, rate_rad_s=zero).status is ScaleStatus.NO_OVERLAP
    blank = [(np.full((120, 160), 90, np.uint8), k / 30) for k in range(40)]
    assert rsflow.check_scale(blank, LENS, t_s=times, rate_rad_s=zero).status is ScaleStatus.TOO_FEW_FRAMES


def test_rows_with_nan_and_holes_are_left_out():
    clip = turned(2)
    log = synthetic.Gyro(rate_hz=200.0, noise_rad_s=0.005, delay_s=0.03, seed=1).log(clip)
    rate = log.rate_rad_s.copy()
    rate[::17] = np.nan
    rate[150:190] = np.nan
    check = rsflow.check_scale(clip, LENS, t_s=log.t_s, rate_rad_s=rate)
    assert check.delay_s.value == pytest.approx(0.03, abs=0.001)
    assert check.status is ScaleStatus.CHECKED


def test_misuse_raises():
    clip, t = turned(2), np.arange(20) / 10
    rate = np.zeros((20, 3))
    with pytest.raises(OptionError, match=r"got none, expected one of them"):
        rsflow.check_scale(clip, LENS)
    with pytest.raises(OptionError, match=r"got rate_rad_s and distance_m, expected one"):
        rsflow.check_scale(clip, LENS, t_s=t, rate_rad_s=rate, distance_m=1.0)
    with pytest.raises(ShapeError, match=r"rate_rad_s: got shape \(20, 2\)"):
        rsflow.check_scale(clip, LENS, t_s=t, rate_rad_s=rate[:, :2])
    with pytest.raises(OptionError, match="t_s: got None, expected the times of rate_rad_s"):
        rsflow.check_scale(clip, LENS, rate_rad_s=rate)
    with pytest.raises(OptionError, match=r"t_s\[3\]: got 0 after 0.2"):
        rsflow.check_scale(clip, LENS, t_s=np.where(np.arange(20) == 3, 0, t), rate_rad_s=rate)
    with pytest.raises(OptionError, match="R_body_from_camera"):
        rsflow.check_scale(clip, LENS, t_s=t, rate_rad_s=rate, R_body_from_camera=SWAPPED)
    with pytest.raises(ShapeError, match="expected those of the camera, 320 x 240"):
        rsflow.check_scale(clip, LENS.scaled(320, 240), t_s=t, rate_rad_s=rate)
    with pytest.raises(OptionError, match="height_m: got None"):
        rsflow.check_scale(clip, LENS, distance_m=1.0)
