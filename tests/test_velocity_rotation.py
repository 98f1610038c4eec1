"""What a velocity estimator knows of the rotation: from a gyro, from straight down, or from the pictures alone."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from rsflow import Camera, Velocity, VelocityEstimator, synthetic
from rsflow import VelocityStatus as Status
from rsflow.synthetic import Flight, Gyro

CAMERA = Camera(150.0, 150.0, 79.5, 59.5, width=160, height=120, distortion=(-0.25, 0.06, 0.0, 0.0, 0.0))
BIAS = (0.03, -0.03, 0.02)


@cache
def swaying() -> Flight:
    """Two seconds, with rates that change as a delay shows itself."""
    return synthetic.flight(
        CAMERA, frames=121, rate_hz=60.0, height_m=0.6, velocity_m_s=(0.8, -0.3, 0.0), seed=3,
        rate_rad_s=lambda t: (0.8 * math.sin(9 * t), 0.6 * math.cos(7 * t), 0.4 * math.sin(5 * t)),
    )  # fmt: skip


@cache
def turning() -> Flight:
    """A short flight whose roll, pitch and yaw are large."""
    return synthetic.flight(
        CAMERA, frames=14, rate_hz=30.0, height_m=0.6, velocity_m_s=(0.3, -0.1, 0.0), tilt_rad=(0.1, -0.1), seed=5,
        rate_rad_s=lambda t: (0.9 * math.sin(9 * t), 0.7 * math.cos(7 * t), 0.5),
    )  # fmt: skip


def flown(f: Flight, *, rates: np.ndarray | None = None, down: bool = True, **options: object) -> tuple[
    VelocityEstimator, list[Velocity]
]:  # fmt: skip
    estimator = VelocityEstimator(f.camera, height_std_m=0.0, **options)  # type: ignore[arg-type]
    found = []
    for k in range(len(f)):
        known: dict[str, object] = {"height_m": f.height_m[k]}
        if rates is not None and k:
            known["rate_rad_s"] = rates[k]
        if down:
            known["down"] = f.down[k]
        found.append(estimator.update(f.images[k], f.t_s[k], **known))  # type: ignore[arg-type]
    return estimator, found


def shares(f: Flight, found: list[Velocity]) -> np.ndarray:
    """Errors over the ground, as shares of the speed, of all but the first frame."""
    error = [(v.vx_m_s - t[0], v.vy_m_s - t[1]) for v, t in zip(found[1:], f.velocity_m_s[1:], strict=True)]
    return np.hypot(*np.array(error).T) / np.hypot(*f.velocity_m_s[1:, :2].T)


@pytest.mark.parametrize(
    ("gyro", "uncorrected"),
    [
        (Gyro(delay_s=0.02), 0.10),
        (Gyro(delay_s=0.005), 0.03),
        (Gyro(bias_rad_s=BIAS), 0.02),
        (Gyro(delay_s=0.01, bias_rad_s=BIAS), 0.05),
        (Gyro(noise_rad_s=0.03, seed=4), 0.0),
    ],
    ids=["20 ms late", "5 ms late", "biased", "late and biased", "noisy"],
)
def test_bias_and_delay_of_a_gyro_are_learned_in_two_seconds(gyro: Gyro, uncorrected: float) -> None:
    f = swaying()
    estimator, found = flown(f, rates=gyro.log(f).between(f.t_s))
    state = estimator.gyro
    # What is to be added to its rates is what it shows too much, with the other sign.
    assert np.abs((state.bias_rad_s + gyro.bias_rad_s) / state.bias_std_rad_s).max() < 4.5
    assert abs(state.delay_s - gyro.delay_s) < 4.5 * state.delay_std_s
    # Deviations that say something: of what was not known to 0.05 rad/s and 10 ms.
    assert state.bias_std_rad_s.max() < 0.008
    assert state.delay_std_s < 0.004
    assert all(v.valid for v in found[1:])
    if uncorrected:
        assert np.sqrt(np.mean(shares(f, found)[-30:] ** 2)) < max(0.35 * uncorrected, 0.012)


def test_a_gyro_is_unknown_at_first_and_exact_where_that_was_said() -> None:
    state = VelocityEstimator(CAMERA).gyro
    assert state.delay_s == 0 and not state.bias_rad_s.any()  # noqa: PT018
    assert state.bias_std_rad_s.min() > 0.01
    assert state.delay_std_s == pytest.approx(0.01)
    exact = VelocityEstimator(CAMERA, rate_std_rad_s=0.0, rate_delay_std_s=0.0).gyro
    assert not exact.bias_std_rad_s.any()
    assert exact.delay_std_s == 0


def test_an_exact_gyro_is_told_on() -> None:
    f = turning()
    _, found = flown(f, rates=f.rate_rad_s, rate_std_rad_s=0.0, rate_delay_std_s=0.0)
    for v, rate in zip(found[1:], f.rate_rad_s[1:], strict=True):
        np.testing.assert_allclose(v.rate_rad_s, rate, atol=1e-4)
        assert np.diag(v.rate_covariance).max() < 1e-7
    assert np.median(shares(f, found)) < 0.005


def test_two_directions_straight_down_tell_roll_and_pitch() -> None:
    """About themselves they tell nothing: what is left of that is the pictures' own."""
    f = turning()
    _, found = flown(f)
    error = np.array([v.rate_rad_s for v in found[1:]]) - f.rate_rad_s[1:]
    std = np.sqrt([np.diag(v.rate_covariance) for v in found[1:]])
    assert np.abs(error[:, :2]).max() < 0.02
    assert np.abs(error[:, 2]).max() < 0.05
    assert np.abs(error[3:] / std[3:]).max() < 5
    assert np.median(shares(f, found)) < 0.03
    # Without them, and without a gyro, the pictures alone tell it.
    _, alone = flown(f, down=False)
    error = np.array([v.rate_rad_s for v in alone[1:]]) - f.rate_rad_s[1:]
    std = np.sqrt([np.diag(v.rate_covariance) for v in alone[1:]])
    assert np.abs(error / std).max() < 5


