"""Made sets of corners: cameras, tilts, numbers of views, noise, and boards that are bent and printed as boards are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

import rsflow
from rsflow.calibration import Board

BOARD = Board((9, 6), 0.025)
SIZE = (640, 480)


@dataclass(frozen=True)
class MadeSet:
    """A camera and the corners that it sees in each view, with the tilt that they reach and their noise."""

    camera: rsflow.Camera
    corners: list[np.ndarray]
    tilt_deg: float
    noise_px: float

    @property
    def boards(self) -> list[np.ndarray]:
        return [BOARD.points()] * len(self.corners)

    def truth(self, coefficients: int) -> np.ndarray:
        lens = [*self.camera.distortion, *[0.0] * 12][:coefficients]
        return np.array([self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy, *lens])


def made_camera(rng: np.random.Generator, model: str) -> rsflow.Camera:
    width, height = SIZE
    middle = (width / 2 + rng.normal(0, 8), height / 2 + rng.normal(0, 8))
    if model == "fisheye":
        focal, lens = rng.uniform(0.3, 0.45) * width, (rng.uniform(-0.05, 0.05), rng.normal(0, 0.01), 0.0, 0.0)
    else:
        focal = rng.uniform(0.6, 1.6) * width
        share = min(1.0, focal / 500)
        lens = (rng.uniform(-0.35, 0.1) * share, rng.uniform(-0.05, 0.15) * share, *rng.normal(0, 5e-4, 2), 0.0)
    return rsflow.Camera(
        focal, focal * rng.uniform(0.995, 1.005), *middle, width=width, height=height, distortion=lens, model=model
    )


def seen(camera: rsflow.Camera, pose: tuple[np.ndarray, np.ndarray], points: np.ndarray) -> np.ndarray:
    at = points @ pose[0].T + pose[1]
    return np.asarray(camera.distort_points(at[:, :2] / at[:, 2:], normalized=True))


def made_poses(
    rng: np.random.Generator, camera: rsflow.Camera, count: int, tilt_deg: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Near and far, all over the picture, tilted to any side by up to `tilt_deg`, whole in the picture."""
    points = BOARD.points().astype(float)
    size, picture = (np.array(BOARD.size) + 1) * BOARD.square_size_m, np.array(SIZE)
    poses: list[tuple[np.ndarray, np.ndarray]] = []
    while len(poses) < count:
        tilt, side = math.radians(rng.uniform(0, tilt_deg)), rng.uniform(0, 2 * math.pi)
        share, roll = rng.uniform(0.4, 0.75), rng.uniform(-0.3, 0.3)
        turn = cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0]
        turn = cv2.Rodrigues(tilt * np.array([math.cos(side), math.sin(side), 0.0]))[0] @ turn
        distance = float((np.array([camera.fx, camera.fy]) * size / (share * picture)).max())
        centre = (picture - 1) / 2 + rng.uniform(-0.5, 0.5, 2) * (1 - share) * picture
        place = np.append(camera.undistort_points(centre[None], normalized=True)[0], 1.0) * distance
        if camera.model == "fisheye":
            place *= rng.uniform(0.55, 0.9) * distance / np.linalg.norm(place)
        pose = turn, place - turn @ points.mean(axis=0)
        if ((points @ turn.T + pose[1])[:, 2] <= 0.02).any():
            continue
        pixels = seen(camera, pose, points)
        if np.isfinite(pixels).all() and (pixels > 3).all() and (pixels < picture - 4).all():
            poses.append(pose)
    return poses


def made_set(
    seed: int, *, model: str = "pinhole", tilt_deg: float | None = None, count: int | None = None, perfect: bool = False
) -> MadeSet:
    """Make 4 to 20 views at tilts of up to 0 to 40 degrees.

    Unless `perfect`, the board is bent by some 0.3 mm, stretched by 0.05 %, and its corners printed 0.02 mm off; each
    view has errors that its corners share; and three sets in ten have one corner in a hundred 2 pixels off.
    """
    rng = np.random.default_rng(seed)
    camera = made_camera(rng, model)
    count = int(rng.integers(4, 21)) if count is None else count
    tilt_deg = float(rng.uniform(0, 40)) if tilt_deg is None else tilt_deg
    noise, outliers = float(rng.uniform(0.03, 0.12)), rng.random() < 0.3
    points = BOARD.points().astype(float)
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    u, v = flat.T / (np.ptp(flat[:, 0]) / 2)
    if not perfect:
        bend = rng.normal(0, 0.0003, 3)
        points[:, 2] = bend[0] * u * u + bend[1] * u * v + bend[2] * v * v
        points[:, :2] += flat[:, :1] * rng.normal(0, (0.0005, 0.0003)) + rng.normal(0, 2e-5, flat.shape)
    corners = []
    for pose in made_poses(rng, camera, count, tilt_deg):
        pixels = seen(camera, pose, points) + rng.normal(0, noise, flat.shape)
        if not perfect:
            pixels += 0.3 * noise * (np.stack([u, v], axis=1) ** 2 @ rng.normal(0, 1, (2, 2)))
            if outliers:
                off = rng.random(len(points)) < 0.01
                pixels[off] += rng.normal(0, 2, (int(off.sum()), 2))
        corners.append(pixels.astype(np.float32))
    return MadeSet(camera, corners, tilt_deg, noise)
