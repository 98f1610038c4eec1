"""The filter over velocities as it is used: odd frames, copies, wrong arguments, and behind the estimator."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rsflow
from filter_helpers import velocity
from rsflow import FilterStatus, VelocityFilter, VelocityStatus
from velocity_helpers import QUIET


def test_frames_before_the_first_velocity_and_frames_out_of_order():
    kalman = VelocityFilter()
    noise = np.eye(3) * 1e-4
    now = kalman.update(velocity(0.0, np.nan, None, noise))
    assert (now.status, now.valid) == (FilterStatus.WAITING, False)
    assert np.isnan(now.position_m).all()
    assert np.isinf(np.diag(now.covariance)).all()
    now = kalman.update(velocity(0.1, 0.1, None, noise))
    assert now.status is FilterStatus.WAITING
    now = kalman.update(velocity(0.2, 0.1, np.array([1.0, 0.0, 0.0]), noise))
    assert now.status is FilterStatus.OK
    assert now.position_m[0] == pytest.approx(0.1)
    late = rsflow.Velocity(**{**vars(velocity(0.15, -0.05, None, noise)), "status": VelocityStatus.TIME_NOT_INCREASING})
    after = kalman.update(late)
    assert after.status is FilterStatus.PREDICTED
    assert np.isfinite(after.position_m).all()


def test_a_copy_and_a_pickle_go_on_alike_and_reset_forgets():
    rng = np.random.default_rng(2)
    given = [velocity(0.1 * (k + 1), 0.1, rng.standard_normal(3) * 0.1, np.eye(3) * 1e-3) for k in range(6)]
    kalman = VelocityFilter(gate=1e6)
    for v in given[:3]:
        kalman.update(v)
    others = [copy.copy(kalman), copy.deepcopy(kalman), pickle.loads(pickle.dumps(kalman))]
    want = [repr(kalman.update(v).to_dict()) for v in given[3:]]
    for other in others:
        assert [repr(other.update(v).to_dict()) for v in given[3:]] == want
    kalman.reset()
    first = VelocityFilter(gate=1e6)
    assert [repr(kalman.update(v).to_dict()) for v in given] == [repr(first.update(v).to_dict()) for v in given]


def test_wrong_arguments_are_named():
    v = velocity(0.1, 0.1, np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-4)
    with pytest.raises(rsflow.OptionError, match="common: got 'displacement'"):
        VelocityFilter(common=("displacement",))
    with pytest.raises(rsflow.OptionError, match="wandering: got 'gyro', which common names too"):
        VelocityFilter(wandering=("gyro",))
    with pytest.raises(rsflow.OptionError, match="height_m: got None, expected the height"):
        VelocityFilter(gyro_bias_std_rad_s=0.1).update(v)
    with pytest.raises(rsflow.OptionError, match="expected a filter with gyro_bias_std_rad_s"):
        VelocityFilter().update(v, residual_rate_rad_s=(0, 0, 0), residual_rate_covariance=np.eye(3))
    with pytest.raises(rsflow.OptionError, match="got one of them, expected both"):
        VelocityFilter(gyro_bias_std_rad_s=0.1).update(v, residual_rate_rad_s=(0, 0, 0), height_m=1.0)
    with pytest.raises(rsflow.OptionError, match="positive definite"):
        VelocityFilter(gyro_bias_std_rad_s=0.1).update(
            v, residual_rate_rad_s=(0, 0, 0), residual_rate_covariance=-np.eye(3), height_m=1.0
        )
    with pytest.raises(rsflow.OptionError, match="down: got"):
        VelocityFilter().update(v, down=(0, 0, 0))
    with pytest.raises(rsflow.DTypeError, match="velocity"):
        VelocityFilter().update(3.0)


def test_over_a_made_flight():
    """Through the estimator: the way is right, and smoother than the velocities are."""
    f = rsflow.synthetic.flight(frames=20, height_m=0.4, velocity_m_s=(0.1, -0.05, 0.0), seed=4, sensor=QUIET)
    estimator = rsflow.VelocityEstimator(f.camera, height_m=0.4, height_std_m=0.002)
    kalman = VelocityFilter(acceleration_walk_m_s2=0.02, acceleration_std_m_s2=0.05)
    for frame in f:
        now = kalman.update(estimator.update(frame.image, frame.t_s))
    way = np.array([0.1, -0.05, 0.0]) * (f.t_s[-1] - f.t_s[0])
    off = now.position_m - way
    assert (np.abs(off[:2]) < 3 * np.sqrt(np.diag(now.position_covariance))[:2]).all()
    assert np.hypot(*off[:2]) < 0.01 * np.hypot(*way[:2])
    assert now.unstated == now.measurement.unstated == ("focal length", "principal point")
    assert now.covariance[0, 0] ** 0.5 < 0.02 * 0.1
