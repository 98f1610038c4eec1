"""The filter over velocities: held to plain least squares over all frames at once, and to its own covariance."""

from __future__ import annotations

import numpy as np
import pytest

import rsflow
from filter_helpers import turned, velocity, walk
from rsflow import FilterStatus, VelocityFilter

STILL = {"rate_rad_s": (0.0, 0.0, 0.0)}
# The mean of a NEES over 3 states and 150 runs has a deviation of 0.067.
BAND = (0.85, 1.15)


def batch(t_s, mids, measured, noise, power, start):
    """Final state and covariance by least squares over the states at the middles of all intervals and at the end."""
    times = [*mids, t_s[-1]]
    rows, values = [], []

    def add(blocks, value, covariance):
        row = np.zeros((len(value), 9 * len(times)))
        for k, block in blocks:
            row[:, 9 * k : 9 * k + 9] = block
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        rows.append(root @ row)
        values.append(root @ value)

    half = mids[0] - t_s[0]
    eye = np.eye(3)
    # At the start the position is zero and the acceleration has a deviation: brought to the first middle.
    add([(0, np.hstack([eye, -half * eye, half**2 / 2 * eye]))], np.zeros(3), eye * (power * half**5 / 20 + 1e-30))
    add([(0, np.hstack([np.zeros((3, 6)), eye]))], np.zeros(3), eye * start**2)
    for k, dt in enumerate(np.diff(times)):
        step = np.kron(np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]]), eye)
        q = np.array(
            [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
        )
        add([(k, -step), (k + 1, np.eye(9))], np.zeros(9), np.kron(power * q, eye))
    for k, z in enumerate(measured):
        if z is not None:
            add([(k, np.hstack([np.zeros((3, 3)), eye, np.zeros((3, 3))]))], z, noise)
    design, target = np.vstack(rows), np.concatenate(values)
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    root = np.linalg.pinv(design)
    return solution[-9:], (root @ root.T)[-9:, -9:]


def test_it_is_least_squares_over_all_frames():
    """Variable intervals, correlated noise, frames without a velocity."""
    rng = np.random.default_rng(5)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.2, 14))])
    truth = walk(rng, t, power=0.5**2, start=0.4, speed=0.3, yaw=0.0)
    root = rng.standard_normal((3, 3)) * 0.02
    noise = root @ root.T + np.eye(3) * 1e-5
    measured = [
        None if k in (4, 9, 10) else m + np.linalg.cholesky(noise) @ rng.standard_normal(3)
        for k, m in enumerate(truth.mean_body[1:])
    ]
    kalman = VelocityFilter(
        acceleration_walk_m_s2=0.5,
        acceleration_std_m_s2=0.4,
        yaw_rate_std_rad_s=0.0,
        gate=1e6,
        common=(),
        adaptive=False,
    )
    for k, z in enumerate(measured):
        now = kalman.update(velocity(t[k + 1], t[k + 1] - t[k], z, noise), **STILL)
    mids = (t[1:] + t[:-1]) / 2
    want, covariance = batch(t, mids, measured, noise, 0.5**2, 0.4)
    got = np.concatenate([now.position_m, [now.vx_m_s, now.vy_m_s, now.vz_m_s], now.acceleration_m_s2])
    std = np.sqrt(np.diag(covariance))
    assert np.abs((got - want) / std).max() < 1e-3
    for have, place in ((now.position_covariance, slice(0, 3)), (now.acceleration_covariance, slice(6, 9))):
        assert np.allclose(have, covariance[place, place], rtol=1e-3, atol=1e-9)
    assert np.allclose(now.covariance, covariance[3:6, 3:6], rtol=1e-3, atol=1e-9)


