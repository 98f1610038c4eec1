"""The plane model of velocity, from exact points: exact, right-handed, no wider than the data demand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsflow._rotation import rotation_matrix
from rsflow.synthetic import Flight, flight
from rsflow.velocity import plane
from velocity_helpers import WIDE


def exact_points(f: Flight, count: int = 80) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    height, width = f.images[0].shape
    x, y = rng.integers(10, width - 10, count), rng.integers(10, height - 10, count)
    before = np.stack([x, y], axis=1).astype(np.float64)
    return before, before + f.flow(1)[y, x]


@pytest.mark.parametrize(
    ("motion", "yaw_free"),
    [
        ({"velocity_m_s": (0.5, -0.2, 0.0)}, False),
        ({"velocity_m_s": (0.5, -0.2, 0.9)}, True),
        ({"velocity_m_s": (0.5, -0.2, -1.5), "rate_rad_s": (0.4, -0.3, 1.0), "tilt_rad": (0.2, -0.1)}, False),
        ({"velocity_m_s": (0.1, 0.3, 0.9), "rate_rad_s": (0.0, 0.0, 3.0)}, True),
    ],
)
def test_model_is_exact_for_large_motion(motion: dict[str, object], yaw_free: bool) -> None:
    f = flight(WIDE, frames=2, **motion)  # type: ignore[arg-type]
    before, after = (WIDE.undistort_points(p, normalized=True) for p in exact_points(f))
    dt = float(f.t_s[1])
    turn = np.zeros(3) if yaw_free else f.rate_rad_s[1] * dt
    interval = plane.Interval(turn, f.down[1], float(f.height_m[1]), dt, yaw_free)
    covariance = np.broadcast_to(np.eye(2) * (0.02 / 150) ** 2, (len(before), 2, 2))
    fit = plane.fit(plane.Points(before, after, covariance), interval)
    assert fit is not None
    np.testing.assert_allclose(fit.velocity, f.velocity_m_s[1], atol=2e-6)
    if yaw_free:
        assert fit.yaw_rad == pytest.approx(f.rate_rad_s[1, 2] * dt, abs=1e-6)


def test_rotation_matrix_is_right_handed() -> None:
    for vector_ in ([0.0, 0.0, 0.0], [0.1, -0.7, 0.4], [3.0, 0.0, 0.0]):
        np.testing.assert_allclose(rotation_matrix(vector_), Rotation.from_rotvec(vector_).as_matrix(), atol=1e-14)


def test_model_takes_vz_and_yaw_only_as_far_as_the_data_demand() -> None:
    rng = np.random.default_rng(2)
    taken = []
    for motion in ({"velocity_m_s": (0.05, 0.0, 0.0)}, {"velocity_m_s": (0.05, 0.0, 0.2)},
                   {"velocity_m_s": (0.05, 0.0, 0.0), "rate_rad_s": (0.0, 0.0, 0.5)}):  # fmt: skip
        f = flight(WIDE, frames=2, **motion)  # type: ignore[arg-type]
        before, after = exact_points(f)
        after = after + 0.03 * rng.standard_normal(after.shape)
        rays = [WIDE.undistort_points(p, normalized=True) for p in (before, after)]
        interval = plane.Interval(np.zeros(3), f.down[1], float(f.height_m[1]), float(f.t_s[1]), True)
        fit = plane.fit(plane.Points(*rays, np.broadcast_to(np.eye(2) * (0.03 / 150) ** 2, (80, 2, 2))), interval)
        assert fit is not None
        taken.append(fit.terms)
        # Without "vz" in the model, vz is still an estimate with its deviation, not a zero.
        assert fit.velocity[2] != 0.0
        assert abs(fit.velocity[2] - f.velocity_m_s[1, 2]) < 4 * np.sqrt(fit.covariance[2, 2])
    assert taken == [("vx", "vy"), ("vx", "vy", "vz"), ("vx", "vy", "yaw")]


def test_model_survives_forty_percent_of_points_on_a_moving_object() -> None:
    f = flight(WIDE, frames=2, velocity_m_s=(0.05, -0.02, 0.03))
    rng = np.random.default_rng(3)
    before, after = exact_points(f)
    after = after + 0.02 * rng.standard_normal(after.shape)
    after[:32] += (2.5, -1.0)
    rays = [WIDE.undistort_points(p, normalized=True) for p in (before, after)]
    interval = plane.Interval(np.zeros(3), f.down[1], float(f.height_m[1]), float(f.t_s[1]), True)
    fit = plane.fit(plane.Points(*rays, np.broadcast_to(np.eye(2) * (0.02 / 150) ** 2, (80, 2, 2))), interval)
    assert fit is not None
    assert not fit.inliers[:32].any()
    assert (np.abs(fit.velocity - f.velocity_m_s[1]) < 4 * np.sqrt(np.diag(fit.covariance))).all()
