"""Velocity from pictures against flights with exact truth: signs, accuracy, light, covariance."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from rsflow import Camera, VelocityEstimator
from rsflow.synthetic import MovingObject, Sensor, auto_exposure, flight, flight_with_object, ramp
from velocity_helpers import QUIET, WIDE, errors, vector, velocities


@pytest.mark.parametrize(
    ("velocity", "sign"),
    [
        ((0.05, 0.0, 0.0), (-1, 0)),
        ((-0.05, 0.0, 0.0), (1, 0)),
        ((0.0, 0.05, 0.0), (0, -1)),
        ((0.0, -0.05, 0.0), (0, 1)),
    ],
)
def test_sign_camera_to_the_right_picture_to_the_left(velocity: tuple[float, ...], sign: tuple[int, int]) -> None:
    f = flight(frames=2, velocity_m_s=velocity, sensor=QUIET, seed=1)
    v = velocities(f)[0]
    assert np.sign(np.round(vector(v)[:2], 3)).tolist() == np.sign(velocity[:2]).tolist()
    assert np.sign(np.round([v.dx_px, v.dy_px], 1)).tolist() == list(sign)
    assert v.flow_px == pytest.approx(0.05 * 180 / 0.2 / 30, rel=0.01)


@pytest.mark.parametrize("rate_hz", [30.0, 15.0])
@pytest.mark.parametrize("height", [0.1, 0.2])
def test_webcam_flight_is_within_one_percent(height: float, rate_hz: float) -> None:
    f = flight(frames=6, rate_hz=rate_hz, height_m=height, velocity_m_s=(0.1, -0.06, 0.0), exposure_s=0.005,
               exposure_drift=auto_exposure(0.15, period_s=1.0), seed=2)  # fmt: skip
    error = errors(f, velocities(f, height_m=height))
    assert np.linalg.norm(error[:, :2], axis=1).max() < 0.01 * np.hypot(0.1, 0.06)


def test_displacement_of_a_third_of_the_picture() -> None:
    # 0.6 m/s * 180 px / 0.2 m / 10 Hz is 54 px of 176.
    f = flight(frames=3, rate_hz=10.0, velocity_m_s=(0.6, 0.0, 0.0), sensor=QUIET, seed=3)
    assert np.abs(errors(f, velocities(f))[:, :2]).max() < 0.002 * 0.6


def test_distorted_lens_and_principal_point_off_the_middle() -> None:
    f = flight(WIDE, frames=4, velocity_m_s=(0.12, 0.08, 0.0), sensor=QUIET, seed=4)
    assert np.abs(errors(f, velocities(f))[:, :2]).max() < 0.003 * 0.12
    # Without the lens model the same pictures give a speed that is off by more, or none.
    plain = Camera(WIDE.fx, WIDE.fy, WIDE.cx, WIDE.cy, width=160, height=120)
    estimator = VelocityEstimator(plain, height_m=0.2)
    wrong = [estimator.update(frame.image, frame.t_s) for frame in f][1:]
    # Or the tiles say that no plane moves like that.
    assert not wrong[0].valid or np.hypot(wrong[0].vx_m_s - 0.12, wrong[0].vy_m_s - 0.08) > 0.02 * 0.14


def test_climb_and_descent_with_a_height_per_frame() -> None:
    for vz in (0.4, -0.4):
        f = flight(frames=5, velocity_m_s=(0.05, 0.02, vz), sensor=QUIET, seed=5)
        error = errors(f, velocities(f, height=True))
        assert np.abs(error[:, :2]).max() < 0.01 * 0.05
        assert np.abs(error[:, 2]).max() < 0.02 * 0.4


def test_gyro_takes_rotation_off_each_point() -> None:
    f = flight(WIDE, frames=4, velocity_m_s=(0.1, -0.05, 0.0), rate_rad_s=(0.5, -0.4, 0.8), sensor=QUIET, seed=6)
    with_rate = errors(f, velocities(f, rate=True, down=True, height=True))
    assert np.abs(with_rate[:, :2]).max() < 0.01 * 0.1
    # Without the rate, roll and pitch are solved for, and what the field of view leaves of them is in the covariance.
    estimator = VelocityEstimator(f.camera)
    without = [estimator.update(fr.image, fr.t_s, height_m=h) for fr, h in zip(f, f.height_m, strict=True)][1:]
    assert np.abs(errors(f, without)[:, :2]).max() < 0.03 * 0.1
    deviations = np.array([np.sqrt(np.diag(v.covariance)) for v in without])
    assert (np.abs(errors(f, without)) < 4 * deviations).all()
    for v, truth in zip(without, f.rate_rad_s[1:], strict=True):
        np.testing.assert_allclose(v.rate_rad_s, truth, atol=4 * float(np.sqrt(v.rate_covariance.max())))


def test_gyro_seeds_a_large_motion_under_a_turn() -> None:
    # 40 px of travel while the picture turns by 4 degrees about its axis and rolls by 9 px, of 160 pixels.
    f = flight(WIDE, frames=5, velocity_m_s=(1.4, 0.8, 0.0), rate_rad_s=(1.0, -1.0, 2.0), sensor=QUIET, seed=21)
    found = velocities(f, rate=True, down=True, height=True)
    assert np.abs(errors(f, found)[:, :2]).max() < 0.01 * 1.6


def test_yaw_without_a_gyro_is_found() -> None:
    f = flight(frames=3, velocity_m_s=(0.1, 0.0, 0.0), rate_rad_s=(0.0, 0.0, 1.0), sensor=QUIET, seed=7)
    found = velocities(f)
    assert np.abs(errors(f, found)[:, :2]).max() < 0.01 * 0.1
    assert all("yaw" in v.terms for v in found)
    assert found[0].yaw_rate_rad_s == pytest.approx(1.0, abs=0.02)


def test_tilt_needs_down() -> None:
    f = flight(frames=3, velocity_m_s=(0.1, 0.05, 0.02), tilt_rad=(0.25, -0.2), sensor=QUIET, seed=8)
    error = errors(f, velocities(f, down=True, height=True))
    assert np.abs(error).max() < 0.02 * 0.1


def test_range_along_the_axis_equals_the_height_it_stands_for() -> None:
    f = flight(frames=2, velocity_m_s=(0.1, 0.05, 0.0), tilt_rad=(0.25, -0.2), sensor=QUIET, seed=8)
    found = []
    for key, value in (("height_m", f.height_m), ("range_m", f.height_m / f.down[:, 2])):
        estimator = VelocityEstimator(f.camera)
        for k, frame in enumerate(f):
            v = estimator.update(frame.image, frame.t_s, down=f.down[k], **{key: float(value[k])})
        found.append(vector(v))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)


def test_body_frame_and_lever_arm() -> None:
    # A camera whose x axis points to the body's y and whose y axis to the body's -x, looking along the body's z.
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    f = flight(frames=2, velocity_m_s=(0.1, 0.04, 0.0), rate_rad_s=(0.0, 0.0, 0.6), sensor=QUIET, seed=9)
    estimator = VelocityEstimator(f.camera, height_m=0.2, R_body_from_camera=R, lever_arm_m=(0.5, 0.0, 0.0))
    estimator.update(f.images[0], f.t_s[0])
    v = estimator.update(f.images[1], f.t_s[1], rate_rad_s=R @ f.rate_rad_s[1])
    np.testing.assert_allclose(vector(v)[:2], (R @ f.velocity_m_s[1])[:2], atol=1e-3)
    # A turn of 0.6 rad/s about z moves a camera half a metre ahead by 0.3 m/s along the body's y.
    np.testing.assert_allclose(v.origin_velocity_m_s - vector(v), (0.0, -0.3, 0.0), atol=1.5e-3)
    np.testing.assert_allclose(v.origin_velocity_m_s - vector(v), -np.cross(v.rate_rad_s, (0.5, 0.0, 0.0)), atol=1e-12)
    estimator.reset()
    estimator.update(f.images[0], f.t_s[0])
    # Nobody tells the turn: it is seen.
    seen = estimator.update(f.images[1], f.t_s[1])
    np.testing.assert_allclose(seen.origin_velocity_m_s - vector(seen), (0.0, -0.3, 0.0), atol=3e-3)


def test_light_that_changes_does_not_matter() -> None:
    f = flight(frames=4, velocity_m_s=(0.08, 0.0, 0.0), lighting=ramp(0.7, 1.2), sensor=Sensor(noise=1.0),
               exposure_drift=auto_exposure(0.25, period_s=0.4), seed=10)  # fmt: skip
    assert np.abs(errors(f, velocities(f))[:, :2]).max() < 0.01 * 0.08


def test_object_that_moves_does_not_matter() -> None:
    thing = MovingObject(center_m=(0.0, 0.0), size_m=(0.09, 0.09), velocity_m_s=(-0.1, 0.2), shape="rectangle")
    f = flight_with_object(frames=4, objects=[thing], velocity_m_s=(0.08, 0.0, 0.0), sensor=QUIET, seed=11)
    assert (f.masks[0] == 1).mean() > 0.2
    assert np.abs(errors(f, velocities(f))[:, :2]).max() < 0.01 * 0.08


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_all_grey_types(dtype: str) -> None:
    f = flight(frames=2, velocity_m_s=(0.08, 0.0, 0.0), sensor=Sensor(noise=0.5, dtype=dtype), seed=12)
    assert abs(velocities(f)[0].vx_m_s - 0.08) < 0.005 * 0.08


def test_frame_is_copied() -> None:
    f = flight(frames=2, velocity_m_s=(0.08, 0.0, 0.0), sensor=QUIET, seed=13)
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    buffer = f.images[0].copy()
    estimator.update(buffer, 0.0)
    buffer[:] = f.images[1]
    assert estimator.update(buffer, float(f.t_s[1])).vx_m_s == pytest.approx(0.08, rel=0.01)


# What it is worth.


def test_covariance_covers() -> None:
    """Normalised errors of 150 intervals, 3 axes: 60 to 76 % inside one sigma, 90 to 99 % inside two."""
    normalised = []
    rng = np.random.default_rng(14)
    for seed in range(30):
        f = flight(
            frames=6, kind=("ground", "fine", "noise")[seed % 3], velocity_m_s=(*rng.uniform(-0.1, 0.1, 2), 0.0),
            sensor=Sensor(noise=float(rng.uniform(1.0, 4.0)), blur_px=0.5), seed=100 + seed,
        )  # fmt: skip
        found = velocities(f, rate=True, rate_std_rad_s=0.0, down=True)
        deviations = np.array([np.sqrt(np.diag(v.covariance)) for v in found])
        normalised.append(errors(f, found) / deviations)
    z = np.abs(np.concatenate(normalised))
    inside = [(z < limit).mean(axis=0).round(3).tolist() for limit in (1, 2)]
    assert 0.60 <= (z < 1).mean() <= 0.76, inside
    assert 0.90 <= (z < 2).mean() <= 0.99, inside
    # Each axis has a third of the samples: the limits are wider by two standard errors of a share.
    assert all(0.52 <= share <= 0.84 for share in inside[0]), inside
    assert all(share >= 0.86 for share in inside[1]), inside


def test_height_and_focal_length_enter_the_covariance() -> None:
    f = flight(frames=2, velocity_m_s=(0.08, -0.06, 0.0), sensor=QUIET, seed=15)
    plain = velocities(f)[0]
    tall = velocities(f, height_std_m=0.004)[0]
    speed = np.hypot(tall.vx_m_s, tall.vy_m_s)
    along = np.array([tall.vx_m_s, tall.vy_m_s]) / speed
    # 0.004 of 0.2 m is 2 % of the speed.
    added = tall.covariance - plain.covariance
    assert np.sqrt(along @ added[:2, :2] @ along) / speed == pytest.approx(0.02, rel=1e-6)
    np.testing.assert_allclose(added, tall.parts["height"], atol=1e-15)
    known = Camera(180.0, 180.0, 87.5, 71.5, width=176, height=144, std={"fx": 1.8, "fy": 3.6})
    estimator = VelocityEstimator(known, height_m=0.2)
    estimator.update(f.images[0], 0.0)
    v = estimator.update(f.images[1], float(f.t_s[1]))
    focal = np.sqrt(np.diag(v.parts["focal length"]))
    np.testing.assert_allclose(focal[:2], [0.01 * abs(v.vx_m_s), 0.02 * abs(v.vy_m_s)], rtol=0.03)
    budget = v.budget(dt_std_s=0.001)
    words = [line.split()[0] for line in budget.splitlines()]
    assert sorted(words) == [
        "displacement",
        "focal",
        "height",
        "principal",
        "rotation",
        "speed",
        "time",
        "total",
    ]
    assert "time            3.00 %" in budget
    assert estimator.update(f.images[1], 0.0).budget() == "no velocity: time not increasing"


def test_what_is_not_stated_is_said_to_be_unknown_and_zero_is_exact() -> None:
    f = flight(frames=2, velocity_m_s=(0.08, -0.06, 0.0), sensor=QUIET, seed=15)
    plain = velocities(f)[0]
    assert plain.unstated == ("height", "focal length", "principal point")
    assert np.isfinite(plain.covariance).all()
    assert "height          not stated" in plain.budget()
    assert re.search(r"^total +unknown: [01]\.\d\d %, and what is not stated$", plain.budget(), re.M)
    exact = velocities(f, height_std_m=0.0)[0]
    assert exact.unstated == ("focal length", "principal point")
    np.testing.assert_array_equal(exact.covariance, plain.covariance)
    # How exact rates are is learned where nobody says.
    assert "gyro" not in velocities(f, rate=True)[0].unstated
    assert "gyro" in velocities(f, rate=True)[0].parts
    # A camera that is known, and a height that is: then there is a total.
    known = dataclasses.replace(f.camera, std={"fx": 0.0, "fy": 0.0, "cx": 0.0, "cy": 0.0})
    estimator = VelocityEstimator(known, height_m=0.2, height_std_m=0.01)
    v = [estimator.update(frame.image, frame.t_s) for frame in f][-1]
    assert v.unstated == ()
    assert "total           5.0" in v.budget()


def test_noise_of_the_gyro_enters_the_covariance() -> None:
    """A wrong turn is the height times the rate, or what the pictures leave of it; the covariance still covers."""
    std = 0.05
    f = flight(frames=2, velocity_m_s=(0.08, -0.06, 0.0), sensor=QUIET, seed=15)
    (v,) = velocities(f, rate=True, rate_std_rad_s=std)
    assert set(v.parts) == {"displacement", "gyro"}
    # Off the axis a turn moves the picture by 1 + x^2 of that in the middle: 1.06 on average over this view.
    flat = np.sqrt(np.diag(v.covariance))[:2]
    assert (flat < 1.05 * 0.2 * std).all()
    (exact,) = velocities(f, rate=True, rate_std_rad_s=0.0)
    assert (flat > 5 * np.sqrt(np.diag(exact.covariance))[:2]).all()
    assert "gyro" in v.budget()
    assert "gyro" not in velocities(f, rate_std_rad_s=std)[0].parts
    rng = np.random.default_rng(23)
    normalised = []
    for seed in range(8):
        f = flight(
            WIDE, frames=6, velocity_m_s=(*rng.uniform(-0.1, 0.1, 2), 0.0), rate_rad_s=rng.uniform(-0.4, 0.4, 3),
            sensor=QUIET, seed=300 + seed,
        )  # fmt: skip
        estimator = VelocityEstimator(f.camera, height_m=float(f.height_m[0]), rate_std_rad_s=std)
        for k, frame in enumerate(f):
            rate = None if k == 0 else f.rate_rad_s[k] + rng.normal(0, std, 3)
            v = estimator.update(frame.image, frame.t_s, down=f.down[k], rate_rad_s=rate)
            if k > 0:
                normalised.append((vector(v) - f.velocity_m_s[k])[:2] / np.sqrt(np.diag(v.covariance))[:2])
    z = np.abs(normalised)
    # 80 samples: limits of two standard errors around 68 and 95 %.
    assert 0.57 <= (z < 1).mean() <= 0.79, (z < 1).mean()
    assert (z < 2).mean() >= 0.90, (z < 2).mean()


def test_standing_still_is_measured_not_assumed() -> None:
    f = flight(frames=4, velocity_m_s=(0.0, 0.0, 0.0), sensor=Sensor(noise=2.0), seed=16)
    for v in velocities(f):
        assert v.valid
        assert 0 < np.hypot(v.vx_m_s, v.vy_m_s) < 5 * np.sqrt(np.trace(v.covariance[:2, :2]))
        assert np.isfinite(v.covariance).all()