def test_yaw_that_nobody_tells_is_found() -> None:
    f = synthetic.flight(CAMERA, frames=6, rate_hz=30.0, height_m=0.6, rate_rad_s=(0.0, 0.0, 0.6), seed=5,
                         velocity_m_s=(0.3, -0.1, 0.0))  # fmt: skip
    _, found = flown(f, down=False)
    for v in found[1:]:
        std = math.sqrt(v.rate_covariance[2, 2])
        assert abs(v.rate_rad_s[2] - 0.6) < 5 * std < 0.05
        assert v.yaw_rate_rad_s == pytest.approx(0.6, abs=5 * std)
        assert "yaw" in v.terms


def test_rate_std_without_a_rate_is_that_of_the_rotation() -> None:
    """The more the camera may turn, the less a way is known; of one that cannot turn it is known best."""
    f = synthetic.flight(CAMERA, frames=3, rate_hz=30.0, height_m=0.6, velocity_m_s=(0.3, -0.1, 0.0), seed=5)
    stds = []
    for std in (0.0, 0.01, 0.1, 1.0):
        _, found = flown(f, down=False, rate_std_rad_s=std)
        stds.append(math.sqrt(found[1].covariance[0, 0]))
    assert (np.diff(stds) > 0).all()
    # A turn about y at 0.6 m passes for a way, 6 mm/s for 0.01 rad/s; the pictures tell some of it apart.
    assert 0.003 < stds[1] < 0.0062


@pytest.mark.parametrize("name", ["rate_rad_s", "down"])
@pytest.mark.parametrize("value", [(math.nan,) * 3, (math.inf, 0.0, 1.0), (0.0, math.nan, 1.0), (0.0, 1e300, 0.0)])
def test_no_number_counts_as_not_told(name: str, value: tuple[float, float, float]) -> None:
    f = turning()

    def run(**known: object) -> list[Velocity]:
        estimator = VelocityEstimator(CAMERA, height_m=0.6)
        return [estimator.update(f.images[k], f.t_s[k], **known) for k in range(4)]  # type: ignore[arg-type]

    for v, other in zip(run(**{name: value}), run(), strict=True):
        assert v.status is other.status
        np.testing.assert_array_equal([v.vx_m_s, v.vy_m_s, v.vz_m_s], [other.vx_m_s, other.vy_m_s, other.vz_m_s])
        np.testing.assert_array_equal(v.covariance, other.covariance)


def test_a_rate_that_is_missing_once_widens_that_frame() -> None:
    f = turning()
    rates = f.rate_rad_s.copy()
    rates[6] = math.nan
    _, found = flown(f, rates=rates, rate_std_rad_s=0.001, rate_delay_std_s=0.0)
    assert all(v.valid for v in found[1:])
    spreads = [np.trace(v.rate_covariance) for v in found[1:]]
    assert spreads[5] > 4 * max(spreads[4], spreads[6])
    error = np.abs([v.vx_m_s - t for v, t in zip(found[1:], f.velocity_m_s[1:, 0], strict=True)])
    assert (error < 5 * np.sqrt([v.covariance[0, 0] for v in found[1:]])).all()


@pytest.mark.parametrize("known", [{"height_m": 0.0}, {"range_m": 0.0}, {"range_m": math.inf}, {"range_m": math.nan}])
def test_a_length_that_is_none_is_a_missing_height(known: dict[str, float]) -> None:
    f = turning()
    estimator = VelocityEstimator(CAMERA)
    missing = [estimator.update(f.images[k], f.t_s[k], **known) for k in range(3)]  # type: ignore[arg-type]
    assert [v.status for v in missing] == [Status.FIRST_FRAME, Status.NO_HEIGHT, Status.NO_HEIGHT]
    assert np.isfinite([missing[2].dx_px, missing[2].dy_px]).all()
    assert np.isnan(missing[2].vx_m_s)
    assert np.isinf(missing[2].covariance[0, 0])
    # A height that comes makes the next frame one with a velocity; missing again, it is carried on.
    given = estimator.update(f.images[3], f.t_s[3], height_m=f.height_m[3])
    carried = estimator.update(f.images[4], f.t_s[4], **known)  # type: ignore[arg-type]
    assert given.valid
    assert carried.valid
    assert "carried on" in "".join(carried.doubts)
    assert carried.height_m == pytest.approx(f.height_m[4], abs=5 * carried.height_std_m)
