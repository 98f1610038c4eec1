"""rsflow.estimate_shift where things cross: as exact and as sure as what stands still allows."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import rsflow
from rsflow import estimate_shift, synthetic
from rsflow.cli.demo import make_flight


def pulls(scene: synthetic.MovingThings) -> tuple[np.ndarray, np.ndarray]:
    """The error of each pair of a camera at rest, and its deviation as stated, both (pairs, 2)."""
    shifts = [rsflow.estimate_shift(a, b) for a, b in itertools.pairwise(scene.images)]
    assert all(shift.valid for shift in shifts)
    return np.array([(s.dx, s.dy) for s in shifts]), np.array([np.sqrt(np.diag(s.covariance)) for s in shifts])


@pytest.mark.parametrize(("number", "size", "light"), [(3, 60, 0.0), (6, 60, 0.0), (4, 60, 0.15), (6, 100, 0.0)])
def test_things_that_cross_cost_no_more_than_their_part_of_the_picture(number: int, size: int, light: float) -> None:
    speeds = ((2.2, 0.3), (-3.1, -0.4), (1.3, 1.0), (-1.7, -1.0), (4.0, 0.0), (-2.5, 0.7))
    things = [
        synthetic.Thing(
            40 + 53 * k % 240, 40 + 37 * k % 160, *speeds[k], size, 0.7 * size, seed=k, level=(170, 60, 200, 90)[k % 4]
        )
        for k in range(number)
    ]
    drift = synthetic.auto_exposure(light) if light else None
    error, std = pulls(synthetic.moving_things(things, frames=24, exposure_drift=drift, seed=5))
    assert (np.abs(error) < 2 * std).mean() > 0.88
    assert np.sqrt((error**2).mean()) < 0.004
    assert std.max() < 0.006


def test_a_thing_that_crosses_the_made_flight_of_the_demo_leaves_its_displacements_sure() -> None:
    flight = make_flight(24, seed=1)
    images = [frame.image for frame in flight]
    shifts = [rsflow.estimate_shift(a, b) for a, b in itertools.pairwise(images)]
    # As in the demo, of what was ground in the frame before.
    ground = [np.where(flight.masks[k - 1][..., None] > 0, np.nan, flight.flow(k)) for k in range(1, 24)]
    error = np.array([(s.dx, s.dy) for s in shifts]) - [np.nanmean(flow, axis=(0, 1)) for flow in ground]
    std = np.array([np.sqrt(np.diag(shift.covariance)) for shift in shifts])
    assert std.max() < 0.004
    assert (np.abs(error) < 2 * std).mean() > 0.9


def test_which_of_two_motions_is_the_pictures_is_not_sure_where_both_fill_it() -> None:
    things = [synthetic.Thing(30 + 61 * k % 270, 30 + 43 * k % 190, 3, 0.6, 110, 88, seed=k) for k in range(8)]
    scene = synthetic.moving_things(things, frames=8, seed=5)
    assert 0.3 < (scene.labels > 0).mean() < 0.6
    for shift in map(estimate_shift, scene.images, scene.images[1:]):
        # It follows the ground, or says that it may be far off, or cannot tell.
        assert not shift.valid or abs(shift.dx) < 0.05 or shift.covariance[0, 0] > 0.2**2
