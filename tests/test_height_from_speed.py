"""Height over the ground from a known speed, held to flights at a known height."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest

import rsflow
from rsflow import Camera, HeightStatus, OptionError, ShapeError, synthetic

CAMERA = Camera(150.0, 150.0, 79.5, 59.5, width=160, height=120)


@functools.cache
def measured(seed, velocity=(0.1, -0.05, 0.0), *, height=0.5, frames=6, camera=CAMERA, at=1.0):
    clip = synthetic.flight(camera, frames=frames, height_m=height, velocity_m_s=velocity, seed=seed)
    estimator = rsflow.VelocityEstimator(camera, height_m=at)
    return [known_not_to_turn(estimator.update(frame.image, frame.t_s)) for frame in clip][1:]


def known_not_to_turn(velocity):
    """Take what an unknown turn adds out of the deviation: here it would be most of it."""
    parts = {name: part for name, part in velocity.parts.items() if name != "rotation"}
    covariance = sum(parts.values()) if parts else velocity.covariance
    return dataclasses.replace(velocity, covariance=covariance, parts=parts)


def test_deviations_hold_over_seeds():
    off = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        wrong = 0.002 * rng.standard_normal(2)
        clip = measured(seed)
        speed = math.hypot(0.1, 0.05) + wrong[0]
        for height in (
            rsflow.height_from_speed(clip, speed, speed_std_m_s=0.002),
            rsflow.height_from_speed(clip, (0.1 + wrong[0], -0.05 + wrong[1]), speed_std_m_s=0.002),
            rsflow.height_from_speed(clip[0], math.hypot(0.1, 0.05), speed_std_m_s=0.0),
        ):
            assert height.valid
            off.append((height.height_m - 0.5) / height.std_m)
    # 48 in deviations, of which those of a clip share an error: their root mean square is 1 give or take.
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5
    assert np.mean(np.abs(off) < 2.2) > 0.85


def test_noise_of_frames_averages_and_an_error_of_the_speed_does_not():
    clip = measured(1, frames=12)
    one, all_of_them = (rsflow.height_from_speed(v, (0.1, -0.05), speed_std_m_s=0.0) for v in (clip[0], clip))
    assert all_of_them.std_m < 0.6 * one.std_m
    assert all_of_them.n == 11
    shared = rsflow.height_from_speed(clip, (0.1, -0.05), speed_std_m_s=0.005)
    assert shared.std_m == pytest.approx(0.5 * 0.005 / math.hypot(0.1, 0.05), rel=0.1)


def test_a_focal_length_that_is_not_exact_counts_once_for_all():
    camera = Camera(150.0, 150.0, 79.5, 59.5, width=160, height=120, std={"fx": 3.0, "fy": 3.0, "cx": 0.1, "cy": 0.1})
    height = rsflow.height_from_speed(measured(1, frames=12, camera=camera), (0.1, -0.05), speed_std_m_s=0.0)
    assert height.std_m == pytest.approx(0.5 * 0.02, rel=0.3)


def test_an_unknown_turn_is_in_the_deviation():
    clip = synthetic.flight(CAMERA, frames=6, height_m=0.5, velocity_m_s=(0.1, -0.05, 0.0), seed=1)
    estimator = rsflow.VelocityEstimator(CAMERA, height_m=1.0)
    unknown = [estimator.update(frame.image, frame.t_s) for frame in clip][1:]
    wide = rsflow.height_from_speed(unknown, (0.1, -0.05), speed_std_m_s=0.0)
    assert wide.std_m > 3 * rsflow.height_from_speed(measured(1), (0.1, -0.05), speed_std_m_s=0.0).std_m
    assert wide.low_m < 0.5 < wide.high_m


def test_the_height_that_was_measured_with_does_not_matter():
    one, other = measured(2, at=1.0), measured(2, at=0.25)
    a = rsflow.height_from_speed(one, (0.1, -0.05), speed_std_m_s=0.001)
    b = rsflow.height_from_speed(other, (0.1, -0.05), speed_std_m_s=0.001, measured_at_m=0.25)
    assert a.height_m == pytest.approx(b.height_m, rel=1e-3)
    assert a.std_m == pytest.approx(b.std_m, rel=0.05)


def test_one_known_velocity_for_each():
    clip = [measured(3, (0.05 * k, 0.02, 0.0), frames=2)[0] for k in (1, 2, 3)]
    known = [(0.05 * k, 0.02, 0.0) for k in (1, 2, 3)]
    vectors = rsflow.height_from_speed(clip, known, speed_std_m_s=0.0005)
    speeds = rsflow.height_from_speed(clip, np.hypot(*np.array(known)[:, :2].T), speed_std_m_s=0.0005)
    assert vectors.height_m == pytest.approx(0.5, rel=0.01)
    assert speeds.height_m == pytest.approx(0.5, rel=0.01)


def test_what_cannot_be_told():
    still = measured(4, (0.0, 0.0, 0.0))
    height = rsflow.height_from_speed(still, 0.1, speed_std_m_s=0.001)
    assert height.status is HeightStatus.NOT_MOVING
    assert math.isnan(height.height_m)
    assert math.isinf(height.std_m)
    assert 5.0 < height.low_m < math.inf
    assert height.high_m == math.inf
    assert rsflow.height_from_speed(measured(1), 0.0, speed_std_m_s=0.001).status is HeightStatus.NOT_MOVING
    other_way = rsflow.height_from_speed(measured(1), (-0.1, 0.05), speed_std_m_s=0.001)
    assert other_way.status is HeightStatus.APART
    across = rsflow.height_from_speed(measured(1), (0.05, 0.1), speed_std_m_s=0.001)
    assert across.status is HeightStatus.APART
    first = rsflow.VelocityEstimator(CAMERA, height_m=1.0).update(np.zeros((120, 160), np.uint8), 0.0)
    assert rsflow.height_from_speed(first, 0.1, speed_std_m_s=0.0).status is HeightStatus.NOT_MEASURED


def test_misuse_raises():
    clip = measured(1)
    with pytest.raises(OptionError, match="velocity: got none"):
        rsflow.height_from_speed([], 0.1, speed_std_m_s=0.0)
    with pytest.raises(ShapeError, match=r"speed_m_s: got shape \(4,\)"):
        rsflow.height_from_speed(clip, (1, 2, 3, 4), speed_std_m_s=0.0)
    with pytest.raises(OptionError, match="speed_m_s: got -1"):
        rsflow.height_from_speed(clip, -1.0, speed_std_m_s=0.0)
    with pytest.raises(OptionError, match="measured_at_m: got 0"):
        rsflow.height_from_speed(clip, 0.1, speed_std_m_s=0.0, measured_at_m=0)
