"""The covariance of a path is that of the errors it has: over many paths of which each error is drawn."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsflow.extraction.trajectory import Trajectory
from rsflow.velocity import Velocity, VelocityStatus

DT, FRAMES, PATHS = 0.1, 50, 250

NOISE_M_S, HEIGHT, FOCAL, BIAS_M_S = 0.02, 0.02, 0.015, 0.01


def flown(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """True velocities in the body's axes, (N, 3), and yaw rates."""
    t = np.arange(FRAMES) * DT
    v = np.zeros((FRAMES, 3))
    v[:, 0] = 1.0
    rate = np.zeros(FRAMES)
    if kind == "there and back":
        v[FRAMES // 2 :, 0] = -1.0
    elif kind == "two legs":
        v[FRAMES // 2 :] = (0.3, 0.8, 0.0)
    elif kind == "turning":
        rate[:] = 0.8
        v[:, 1], v[:, 2] = 0.3, 0.2 * np.cos(t)
    return v, rate


def placed(velocities: np.ndarray, rate: np.ndarray, parts: list[dict[str, np.ndarray]]) -> dict[str, float]:
    path = Trajectory()
    path.add(velocity(0.0, np.zeros(3), 0.0, {}, VelocityStatus.FIRST_FRAME), 0)
    row: dict[str, float] = {}
    for k, v in enumerate(velocities):
        row = path.add(velocity((k + 1) * DT, v, rate[k], parts[k], VelocityStatus.OK), k + 1)
    return row


def velocity(t_s: float, v: np.ndarray, rate: float, parts: dict[str, np.ndarray], status: VelocityStatus) -> Velocity:
    covariance = sum(parts.values(), np.zeros((3, 3)))
    return Velocity(t_s, DT, *v, covariance, status, 90, 1.0, 0.0, yaw_rate_rad_s=rate, parts=parts)


def stated(v: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "displacement": np.eye(3) * NOISE_M_S**2,
        "height": np.outer(v, v) * HEIGHT**2,
        "focal length": np.diag((v * (FOCAL, FOCAL, 0.0)) ** 2),
        "rotation": np.diag((BIAS_M_S, BIAS_M_S, 0.0)) ** 2,
    }


@pytest.mark.parametrize("kind", ["straight", "there and back", "two legs", "turning"])
def test_the_covariance_is_that_of_the_errors(kind: str) -> None:
    rng = np.random.default_rng(3)
    v, rate = flown(kind)
    true = placed(v, rate, [{}] * FRAMES)
    names = ("x_m", "y_m", "z_m")
    place = np.array([true[name] for name in names])
    off, sigmas, ways = [], [], []
    for _ in range(PATHS):
        scale, focal = rng.normal(0, HEIGHT), rng.normal(0, FOCAL, 2)
        bias = np.append(rng.normal(0, BIAS_M_S, 2), 0.0)
        measured = v * (1 + scale) + v * np.append(focal, 0.0) + bias + rng.normal(0, NOISE_M_S, v.shape)
        row = placed(measured, rate, [stated(one) for one in v])
        off.append(np.array([row[name] for name in names]) - place)
        covariance = np.zeros((3, 3))
        for (i, k), name in zip(
            ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), ("xx", "xy", "xz", "yy", "yz", "zz"), strict=True
        ):
            covariance[i, k] = covariance[k, i] = row[f"cov_{name}_m2"]
        assert [row["x_std_m"], row["y_std_m"], row["z_std_m"]] == pytest.approx(np.sqrt(np.diag(covariance)))
        sigmas.append(covariance)
        ways.append((row["distance_m"] - true["distance_m"], row["distance_std_m"]))
    errors, covariance = np.array(off), np.mean(sigmas, axis=0)
    seen = errors.T @ errors / PATHS
    # Whitened by what was said, what was seen is the identity but for the noise of 250 draws.
    root = np.linalg.inv(np.linalg.cholesky(covariance + 1e-12 * np.eye(3)))
    assert root @ seen @ root.T == pytest.approx(np.eye(3), abs=0.35)
    way, way_std = np.array(ways).T
    assert 58 <= 100 * (np.abs(way) <= way_std).mean() <= 80
    assert np.median(way_std) < 0.3


def test_what_scales_a_path_cancels_on_the_way_back_and_what_pushes_does_not() -> None:
    v, rate = flown("there and back")
    scaled = placed(v, rate, [{"height": np.outer(one, one) * HEIGHT**2} for one in v])
    assert scaled["x_m"] == pytest.approx(0.0, abs=1e-9)
    assert scaled["x_std_m"] == pytest.approx(0.0, abs=1e-9)
    assert scaled["distance_std_m"] == pytest.approx(HEIGHT * FRAMES * DT)
    pushed = placed(v, rate, [{"gyro": np.diag([BIAS_M_S**2, 0.0, 0.0])}] * FRAMES)
    assert pushed["x_std_m"] == pytest.approx(BIAS_M_S * FRAMES * DT)
    assert pushed["distance_std_m"] == pytest.approx(0.0, abs=1e-9)


def test_a_velocity_that_is_tilted_is_made_level() -> None:
    """A body in forward, right, down that pitches up by 20 degrees and flies level ahead."""
    pitch = np.radians(20.0)
    ahead, down = np.array([np.cos(pitch), 0.0, np.sin(pitch)]), np.array([-np.sin(pitch), 0.0, np.cos(pitch)])
    path = Trajectory()
    path.add(velocity(0.0, np.zeros(3), 0.0, {}, VelocityStatus.FIRST_FRAME), 0)
    row = path.add(velocity(1.0, ahead, 0.0, {}, VelocityStatus.OK), 1, down=down)
    assert [row["x_m"], row["y_m"], row["z_m"]] == pytest.approx([DT, 0.0, 0.0], abs=1e-12)
    assert row["distance_m"] == pytest.approx(DT)
    # Nothing is known of a direction that is not there, nor turned over.
    for other, sign in ((np.full(3, np.nan), 1.0), (np.array([0.0, 0.0, -2.0]), 1.0)):
        path = Trajectory()
        path.add(velocity(0.0, np.zeros(3), 0.0, {}, VelocityStatus.FIRST_FRAME), 0)
        row = path.add(velocity(1.0, np.array([1.0, 0.0, 0.0]), 0.0, {}, VelocityStatus.OK), 1, down=other)
        assert row["x_m"] == pytest.approx(sign * DT)


def test_a_velocity_without_its_third_axis_has_no_depth() -> None:
    path = Trajectory()
    path.add(velocity(0.0, np.zeros(3), 0.0, {}, VelocityStatus.FIRST_FRAME), 0)
    row = path.add(
        velocity(1.0, np.array([1.0, 0.0, np.nan]), 0.0, stated(np.array([1.0, 0, 0])), VelocityStatus.OK), 1
    )
    assert np.isnan(row["z_m"])
    assert (row["cov_zz_m2"], row["cov_xz_m2"]) == (np.inf, 0.0)
    assert np.isfinite(row["cov_xx_m2"])


@pytest.mark.parametrize(
    ("gyro_std", "bias_std", "noise_std"),
    [(np.inf, 0.0, 0.06), (None, 0.06, 0.0), (0.06, 0.06, 0.0), (0.12, 0.03, 0.052)],
    ids=["of the pictures", "a gyro of unknown make", "of the gyro alone", "of both"],
)
def test_a_heading_that_is_off_turns_the_way_after_it(
    gyro_std: float | None, bias_std: float, noise_std: float
) -> None:
    """Rates whose error is in part drawn once and in part anew in each frame, as their deviation and the gyro's say."""
    rng = np.random.default_rng(5)
    std = np.hypot(bias_std, noise_std)
    places, headings, said = [], [], []
    for _ in range(400):
        path = Trajectory()
        path.add(velocity(0.0, np.zeros(3), np.nan, {}, VelocityStatus.FIRST_FRAME), 0)
        bias = rng.normal(0, bias_std)
        row: dict[str, float] = {}
        for k in range(40):
            rate = np.array([0.0, 0.0, bias + rng.normal(0, noise_std)])
            told = velocity((k + 1) * DT, np.array([1.0, 0.0, 0.0]), np.nan, {}, VelocityStatus.OK)
            told = dataclasses.replace(told, rate_rad_s=rate, rate_covariance=np.eye(3) * std**2)
            row = path.add(told, k + 1, gyro_std_rad_s=gyro_std)
        places.append((row["x_m"], row["y_m"]))
        headings.append(row["heading_rad"])
        said.append((row["x_std_m"], row["y_std_m"], row["heading_std_rad"]))
    off = np.array([np.std(np.array(places)[:, 1]), np.std(headings)])
    assert off == pytest.approx(np.mean(said, axis=0)[1:], rel=0.2)
