"""Arrows stand where motion is beyond its uncertainty, and each thing has one."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

import rsflow
from rsflow.extraction.motion_arrows import chosen, draw_motion
from rsflow.plotting import QuiverStyle, drawing
from rsflow.segmentation.object_table import TrackedObject
from rsflow.segmentation.result import MotionSegmentation, SegmentationStatus

HEIGHT, WIDTH = 240, 320
STYLE = QuiverStyle(step=16, scale=5, key=False)


def texture(seed: int, height: int = HEIGHT + 40, width: int = WIDTH + 40) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 1, (height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return np.asarray(128 + 45 * smooth / smooth.std(), np.float32)


def noisy(picture: np.ndarray, deviation: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, deviation, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def seen(image: np.ndarray, moving: np.ndarray, velocity: tuple[float, float], camera: tuple[float, float] = (0, 0)):
    """What a segmenter that makes no mistake would say."""
    things = ()
    if moving.any():
        rows, columns = np.nonzero(moving)
        left, top = int(columns.min()), int(rows.min())
        box = (left, top, int(columns.max()) - left + 1, int(rows.max()) - top + 1)
        things = (TrackedObject(1, float(columns.mean()), float(rows.mean()), box, len(rows), *velocity, 5),)
    return MotionSegmentation(
        image=image,
        moving=moving,
        residual=np.zeros(moving.shape, np.float32),
        camera_motion=np.array([[1.0, 0, camera[0]], [0, 1, camera[1]], [0, 0, 1]]),
        camera_model="translation" if any(camera) else "static",
        parallax=False,
        objects=things,
        labels=moving.astype(np.int32),
        background=image.astype(np.float32),
        status=SegmentationStatus.OK,
    )


NOTHING = np.zeros((HEIGHT, WIDTH), bool)


@pytest.mark.parametrize("deviation", [1, 3, 8])
def test_noise_has_no_arrow(deviation: float) -> None:
    scene = texture(1)[:HEIGHT, :WIDTH]
    # Weak texture on one half: there the flow is least sure.
    scene[:, : WIDTH // 2] = 128 + (scene[:, : WIDTH // 2] - 128) * 0.05
    drawn = 0
    for seed in range(6):
        one, two = noisy(scene, deviation, 2 * seed), noisy(scene, deviation, 2 * seed + 1)
        flow = rsflow.dense_flow(one, two, preset="fast", covariance=True)
        _, _, things, still = chosen(flow, seen(two, NOTHING, (0, 0)), STYLE.step)
        assert not still.any()
        drawn += int(things.sum())
    assert drawn <= 1


def thing_that_moves(camera: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    ground, thing = texture(2), texture(3)
    frames = []
    for number in (0, 1):
        x, y = 20 - camera[0] * number, 20 - camera[1] * number
        frame = ground[y : y + HEIGHT, x : x + WIDTH].copy()
        left, top = 100 + (3 + camera[0]) * number, 80 + (1 + camera[1]) * number
        frame[top : top + 80, left : left + 80] = thing[:80, :80]
        frames.append(noisy(frame, 2, number))
    moving = NOTHING.copy()
    moving[top : top + 80, left : left + 80] = True
    return frames[0], frames[1], moving


@pytest.mark.parametrize("camera", [(0, 0), (-4, 2)])
def test_a_thing_has_arrows_and_what_stands_still_has_those_of_the_camera(camera: tuple[int, int]) -> None:
    one, two, moving = thing_that_moves(camera)
    flow = rsflow.dense_flow(one, two, preset="fast", covariance=True)
    points, vectors, things, scene = chosen(flow, seen(two, moving, (3, 1), camera), STYLE.step)
    assert 6 <= things.sum() <= 30
    near = cv2.dilate(moving.view(np.uint8), np.ones((21, 21), np.uint8)) > 0
    columns, rows = points[things].astype(int).T
    assert near[rows, columns].all()
    np.testing.assert_allclose(np.median(vectors[things], axis=0), np.add((3, 1), camera), atol=0.1)
    assert 0.17 < scene.mean() <= 0.25 if any(camera) else not scene.any()


def test_a_thing_whose_pixels_tell_nothing_has_the_arrow_of_its_mean() -> None:
    one, two, moving = thing_that_moves((-4, 2))
    flow = rsflow.dense_flow(one, two, preset="fast", covariance=True)
    lost = dataclasses.replace(flow, valid=np.zeros_like(flow.valid))
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    out = draw_motion(picture, lost, seen(two, moving, (3, 1), (-4, 2)), STYLE)
    color = np.array(drawing.distinct_color(1))
    rows, columns = np.nonzero(np.abs(out.astype(int) - color).max(axis=2) < 60)
    # From where its centre was, against the camera's motion and with its own, five times as long: (-1, 3) px.
    start = np.array([moving.nonzero()[1].mean() + 1, moving.nonzero()[0].mean() - 3])
    assert abs(rows.min() - start[1]) <= 2
    assert abs(rows.max() - (start[1] + 15)) <= 2
    assert np.abs(columns - start[0]).max() <= 9
    still = draw_motion(picture, lost, seen(two, moving, (4, -2), (-4, 2)), STYLE)
    assert 5 <= np.count_nonzero(still.any(axis=2)) <= 60, "a dot"
    unknown = draw_motion(picture, lost, seen(two, moving, (np.nan, np.nan)), STYLE)
    assert not unknown.any()


@pytest.mark.parametrize("few", [0, 200])
def test_lines_of_many_colours_have_a_dark_rim_and_stay_inside(few: int, monkeypatch: pytest.MonkeyPatch) -> None:
    out = np.full((60, 80, 3), 200, np.uint8)
    lines = [np.array([[10.0, 10], [40, 10]]), np.array([[10.0, 30], [400, 30]]), np.array([[-50.0, -50], [-20, -20]])]
    monkeypatch.setattr(drawing, "_FEW_LINES", few)
    drawing.rimmed(out, drawing.Strokes(lines, [(0, 0, 255), (0, 255, 0), (255, 0, 0)], 2))
    assert (out[10, 15:35, 2] > 200).all()
    assert (out[10, 15:35, :2] < 40).all()
    assert (out[30, 15:, 1] > 200).all()
    assert (out[12, 15:35] < 150).all()
    assert (out[45:] == 200).all()
    before = out.copy()
    drawing.rimmed(out, drawing.Strokes([], (1, 2, 3)))
    drawing.rimmed(out, drawing.Strokes([lines[2]], (1, 2, 3)))
    np.testing.assert_array_equal(out, before)