def flown(seed, *, height=0.02, focal=0.0, yaw=0.0, gaps=False, gyro=0.0, rocking=0.0, frames=60):
    """Errors of position and velocity at the end, with the covariances that were told."""
    rng = np.random.default_rng(seed)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.05, frames))])
    truth = walk(rng, t, power=1.0, start=1.0, speed=1.0, yaw=yaw)
    scale, axes = 1.0 + height * rng.standard_normal(), 1.0 + focal * rng.standard_normal(3) * [1, 1, 0]
    bias, swing = gyro * rng.standard_normal(3), rocking * rng.standard_normal(3)
    noise, turning = np.diag([0.01, 0.02, 0.03]) ** 2, 0.0 if gyro else 0.01
    kalman = VelocityFilter(
        acceleration_walk_m_s2=1.0, acceleration_std_m_s2=1.0, yaw_rate_std_rad_s=turning, wander_s=0.3, gate=8
    )
    for k in range(frames):
        true, left = truth.mean_body[k + 1], np.exp(-(t[k + 1] - t[k]) / 0.3)
        swing = left * swing + np.sqrt(1 - left**2) * rocking * rng.standard_normal(3)
        z = true * scale * axes + bias + swing + np.sqrt(np.diag(noise)) * rng.standard_normal(3)
        parts = {"height": np.outer(z, z) * height**2, "focal_length": np.diag(z * z * focal**2) * [1, 1, 0]}
        parts |= {name: np.eye(3) * std**2 for name, std in (("gyro", gyro), ("rotation", rocking)) if std}
        lost = gaps and (k % 20) in (7, 8, 9, 10, 11)
        given = velocity(t[k + 1], t[k + 1] - t[k], None if lost else z, noise, **parts)
        now = kalman.update(given, rate_rad_s=(0.0, 0.0, yaw + turning * rng.standard_normal()))
        assert now.status in (FilterStatus.OK, FilterStatus.PREDICTED)
    v = np.array([now.vx_m_s, now.vy_m_s, now.vz_m_s]) - turned(truth.velocity[-1], -truth.heading[-1])
    return now.position_m - truth.position[-1], v, now


@pytest.mark.parametrize(
    "conditions",
    [
        {},
        {"yaw": 0.8},
        {"gaps": True},
        {"focal": 0.03, "height": 0.0},
        {"focal": 0.02, "yaw": -0.5, "gaps": True},
        {"gyro": 0.1},
        {"rocking": 0.1, "gaps": True},
    ],
    ids=str,
)
def test_errors_are_as_large_as_it_says(conditions):
    """Normalised squared errors (NEES) over seeds come to one for each degree of freedom, and each axis is covered."""
    of_position, of_velocity, inside = [], [], []
    for seed in range(150):
        p, v, now = flown(seed, **conditions)
        of_position.append(p @ np.linalg.solve(now.position_covariance, p) / 3)
        of_velocity.append(v @ np.linalg.solve(now.covariance, v) / 3)
        std = np.sqrt(np.concatenate([np.diag(now.position_covariance), np.diag(now.covariance)]))
        inside.append(np.abs(np.concatenate([p, v])) < std)
    assert BAND[0] < np.mean(of_position) < BAND[1]
    assert BAND[0] < np.mean(of_velocity) < BAND[1]
    assert 0.60 < np.mean(inside) < 0.76


@pytest.mark.parametrize(("common", "least"), [(("height",), 0.0099), ((), 0.0)])
def test_what_is_the_same_in_every_frame_does_not_average_out(common, least):
    kalman = VelocityFilter(acceleration_walk_m_s2=0.001, acceleration_std_m_s2=0.01, common=common)
    z, noise = np.array([2.0, 0.0, 0.0]), np.eye(3) * 1e-4
    for k in range(400):
        now = kalman.update(velocity(0.1 * (k + 1), 0.1, z, noise, height=np.outer(z, z) * 1e-4), **STILL)
    of_speed = np.sqrt(now.covariance[0, 0]) / 2.0
    of_way = np.sqrt(now.position_covariance[0, 0]) / now.position_m[0]
    assert now.position_m[0] == pytest.approx(80.0, rel=1e-3)
    if least:
        # One per cent of height: one per cent of way and speed, however many frames.
        assert least < of_way < 0.0105
        assert least < of_speed < 0.0105
    else:
        assert of_way < 0.002
        assert of_speed < 0.004


