"""Velocity where it cannot be measured, where a call is misused, and what holds for any input."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from rsflow import Camera, DTypeError, OptionError, ShapeError, Velocity, VelocityEstimator, VelocityStatus
from rsflow.synthetic import Sensor, VehiclePart, dirt, flight, tiled_floor
from velocity_helpers import QUIET, WIDE, vector, velocities


def unmeasured(v: Velocity, status: VelocityStatus) -> None:
    assert v.status is status, v
    assert not v.valid
    assert np.isnan(vector(v)).all()
    assert np.isinf(np.diag(v.covariance)).all()


def test_statuses() -> None:
    f = flight(frames=3, velocity_m_s=(0.05, 0.0, 0.0), sensor=QUIET, seed=17)
    other = flight(frames=1, sensor=QUIET, kind="fine", seed=990).images[0]
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    unmeasured(estimator.update(f.images[0], 0.0), VelocityStatus.FIRST_FRAME)
    unmeasured(estimator.update(f.images[1], 0.0), VelocityStatus.TIME_NOT_INCREASING)
    unmeasured(estimator.update(f.images[2], -1.0), VelocityStatus.TIME_NOT_INCREASING)
    unmeasured(estimator.update(other, 1.0), VelocityStatus.SCENE_CUT)
    flat = np.full_like(other, 90)
    assert estimator.update(flat, 2.0).status in (VelocityStatus.SCENE_CUT, VelocityStatus.TOO_FEW_POINTS)
    unmeasured(estimator.update(flat, 3.0), VelocityStatus.NO_TEXTURE)
    # After all that it measures again.
    estimator.update(f.images[0], 4.0)
    assert estimator.update(f.images[1], 4.0 + 1 / 30).valid


def test_flat_noise_has_no_texture_to_follow() -> None:
    rng = np.random.default_rng(18)
    camera = flight(frames=1).camera
    estimator = VelocityEstimator(camera, height_m=0.2)
    noise = [np.clip(np.rint(100 + 2 * rng.standard_normal((144, 176))), 0, 255).astype(np.uint8) for _ in range(3)]
    found = [estimator.update(image, 0.1 * k) for k, image in enumerate(noise)][1:]
    assert not any(v.valid for v in found)


def test_without_a_height_the_flow_is_still_measured() -> None:
    f = flight(frames=3, velocity_m_s=(0.05, 0.0, 0.0), sensor=QUIET, seed=19)
    estimator = VelocityEstimator(f.camera)
    estimator.update(f.images[0], 0.0)
    v = estimator.update(f.images[1], float(f.t_s[1]))
    unmeasured(v, VelocityStatus.NO_HEIGHT)
    assert v.flow_px == pytest.approx(0.05 * 180 / 0.2 / 30, rel=0.02)
    assert estimator.update(f.images[2], float(f.t_s[2]), height_m=0.2).valid
    unmeasured(estimator.update(f.images[1], 9.0, height_m=float("nan")), VelocityStatus.NO_HEIGHT)


def test_camera_that_looks_along_the_ground_sees_none() -> None:
    f = flight(frames=2, velocity_m_s=(0.05, 0.0, 0.0), sensor=QUIET, seed=20)
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    estimator.update(f.images[0], 0.0)
    unmeasured(estimator.update(f.images[1], float(f.t_s[1]), down=(0.0, 0.0, -1.0)), VelocityStatus.NO_GROUND)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"height_m": 0.0}, "height_m: got 0.0, expected a finite number of metres"),
        ({"height_m": float("nan")}, "height_m: got NaN"),
        ({"rate_std_rad_s": float("nan")}, "rate_std_rad_s: got NaN, expected a finite number of rad/s from 0"),
        ({"height_std_m": -1.0}, "height_std_m: got -1.0, expected a finite number of metres from 0"),
        ({"R_body_from_camera": np.eye(2)}, r"R_body_from_camera: got shape \(2, 2\), expected a rotation"),
        ({"R_body_from_camera": np.diag([1, 1, -1])}, "determinant 1"),
        ({"lever_arm_m": (1.0, 2.0)}, r"lever_arm_m: got shape \(2,\), expected three finite numbers"),
    ],
)
def test_misuse_of_the_estimator(options: dict[str, object], message: str) -> None:
    with pytest.raises((OptionError, ShapeError), match=message):
        VelocityEstimator(WIDE, **options)  # type: ignore[arg-type]


def test_misuse_of_update() -> None:
    with pytest.raises(DTypeError, match=r'camera: got "cam\.yaml", expected an rsflow\.Camera'):
        VelocityEstimator("cam.yaml")  # type: ignore[arg-type]
    estimator = VelocityEstimator(WIDE, height_m=0.2)
    image = np.zeros((120, 160), np.uint8)
    with pytest.raises(
        OptionError, match="t_s: got nan, expected a finite number of seconds; pictures of a folder carry no times"
    ):
        estimator.update(image, float("nan"))
    with pytest.raises(OptionError, match="height_m, range_m: got both"):
        estimator.update(image, 0.0, height_m=1.0, range_m=1.0)
    with pytest.raises(OptionError, match=r"height_m: got -1\.0"):
        estimator.update(image, 0.0, height_m=-1.0)
    with pytest.raises(ShapeError, match=r"rate_rad_s: got shape \(2,\), expected three numbers"):
        estimator.update(image, 0.0, rate_rad_s=(0, 0))
    with pytest.raises(DTypeError, match="down: got"):
        estimator.update(image, 0.0, down=("a", "b", "c"))
    with pytest.raises(
        ShapeError, match=r"image: got 80 x 60 pixels, expected the camera's 160 x 120; use camera.scaled\(80, 60\)"
    ):
        estimator.update(np.zeros((60, 80), np.uint8), 0.0)
    with pytest.raises(ShapeError, match=r"image: got colour, shape \(120, 160, 3\), expected grey \(height, width\)"):
        estimator.update(np.zeros((120, 160, 3), np.uint8), 0.0)
    with pytest.raises(DTypeError, match="image: got dtype float64, expected uint8, uint16 or float32"):
        estimator.update(np.zeros((120, 160)), 0.0)
    with pytest.raises(DTypeError, match="image: got list, expected a numpy array"):
        estimator.update([[0]], 0.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (3, 3), (9, 7), (400, 2)])
def test_tiny_pictures_are_no_crash(size: tuple[int, int]) -> None:
    width, height = size
    camera = Camera(50.0, 50.0, 0.0, 0.0, width=width, height=height)
    rng = np.random.default_rng(22)
    for dtype in (np.uint8, np.float32):
        estimator = VelocityEstimator(camera, height_m=1.0)
        for k in range(3):
            v = estimator.update(rng.integers(0, 255, (height, width)).astype(dtype), float(k))
        assert not v.valid
        assert np.isnan(vector(v)).all()


def test_pixels_that_are_nan_are_left_out() -> None:
    f = flight(frames=2, velocity_m_s=(0.08, 0.0, 0.0), sensor=Sensor(noise=0.5, dtype="float32"), seed=23)
    images = f.images.copy()
    images[:, 30:60, 40:90] = np.nan
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    estimator.update(images[0], 0.0)
    assert estimator.update(images[1], float(f.t_s[1])).vx_m_s == pytest.approx(0.08, rel=0.01)
    estimator.update(np.full_like(images[0], np.nan), 1.0)
    assert not estimator.update(np.full_like(images[0], np.nan), 2.0).valid


def test_velocity_is_proportional_to_the_height_and_odd_in_time() -> None:
    f = flight(frames=2, velocity_m_s=(0.07, -0.04, 0.0), sensor=QUIET, seed=24)
    found = {}
    for name, height, order in (("plain", 0.2, (0, 1)), ("twice", 0.4, (0, 1)), ("back", 0.2, (1, 0))):
        estimator = VelocityEstimator(f.camera, height_m=height)
        for t, k in enumerate(order):
            found[name] = estimator.update(f.images[k], float(t))
    np.testing.assert_allclose(vector(found["twice"]), 2 * vector(found["plain"]), rtol=1e-9)
    np.testing.assert_allclose(found["twice"].covariance, 4 * found["plain"].covariance, rtol=1e-9)
    np.testing.assert_allclose(vector(found["back"])[:2], -vector(found["plain"])[:2], atol=0.001 * 0.2)


def test_same_pictures_give_the_same_bits_for_any_number_of_threads() -> None:
    import rsflow

    f = flight(frames=3, velocity_m_s=(0.07, -0.04, 0.1), sensor=QUIET, seed=25)
    found = []
    before = rsflow.get_num_threads()
    try:
        for threads in (1, 2, 7):
            rsflow.set_num_threads(threads)
            found.append([(*vector(v), *v.covariance.ravel()) for v in velocities(f)])
    finally:
        rsflow.set_num_threads(before)
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("value", [np.nan, np.inf, 3e38])
@pytest.mark.parametrize("speed_m_s", [0.05, 0.0])
def test_pixels_that_are_no_numbers_cost_no_more_than_themselves(value: float, speed_m_s: float) -> None:
    """They neither raise, nor warn, nor change what the rest of the picture says."""
    f = flight(frames=4, velocity_m_s=(speed_m_s, 0.0, 0.0), seed=21)
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        for image, t_s in zip(f.images, f.t_s, strict=True):
            broken = image.astype(np.float32)
            broken[30, 40], broken[90, 120] = value, -value
            v = estimator.update(broken, float(t_s))
    assert v.valid
    assert abs(v.vx_m_s - speed_m_s) < 4 * np.sqrt(v.covariance[0, 0])


def test_a_broken_pixel_does_not_hide_that_dirt_stands_before_moving_ground() -> None:
    f = flight(frames=8, velocity_m_s=(0.05, 0.02, 0.0), contrast_levels=2.0, lighting=dirt(0.5, seed=1), seed=2)
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    found = []
    for image, t_s in zip(f.images, f.t_s, strict=True):
        broken = image.astype(np.float32)
        broken[3, 4] = np.nan
        found.append(estimator.update(broken, float(t_s)))
    # Two changes are needed to tell.
    assert all(v.status is VelocityStatus.NO_TEXTURE for v in found[2:])


@pytest.mark.parametrize("dt_s", [1e-12, 1e-160, 1e-300])
def test_frames_of_one_time_in_all_but_name(dt_s: float) -> None:
    f = flight(frames=3, velocity_m_s=(0.05, 0.0, 0.0), seed=22)
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    estimator.update(f.images[0], 0.0)
    for k in (1, 2):
        unmeasured(estimator.update(f.images[k], k * dt_s), VelocityStatus.TIME_NOT_INCREASING)


@pytest.mark.parametrize("share", [0.55, 0.6, 0.65])
@pytest.mark.parametrize("side", ["bottom", "left"])
def test_a_vehicle_on_most_of_the_picture_is_no_standstill(share: float, side: str) -> None:
    """What moves on the rest of the picture keeps the vehicle's own standstill from being the answer."""
    truth = np.array([0.3, -0.12, 0.0])
    for seed in range(3):
        part = VehiclePart(share, side=side, seed=seed)  # type: ignore[arg-type]
        f = flight(WIDE, frames=5, height_m=0.6, velocity_m_s=tuple(truth), lighting=part, seed=seed)
        estimator = VelocityEstimator(f.camera, height_m=0.6)
        for image, t_s in zip(f.images, f.t_s, strict=True):
            v = estimator.update(image, float(t_s))
            if v.valid:
                assert (np.abs(vector(v) - truth) < 5 * np.sqrt(np.diag(v.covariance))).all(), (seed, v)


