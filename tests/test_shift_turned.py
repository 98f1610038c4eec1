"""Windows that turn, grow or are sheared: the displacement of their centre, or none, and deviations that hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from rsflow import estimate_shift
from shift_helpers import scene


def turned(matrix: np.ndarray, shift: np.ndarray, size: int, seed: int) -> list[np.ndarray]:
    """Two frames, of which the second shows the first turned about its centre and moved, with noise."""
    big = scene(size + 80, size + 80, sigma=1.5, seed=seed)
    centre = (np.array(big.shape) - 1) / 2
    y, x = np.mgrid[0:size, 0:size] - (size - 1) / 2
    frames = []
    for way, by in ((np.eye(2), np.zeros(2)), (matrix, shift)):
        back = np.linalg.inv(way) @ np.stack([x.ravel() - by[0], y.ravel() - by[1]])
        seen = ndimage.map_coordinates(big, [back[1] + centre[0], back[0] + centre[1]], order=5)
        frames.append(seen.reshape(size, size))
    rng = np.random.default_rng(seed + 1)
    return [(frame + rng.standard_normal(frame.shape)).astype(np.float32) for frame in frames]


def rotation(degrees: float) -> np.ndarray:
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[cos, -sin], [sin, cos]])


@pytest.mark.parametrize(
    "matrix", [rotation(1.0), rotation(-2.0), 1.02 * np.eye(2), np.array([[1.0, 0.03], [0.0, 1.0]])]
)
def test_a_window_that_deforms_tells_how_far_its_centre_moved(matrix):
    told, off = 0, []
    for seed in range(10):
        by = np.random.default_rng(seed).uniform(-3, 3, 2)
        shift = estimate_shift(*turned(matrix, by, 128, seed))
        if shift.valid:
            told += 1
            error = np.array([shift.dx, shift.dy]) - by
            off.append([np.hypot(*error), *np.abs(error) / np.sqrt(np.diag(shift.covariance))])
            # Without deformation="affine" no gradient is told.
            assert not shift.gradient.any()
            assert not shift.joint_covariance[2:].any()
    assert told >= 8
    assert np.median(off, axis=0)[0] < 0.01
    assert np.max(off, axis=0)[0] < 0.05
    assert np.mean(np.array(off)[:, 1:] < 3) > 0.8


def test_deviations_allow_for_a_moving_shadow_over_a_window_that_turns():
    y, x = np.mgrid[0:128, 0:128] - 63.5
    sure = 0
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        by, angle, at = rng.uniform(-3, 3, 2), rng.uniform(0, 2 * np.pi), rng.uniform(-20, 20)
        frames = turned(rotation(1.0), by, 128, seed)
        across = x * np.cos(angle) + y * np.sin(angle)
        lit = [np.where(across < at + move, 0.55, 1.0) for move in (0.0, 8.0)]
        shift = estimate_shift(*((frame * light).astype(np.float32) for frame, light in zip(frames, lit, strict=True)))
        if shift.valid:
            error = np.array([shift.dx, shift.dy]) - by
            sure += bool(np.any((np.abs(error) > 0.3) & (np.abs(error) > 4 * np.sqrt(np.diag(shift.covariance)))))
    assert sure <= 2