def test_what_is_the_same_in_every_frame_widens_the_covariance_and_moves_nothing():
    """Noise must not pass for knowledge of the height: the way is that of the measured velocities."""
    rng = np.random.default_rng(8)
    with_height, without = VelocityFilter(acceleration_walk_m_s2=0.1), VelocityFilter(acceleration_walk_m_s2=0.1)
    noise, way = np.eye(3) * 1e-8, np.zeros(3)
    for k in range(60):
        z = np.array([0.0, -0.4, 0.0]) + 1e-4 * rng.standard_normal(3)
        way += z / 30
        a = with_height.update(velocity((k + 1) / 30, 1 / 30, z, noise, height=np.outer(z, z) * 0.02**2), **STILL)
        b = without.update(velocity((k + 1) / 30, 1 / 30, z, noise), **STILL)
    assert a.position_m == pytest.approx(way, abs=5e-5)
    assert a.position_m == pytest.approx(b.position_m, abs=1e-12)
    assert a.position_covariance[1, 1] ** 0.5 == pytest.approx(0.02 * 0.8, rel=0.01)
    assert b.position_covariance[1, 1] ** 0.5 < 1e-4


def test_out_and_back_a_wrong_height_cancels():
    kalman = VelocityFilter(acceleration_walk_m_s2=2.0, acceleration_std_m_s2=2.0)
    noise, most = np.eye(3) * 1e-8, 0.0
    for k in range(200):
        z = np.array([np.cos(2 * np.pi * (k + 0.5) / 200), 0.0, 0.0])
        now = kalman.update(velocity(0.02 * (k + 1), 0.02, z, noise, height=np.outer(z, z) * 0.05**2), **STILL)
        most = max(most, now.position_covariance[0, 0] ** 0.5)
    assert most > 0.02
    assert now.position_covariance[0, 0] ** 0.5 < 0.1 * most


def test_a_gap_is_bridged_with_a_covariance_that_grows():
    kalman = VelocityFilter(acceleration_walk_m_s2=1.0, acceleration_std_m_s2=1.0)
    noise, z = np.eye(3) * 1e-4, np.array([1.0, -0.5, 0.0])
    for k in range(30):
        before = kalman.update(velocity(0.1 * (k + 1), 0.1, z, noise), **STILL)
    seen = [before] + [kalman.update(velocity(0.1 * (k + 1), 0.1, None, noise), **STILL) for k in range(30, 40)]
    assert {now.status for now in seen[1:]} == {FilterStatus.PREDICTED}
    assert all(now.valid and not now.measurement.valid for now in seen[1:])
    variances = [(now.covariance[0, 0], now.position_covariance[0, 0]) for now in seen]
    assert (np.diff(variances, axis=0) > 0).all()
    # White jerk alone gives t^3 / 3 to the velocity and t^5 / 20 to the position.
    assert variances[-1][0] > 1 / 3
    assert variances[-1][1] > 1 / 20
    assert seen[-1].position_m[:2] == pytest.approx([4.0, -2.0], abs=0.05)
    # One long interval is the same as ten short ones.
    other = VelocityFilter(acceleration_walk_m_s2=1.0, acceleration_std_m_s2=1.0)
    for k in range(30):
        other.update(velocity(0.1 * (k + 1), 0.1, z, noise), **STILL)
    long = other.update(velocity(4.0, 1.0, None, noise), **STILL)
    assert np.allclose(long.position_covariance, seen[-1].position_covariance, rtol=1e-3)


