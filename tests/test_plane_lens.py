"""The lens of the plane's motion is OpenCV's: points that OpenCV pictures from two poses give that motion back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsflow import Camera
from rsflow.velocity.chain import plane

SIZE = {"width": 320, "height": 240}
LENSES = {
    "none": Camera(300.0, 310.0, 158.0, 121.0, **SIZE),
    "five": Camera(300.0, 310.0, 158.0, 121.0, **SIZE, distortion=(-0.28, 0.11, 0.002, -0.001, -0.02)),
    "rational": Camera(
        300.0, 310.0, 158.0, 121.0, **SIZE,
        distortion=(0.2, -0.1, 0.001, 0.002, 0.01, 0.45, -0.05, 0.02, 0.001, -0.0005, 0.0008, 0.0003),
    ),
    "fisheye": Camera(120.0, 121.0, 158.0, 121.0, **SIZE, distortion=(0.02, -0.006, 0.001, -0.0003), model="fisheye"),
}  # fmt: skip


def pictured(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Pixels of points in the camera's axes, by OpenCV."""
    zero = np.zeros(3)
    coefficients = np.array(camera.distortion, dtype=np.float64)
    project = cv2.fisheye.projectPoints if camera.model == "fisheye" else cv2.projectPoints
    pixels = project(points[None].copy(), zero, zero, camera.matrix, coefficients)[0]
    return np.asarray(pixels.reshape(-1, 2))


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_points_that_opencv_pictures_give_the_motion(name: str, seed: int) -> None:
    camera, rng = LENSES[name], np.random.default_rng(seed)
    turn, way = rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.08, 0.08, 3)
    down = Rotation.from_euler("xy", rng.uniform(-0.3, 0.3, 2)).apply((0.0, 0.0, 1.0))
    before = np.column_stack([rng.uniform((-0.45, -0.35), (0.45, 0.35), (80, 2)), np.ones(80)])
    # In the axes of the second pose, the plane is at down . X = 1; the way is in the axes half-way.
    half, back = Rotation.from_rotvec(0.5 * turn), Rotation.from_rotvec(turn)
    moved = half.inv().apply(way)
    across = back.inv().apply(before)
    depth = (1.0 + down @ moved) / (across @ down)
    after = across * depth[:, None] - moved
    covariances = np.tile((1e-2, 0.0, 1e-2), (80, 1))
    matches = np.hstack([pictured(camera, before), pictured(camera, after), covariances])
    interval = plane.Interval(np.zeros(3), down, 0.02, 0.0)
    found = plane.Follower(camera).fit(interval, matches, np.eye(3), ())
    assert found is not None
    np.testing.assert_allclose(found.values, [*way, *turn], atol=1e-8)