def test_what_passes_on_a_fifth_of_the_picture_leaves_a_camera_standing() -> None:
    ground = flight(WIDE, frames=5, height_m=0.6, velocity_m_s=(0.0, 0.0, 0.0), seed=1)
    passing = flight(WIDE, frames=5, height_m=0.6, velocity_m_s=(0.15, 0.06, 0.0), seed=2)
    estimator = VelocityEstimator(WIDE, height_m=0.6)
    width = WIDE.width // 5
    found = []
    for image, other, t_s in zip(ground.images, passing.images, ground.t_s, strict=True):
        seen = image.copy()
        seen[:, width : 2 * width] = other[:, width : 2 * width]
        found.append(estimator.update(seen, float(t_s)))
    assert all(v.valid for v in found[1:])
    assert max(v.speed_m_s for v in found[1:]) < 0.005


def test_tiles_on_which_only_an_assumed_speed_decides_are_told() -> None:
    """At nine tenths of a tile a frame the picture moves as at a tenth back: one of both is faster than is likely."""
    f = flight(
        frames=5,
        rate_hz=60,
        height_m=0.6,
        velocity_m_s=(0.9 * 36 * 0.6 / 180 * 60, 0.0, 0.0),
        ground=tiled_floor(36, seed=2),
        seed=1,
    )
    estimator = VelocityEstimator(f.camera, height_m=0.6)
    found = [estimator.update(image, float(t_s)) for image, t_s in zip(f.images, f.t_s, strict=True)][1:]
    copied = copy.deepcopy(estimator).update(f.images[3], 1.0)
    for v in [*found, copied]:
        assert not v.valid or any("the ground repeats: a motion of 11 heights" in doubt for doubt in v.doubts)
    assert any(v.valid for v in found)
    slow = VelocityEstimator(f.camera, height_m=0.6, max_speed_m_s=2.0)
    assert not any(slow.update(image, float(t_s)).doubts for image, t_s in zip(f.images, f.t_s, strict=True))