def test_an_outlier_is_not_taken_in_and_a_lasting_one_is():
    kalman = VelocityFilter(acceleration_walk_m_s2=1.0, acceleration_std_m_s2=1.0, max_rejected_s=0.5)
    noise, z, wrong = np.eye(3) * 1e-4, np.array([1.0, 0.0, 0.0]), np.array([-9.0, 4.0, 0.0])
    for k in range(20):
        good = kalman.update(velocity(0.1 * (k + 1), 0.1, z, noise), **STILL)
    now = kalman.update(velocity(2.1, 0.1, wrong, noise), **STILL)
    assert (now.status, now.measurement.vx_m_s) == (FilterStatus.REJECTED, -9.0)
    assert now.innovation > 20
    assert now.vx_m_s == pytest.approx(1.0, abs=0.05)
    assert now.covariance[0, 0] > good.covariance[0, 0]
    now = kalman.update(velocity(2.2, 0.1, z, noise), **STILL)
    assert now.status is FilterStatus.OK
    statuses = []
    for k in range(22, 40):
        now = kalman.update(velocity(0.1 * (k + 1), 0.1, wrong, noise), **STILL)
        statuses.append(now.status.name)
    assert statuses.count("RESTARTED") == 1
    begun = statuses.index("RESTARTED")
    assert 3 <= begun <= 7
    assert statuses[:begun] == ["REJECTED"] * begun
    assert set(statuses[begun + 1 :]) == {"OK"}
    assert now.vx_m_s == pytest.approx(-9.0, abs=0.1)
    # It went at -9 m/s from 2.2 s on, which was not believed at first: the way's deviation holds that.
    true = 1.0 * 2.1 - 9.0 * 0.1 + 1.0 * 0.0 - 9.0 * 1.8
    assert abs(now.position_m[0] - true) < 3 * now.position_covariance[0, 0] ** 0.5


def test_accelerations_that_change_more_than_was_said_are_noticed():
    """Velocity that jumps from frame to frame, of which the filter was told that it does not."""

    def errors(adaptive):
        normalised = []
        for seed in range(40):
            rng = np.random.default_rng(seed)
            v = np.array([0.15, -0.1, 0.0]) + np.cumsum(rng.standard_normal((90, 3)) * 0.01, axis=0)
            kalman = VelocityFilter(acceleration_walk_m_s2=1.0, acceleration_std_m_s2=1.0, adaptive=adaptive)
            for k in range(90):
                z = v[k] + 0.001 * rng.standard_normal(3)
                now = kalman.update(velocity((k + 1) / 30, 1 / 30, z, np.eye(3) * 1e-6), **STILL)
            off = now.position_m - v.sum(axis=0) / 30
            normalised.append(off @ np.linalg.solve(now.position_covariance, off) / 3)
        return np.mean(normalised), now.acceleration_walk_m_s2

    stubborn, walk = errors(adaptive=False)
    assert (stubborn > 2.0, walk) == (True, 1.0)
    careful, walk = errors(adaptive=True)
    assert careful < 1.2
    assert 1.5 < walk < 4.0


def test_a_circle_ends_where_it_began():
    """Forward at 1 m/s along the body's x, turning to the right, as a gyro says."""
    kalman = VelocityFilter(acceleration_walk_m_s2=1.0, acceleration_std_m_s2=3.0, yaw_rate_std_rad_s=0.0)
    rate = 2 * np.pi / 4.0
    noise = np.eye(3) * 1e-6
    quarter = None
    for k in range(400):
        given = velocity(0.01 * (k + 1), 0.01, np.array([1.0, 0.0, 0.0]), noise)
        now = kalman.update(given, rate_rad_s=(0.0, 0.0, rate))
        quarter = now if k == 99 else quarter
    radius = 1.0 / rate
    assert quarter.position_m[:2] == pytest.approx([radius, radius], abs=5e-3)
    assert quarter.heading_rad == pytest.approx(np.pi / 2)
    assert now.position_m[:2] == pytest.approx([0.0, 0.0], abs=5e-3)
    assert (now.vx_m_s, now.vy_m_s) == pytest.approx((1.0, 0.0), abs=5e-3)


def test_an_unknown_turn_makes_the_way_unsure_and_a_seen_one_does_not():
    deviations = {}
    for turn in (np.nan, 0.0):
        kalman = VelocityFilter(acceleration_walk_m_s2=1.0, acceleration_std_m_s2=1.0)
        for k in range(50):
            given = velocity(0.1 * (k + 1), 0.1, np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-4)
            now = kalman.update(rsflow.Velocity(**{**vars(given), "yaw_rate_rad_s": turn}))
        deviations[turn] = now.heading_std_rad, now.position_covariance[1, 1] ** 0.5
    unknown, seen = deviations.values()
    assert unknown[0] > 0.5
    assert unknown[1] > 0.5
    assert seen[0] < 0.05
    assert seen[1] < 0.1


