"""Scenes with depth before a camera that travels, rendered with true depth: what stands still does not move."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import skimage.data

from rsflow.segmentation import MotionSegmenter

HEIGHT, WIDTH, FOCAL = 200, 264, 240.0
# Texture pixels of a unit of the world; the camera is one unit above the ground.
SCALE = 260.0


def texture(name: str) -> np.ndarray:
    image = cv2.GaussianBlur(getattr(skimage.data, name)().astype(np.float32), (0, 0), 1.0)
    return 30 + (image - image.min()) * 200 / np.ptp(image)


TEXTURES = [texture(name) for name in ("gravel", "brick", "grass")]
# Middles of boxes, in units.
PLACES = [(-0.33, -0.24), (0.28, 0.22), (0.3, -0.25), (-0.32, 0.2), (0.0, -0.3), (0.02, 0.3)]


def looked_up(number: int, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    at = [(part * SCALE + 1000) % 512 for part in (u, v)]
    return cv2.remap(
        TEXTURES[number], *(part.astype(np.float32) for part in at), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
    )


def seen_from(
    camera: np.ndarray, boxes: list[tuple[float, float]], height: float, mover: np.ndarray, finer: int
) -> tuple[np.ndarray, np.ndarray]:
    """The picture straight down from a place, by rays; and where the disk on the ground is that moves."""
    x, y = np.meshgrid((np.arange(WIDTH * finer) + 0.5) / finer - 0.5, (np.arange(HEIGHT * finer) + 0.5) / finer - 0.5)
    ray = np.stack([(x - (WIDTH - 1) / 2) / FOCAL, (y - (HEIGHT - 1) / 2) / FOCAL, -np.ones(x.shape)], -1)
    far = camera[2] / -ray[..., 2]
    ground = camera + ray * far[..., None]
    image = looked_up(0, ground[..., 0], ground[..., 1])
    from_middle = ground[..., :2] - mover
    moves = (from_middle**2).sum(-1) < 0.075**2
    image[moves] = 0.8 * looked_up(2, from_middle[..., 0], from_middle[..., 1])[moves] + 20
    for column, row in boxes:
        low, high = np.array([column - 0.06, row - 0.06, 0]), np.array([column + 0.06, row + 0.06, height])
        with np.errstate(divide="ignore"):
            sides = np.stack([(low - camera) / ray, (high - camera) / ray])
        near, away = sides.min(0), sides.max(0)
        into, face = near.max(-1), near.argmax(-1)
        hit = (into < away.min(-1)) & (into < far)
        far = np.where(hit, into, far)
        at = camera + ray * into[..., None]
        u, v = np.where(face == 0, at[..., 1], at[..., 0]), np.where(face == 2, at[..., 1], at[..., 2])
        lit = looked_up(1, u + column, v + row) * np.where(face == 2, 1.0, 0.8)
        image, moves = np.where(hit, lit, image), moves & ~hit
    return image, moves


def clip(
    travel: tuple[float, float, float],
    boxes: int,
    height: float,
    own: tuple[float, float],
    *,
    frames: int = 9,
    at: tuple[float, float] = (-0.02, 0.05),
    finer: int = 1,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Frames of a camera that travels so many pixels a frame, over boxes and a disk that moves by `own` pixels.

    With `finer` each of these pixels is so many along both axes.
    """
    rng = np.random.default_rng(5)
    out = []
    for k in range(frames):
        camera = np.array([0, 0, 1.0]) + np.array(travel) / FOCAL * (k - frames / 2)
        mover = np.array(at) + np.array(own) / FOCAL * (k - frames / 2)
        image, moves = seen_from(camera, PLACES[:boxes], height, mover, finer)
        out.append((np.clip(image + rng.normal(0, 2, image.shape), 0, 255).round().astype(np.uint8), moves))
    return out


SIDEWAYS, DOWN = (3.0, 0.6, 0.0), (0.0, 0.0, -7.0)


@pytest.mark.parametrize("travel", [SIDEWAYS, DOWN], ids=["sideways", "forward"])
@pytest.mark.parametrize(("boxes", "height"), [(1, 0.35), (4, 0.15), (4, 0.3), (6, 0.35)])
def test_boxes_stand_still_and_the_mover_moves(travel, boxes, height) -> None:
    segmenter = MotionSegmenter(camera_motion="moving")
    wrong, recall, depth = [], [], []
    for image, moves in clip(travel, boxes, height, (-0.7, 3.0) if travel is SIDEWAYS else (3.0, 0.0)):
        result = segmenter.update(image)
        near = cv2.dilate(moves.astype(np.uint8), np.ones((9, 9))).astype(bool)
        wrong.append((result.moving & ~near).mean())
        recall.append((result.moving & moves).sum() / moves.sum())
        depth.append(result.parallax)
    print(boxes, height, np.round(wrong, 3), np.round(recall, 2), depth)
    assert depth[-1]
    assert np.mean(wrong[5:]) < 0.03
    assert np.median(recall[3:]) > 0.8


@pytest.mark.parametrize("own", [(0.7, 3.0), (3.0, 0.6), (-1.5, -2.5)])
def test_what_moves_by_itself_over_a_plane_is_not_depth(own) -> None:
    segmenter = MotionSegmenter(camera_motion="moving")
    for k, (image, moves) in enumerate(clip(SIDEWAYS, 0, 0.0, own)):
        result = segmenter.update(image)
        assert not result.parallax
        if k > 2:
            assert (result.moving & moves).sum() > 0.7 * moves.sum()


def test_what_moves_as_no_depth_does_is_told() -> None:
    # The ground goes to the left, what is nearer further so; against that, nothing still goes.
    segmenter = MotionSegmenter(camera_motion="moving")
    results = [(segmenter.update(image), moves) for image, moves in clip((3.0, 0.0, 0.0), 6, 0.3, (3.0, 0.0))]
    result, moves = results[-1]
    assert result.parallax
    assert (result.moving & moves).sum() > 0.8 * moves.sum()


def test_depth_is_told_in_frames_whose_flow_is_reduced() -> None:
    frames = clip(SIDEWAYS, 4, 0.3, (-0.7, 3.0), finer=2)
    segmenter = MotionSegmenter(camera_motion="moving")
    for k, (image, moves) in enumerate(frames):
        result = segmenter.update(image)
        near = cv2.dilate(moves.astype(np.uint8), np.ones((17, 17))).astype(bool)
        if k > 4:
            assert result.parallax
            assert (result.moving & ~near).mean() < 0.03
            assert (result.moving & moves).sum() > 0.8 * moves.sum()