def test_where_the_pictures_carried_straight_down_to_the_horizon_a_new_scene_is_level_again() -> None:
    """Nobody tells an attitude: a camera is seen to turn away from the ground, and another scene follows."""
    truth = np.array([0.1, 0.0, 0.0])
    camera = Camera(300, 300, 159.5, 119.5, width=320, height=240)
    known = {"height_m": 0.6, "rate_hz": 60}
    away = flight(camera, frames=26, velocity_m_s=(0.0, 0.0, 0.0), rate_rad_s=(0.0, 8.0, 0.0), seed=5, **known)  # type: ignore[arg-type]
    level = flight(camera, frames=8, velocity_m_s=tuple(truth), seed=6, **known)  # type: ignore[arg-type]
    estimator = VelocityEstimator(camera, height_m=0.6)
    found = [estimator.update(image, float(t_s)) for image, t_s in zip(away.images, away.t_s, strict=True)]
    # There is an attitude that says so only where somebody told one.
    assert all(v.status is not VelocityStatus.NO_GROUND for v in found)
    found = [estimator.update(image, 10 + float(t_s)) for image, t_s in zip(level.images, level.t_s, strict=True)]
    unmeasured(found[0], VelocityStatus.SCENE_CUT)
    for v in found[1:]:
        assert v.valid
        assert (np.abs(vector(v) - truth) < 5 * np.sqrt(np.diag(v.covariance))).all(), v


def test_times_that_jitter_are_noticed_at_the_third_interval() -> None:
    f = flight(frames=8, rate_hz=60, velocity_m_s=(0.1, -0.05, 0.0), seed=23)
    estimator = VelocityEstimator(f.camera, height_m=0.2)
    told = f.t_s + 0.003 * (-1.0) ** np.arange(8)
    found = [estimator.update(image, float(t_s)) for image, t_s in zip(f.images, told, strict=True)]
    for v in found[3:]:
        assert any("jitter" in doubt for doubt in v.doubts)
        assert (np.abs(vector(v) - (0.1, -0.05, 0.0)) < 5 * np.sqrt(np.diag(v.covariance))).all(), v
    estimator.reset()
    steady = [estimator.update(image, float(t_s)) for image, t_s in zip(f.images, f.t_s, strict=True)]
    assert not any(v.doubts for v in steady)