def test_bias_and_delay_are_found_from_residual_rates_and_taken_off_the_velocity():
    """A gyro with a bias that is 20 ms late, 2 m over the ground: the velocity is off by 2 m times its error."""
    bias, late, height, dt = np.array([0.03, -0.02, 0.01]), 0.02, 2.0, 0.02
    rng = np.random.default_rng(3)
    found = []
    for _ in range(20):
        kalman = VelocityFilter(gyro_bias_std_rad_s=0.05, rate_delay_std_s=0.05, acceleration_walk_m_s2=0.5)
        truth = np.array([0.5, -0.2, 0.0])
        for k in range(400):
            t = (k + 1) * dt

            def rate(at):
                return 0.5 * np.array([np.sin(5 * at), np.cos(4 * at), 0.2 * np.sin(3 * at)])

            mid = t - dt / 2
            error = bias + rate(mid - late) - rate(mid)
            z = truth + np.array([-height * error[1], height * error[0], 0.0]) + 0.01 * rng.standard_normal(3)
            residual = error + 0.02 * rng.standard_normal(3)
            now = kalman.update(
                velocity(t, dt, z, np.eye(3) * 1e-4),
                rate_rad_s=rate(mid) + error,
                residual_rate_rad_s=residual,
                residual_rate_covariance=np.eye(3) * 0.02**2,
                height_m=height,
            )
        errors = [*(now.gyro_bias_rad_s - bias), now.delay_s - late, now.vx_m_s - 0.5, now.vy_m_s + 0.2]
        stds = [*now.gyro_bias_std_rad_s, now.delay_std_s, *np.sqrt(np.diag(now.covariance))[:2]]
        found.append((errors, stds))
    errors, stds = np.array(found).transpose(1, 0, 2)
    assert stds[:, :3].max() < 0.003
    assert stds[:, 3].max() < 0.002
    assert np.abs(errors[:, 3]).max() < 0.004
    assert np.sqrt((errors[:, 4:] ** 2).mean()) < 0.015
    assert (np.abs(errors) < 3 * stds + 1e-3).mean() > 0.97


def test_a_bias_that_nothing_tells_stays_in_the_covariance():
    kalman = VelocityFilter(gyro_bias_std_rad_s=0.05, acceleration_walk_m_s2=0.1)
    for k in range(200):
        given = velocity(0.05 * (k + 1), 0.05, np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-6)
        now = kalman.update(given, rate_rad_s=(0.0, 0.0, 0.0), height_m=2.0)
    assert now.covariance[0, 0] ** 0.5 == pytest.approx(2.0 * 0.05, rel=0.05)
    assert now.gyro_bias_std_rad_s[:2] == pytest.approx([0.05, 0.05], rel=0.05)


def test_tilted_bodies_move_along_level_axes():
    """Nose down by 0.3 rad, forward along the body's axis: forward and down along the level ones."""
    kalman = VelocityFilter()
    down = (-np.sin(-0.3), 0.0, np.cos(-0.3))
    for k in range(20):
        given = velocity(0.1 * (k + 1), 0.1, np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-6)
        now = kalman.update(given, down=down, **STILL)
    assert now.position_m == pytest.approx([2.0 * np.cos(0.3), 0.0, 2.0 * np.sin(0.3)], abs=1e-3)
    assert (now.vx_m_s, now.vz_m_s) == pytest.approx((1.0, 0.0), abs=1e-3)


def test_a_component_that_was_never_measured_is_told():
    noise = np.diag([1e-4, 1e-4, np.inf])
    kalman = VelocityFilter()
    for k in range(5):
        now = kalman.update(velocity(0.1 * (k + 1), 0.1, np.array([1.0, 0.0, np.nan]), noise), **STILL)
    assert now.status is FilterStatus.OK
    assert now.vx_m_s == pytest.approx(1.0, abs=0.01)
    assert now.covariance[2, 2] > 100
    now = kalman.update(velocity(0.6, 0.1, np.array([1.0, 0.0, 0.25]), np.eye(3) * 1e-4), **STILL)
    assert now.vz_m_s == pytest.approx(0.25, abs=0.01)
