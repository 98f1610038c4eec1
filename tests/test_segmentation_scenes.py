"""What moves in made scenes, against exact masks: cameras, light, pauses, depth, types of frames, threads, states."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable
from typing import Any

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import MotionSegmentation, MotionSegmenter, synthetic
from rsflow.synthetic import MovingThings, Sensor, Thing, moving_things

SIZE = (208, 160)
# Samples of the scene are few before.
LEARNED = 8


def clip(things: Any = 2, *, frames: int = 30, size: tuple[int, int] = SIZE, **options: Any) -> MovingThings:
    return moving_things(things, frames=frames, size=size, seed=3, **options)


def mode(scene: MovingThings) -> str:
    return "static" if scene.camera == "static" else "moving"


def segmented(scene: MovingThings, images: Iterable[np.ndarray] | None = None) -> list[MotionSegmentation]:
    segmenter = MotionSegmenter(camera_motion=mode(scene))
    return [segmenter.update(image) for image in (scene.images if images is None else images)]


def scores(scene: MovingThings, results: list[MotionSegmentation]) -> tuple[float, float]:
    """F of the pixels that move, and the share of the still ones that are called so, beyond a pixel of the edges."""
    found = np.array([result.moving for result in results])[LEARNED:]
    true = scene.masks[LEARNED:]
    hits = np.count_nonzero(found & true)
    wide = np.array([cv2.dilate(mask.view(np.uint8), np.ones((5, 5), np.uint8)) > 0 for mask in true])
    return 2 * hits / (found.sum() + true.sum()), np.count_nonzero(found & ~wide) / np.count_nonzero(~wide)


@pytest.mark.parametrize("camera", ["static", "pan", "zoom", "turn", "hand_held"])
def test_masks_are_right_with_any_camera(camera: str) -> None:
    scene = clip(camera=camera)
    score, wrong = scores(scene, segmented(scene))
    print(camera, round(score, 3), wrong)
    assert score > 0.85
    assert wrong < 0.005


@pytest.mark.parametrize("camera", ["static", "hand_held"])
def test_what_moves_slower_than_a_frame_tells_is_seen(camera: str) -> None:
    scene = clip(2, camera=camera, speed_px=0.3, frames=45)
    score, wrong = scores(scene, segmented(scene))
    print(camera, round(score, 3), wrong)
    assert score > 0.7
    assert wrong < 0.005


LIGHTS: dict[str, Callable[[float], Any]] = {
    "switch": synthetic.light_switch(0.6, 0.4, 0.7, plus=3.0),
    "clouds": synthetic.passing_clouds(0.6, seed=1),
    "exposure": synthetic.auto_exposure(0.2, period_s=1.5),
}


# What is still missed, with what was measured: each fails as soon as it is mended.
LOW_BOXES = pytest.param("sideways", marks=pytest.mark.xfail(strict=True, reason="depth is not told: 2.4 % move"))


@pytest.mark.parametrize(
    ("light", "camera"),
    [(light, camera) for light in LIGHTS for camera in ("static", "hand_held")],
)
def test_masks_are_right_in_light_that_changes(light: str, camera: str) -> None:
    scene = clip(camera=camera, exposure_drift=LIGHTS[light])
    score, wrong = scores(scene, segmented(scene))
    print(light, camera, round(score, 3), wrong)
    assert score > 0.8
    assert wrong < 0.005


@pytest.mark.parametrize("camera", ["static", "pan", "zoom", "hand_held"])
@pytest.mark.parametrize("light", [None, "switch", "clouds"])
def test_nothing_moves_in_an_empty_scene(camera: str, light: str | None) -> None:
    scene = clip(0, camera=camera, exposure_drift=None if light is None else LIGHTS[light])
    assert [np.count_nonzero(result.moving) for result in segmented(scene)] == [0] * len(scene)


def swaying(images: np.ndarray, where: tuple[slice, slice], reach: float) -> np.ndarray:
    """Let part of the scene go to and fro."""
    images = images.copy()
    height, width = images.shape[1:]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    for k, image in enumerate(images):
        at = (x + reach * np.float32(np.sin(0.8 * k)), y + reach * np.float32(np.cos(1.1 * k)))
        image[where] = cv2.remap(image, *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)[where]
    return images


@pytest.mark.parametrize("camera", ["static", "hand_held"])
def test_leaves_are_learned_and_what_walks_past_them_is_seen(camera: str) -> None:
    scene = clip(0, frames=70, camera=camera, contrast_levels=25.0)
    things = clip(1, frames=70, camera=camera, contrast_levels=25.0)
    leaves = (slice(0, 60), slice(20, 120))
    results = segmented(scene, swaying(scene.images, leaves, 1.2))
    shares = [float(result.moving.mean()) for result in results]
    print(camera, [round(share, 3) for share in shares[::5]])
    assert max(shares[45:]) < 0.02
    with_things = segmented(things, swaying(things.images, leaves, 1.2))
    found = np.array([result.moving for result in with_things])[45:]
    outside = things.masks[45:].copy()
    outside[:, leaves[0], leaves[1]] = False
    assert np.count_nonzero(found & outside) > 0.85 * np.count_nonzero(outside)


@pytest.mark.parametrize("ground", ["texture", "plain to the right"])
def test_a_shadow_is_taken_away_with_its_edges(ground: str) -> None:
    still = np.clip(synthetic.texture(SIZE[::-1], "fine", seed=4) * 20.0 + 120.0, 40, 200)
    if ground != "texture":
        # What shadows leave of the light was seen on the left.
        still[:, 110:] = 130.0
    rng = np.random.default_rng(5)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float32)
    segmenter, wrong, missed = MotionSegmenter(camera_motion="static"), [], []
    for k in range(40):
        picture = still.copy()
        left = 20 + 3 * max(k - 10, 0)
        if k >= 10:
            distance = ((x - left - 30) / 30) ** 2 + ((y - 100) / 9) ** 2
            picture *= 1.0 - 0.4 / (1.0 + np.exp(np.clip(8.0 * (distance - 1.0), -50, 50)))
            picture[60:100, left : left + 16] = 220.0
        thing = np.zeros(picture.shape, bool)
        if k >= 10:
            thing[60:100, left : left + 16] = True
        frame = np.clip(np.rint(picture + rng.normal(0, 1.2, picture.shape)), 0, 255).astype(np.uint8)
        moving = segmenter.update(frame).moving
        if k >= 14:
            wrong.append(np.count_nonzero(moving & ~thing) / np.count_nonzero(thing))
            missed.append(np.count_nonzero(thing & ~moving) / np.count_nonzero(thing))
    print(np.mean(wrong), np.mean(missed))
    assert np.mean(wrong) < 0.25
    assert np.mean(missed) < 0.1


def test_noise_is_nothing_that_moves() -> None:
    scene = clip(0, sensor=Sensor(noise=8.0, blur_px=0.7))
    assert sum(np.count_nonzero(result.moving) for result in segmented(scene)) == 0


@pytest.mark.parametrize("camera", ["static", "hand_held"])
def test_what_stops_is_still_a_thing_and_goes_on_as_one(camera: str) -> None:
    scene = clip(2, camera=camera, stop_frames=15, frames=40)
    results = segmented(scene)
    score, wrong = scores(scene, results)
    print(camera, round(score, 3), wrong)
    assert score > 0.85
    assert wrong < 0.002


@pytest.mark.parametrize("camera", ["static", "pan"])
def test_no_ghost_stays_where_a_thing_was_at_first(camera: str) -> None:
    # It stands for six frames, so that it is all that was ever seen there.
    thing = Thing(60.0, 80.0, dx=3.0, width=36.0, height=30.0, stops=((1, 7),))
    scene = clip([thing], camera=camera, frames=40)
    start = scene.masks[0]
    ghosts = []
    for result, mask, homography in zip(segmented(scene), scene.masks, scene.homographies, strict=True):
        there = cv2.warpPerspective(start.view(np.uint8), homography, SIZE, flags=cv2.INTER_NEAREST) > 0
        wide = cv2.dilate(mask.view(np.uint8), np.ones((9, 9), np.uint8)) > 0
        ghosts.append(np.count_nonzero(result.moving & there & ~wide) / np.count_nonzero(start))
    print(camera, np.round(ghosts, 2))
    assert max(ghosts[30:]) < 0.05


@pytest.mark.parametrize("camera", [LOW_BOXES, "forward"])
def test_boxes_on_the_ground_stand_still(camera: str) -> None:
    width, height = SIZE
    walker = Thing(
        0.7 * width, 0.15 * height, dx=0.9, dy=2.8, width=0.1 * width, height=0.2 * width, shape="walker", level=190.0
    )
    scene = clip([walker], camera=camera, boxes=5, box_height=0.15, frames=40)
    results = segmented(scene)
    found = np.array([result.moving for result in results])[LEARNED:]
    true = scene.masks[LEARNED:]
    wide = np.array([cv2.dilate(mask.view(np.uint8), np.ones((5, 5), np.uint8)) > 0 for mask in true])
    recall, wrong = np.count_nonzero(found & true) / np.count_nonzero(true), (found & ~wide).mean()
    print(camera, round(recall, 3), wrong)
    assert recall > 0.8
    assert wrong < 0.005


@pytest.mark.parametrize("camera", ["static", "hand_held"])
def test_deep_and_floating_frames_give_nearly_the_same_masks(camera: str) -> None:
    scene = clip(camera=camera, frames=16)
    eight = segmented(scene)
    others = {
        "uint16": (image.astype(np.uint16) * 257 for image in scene.images),
        "12 bits over an offset": (image.astype(np.uint16) * 4 + 60_000 for image in scene.images),
        "float32": (image.astype(np.float32) / 255 for image in scene.images),
    }
    for name, images in others.items():
        for result, like in zip(segmented(scene, images), eight, strict=True):
            unlike = np.count_nonzero(result.moving ^ like.moving)
            assert unlike <= 0.1 * max(np.count_nonzero(like.moving), 100), name
        there = np.isfinite(like.background) & np.isfinite(result.background)
        told = (result.background[there] - result.image.min()) / (float(np.ptp(result.image)) or 1.0)
        expected = (like.background[there] - like.image.min()) / np.ptp(like.image)
        assert np.median(np.abs(told - expected)) < 0.01, name


def test_a_dark_beginning_does_not_set_the_levels() -> None:
    scene = clip(frames=16)
    images = [np.zeros(SIZE[::-1], np.float32)] * 3 + [image.astype(np.float32) / 255 for image in scene.images]
    segmenter = MotionSegmenter(camera_motion="static")
    results = [segmenter.update(image) for image in images]
    assert [str(result.status) for result in results[:5]] == ["first_frame", "ok", "ok", "first_frame", "ok"]
    assert scores(scene, results[3:])[0] > 0.85
    # A light that is switched on in the middle of it is a beginning as well.
    result = segmenter.update(images[-1] * 20)
    assert result.status == "first_frame"
    assert not result.moving.any()
    assert not result.labels.any()
    assert segmenter.update(images[-1] * 20).valid


@pytest.mark.parametrize("camera", ["static", "pan"])
def test_one_thread_and_two_give_the_same_bits(camera: str) -> None:
    scene = clip(camera=camera, frames=5, size=(640, 480), speed_px=6.0)
    threads = rsflow.get_num_threads()
    found = []
    try:
        for count in (1, 2):
            rsflow.set_num_threads(count)
            found.append(segmented(scene))
    finally:
        rsflow.set_num_threads(threads)
    assert found[0][-1].moving.any()
    for one, two in zip(*found, strict=True):
        for name in ("moving", "residual", "background", "labels", "camera_motion"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name), name)


def test_a_pickle_goes_on_after_the_canvas_has_moved() -> None:
    scene = clip(camera="pan", camera_speed=6.0, frames=24)
    segmenter = MotionSegmenter()
    for image in scene.images[:18]:
        segmenter.update(image)
    other = pickle.loads(pickle.dumps(segmenter))
    for image in scene.images[18:]:
        one, two = segmenter.update(image), other.update(image)
        for name in ("moving", "residual", "background", "labels", "camera_motion"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name), name)
        assert repr(one.objects) == repr(two.objects)


def test_a_result_stays_as_it_was() -> None:
    scene = clip(camera="hand_held", frames=6)
    segmenter = MotionSegmenter()
    results, kept = [], []
    for image in scene.images:
        results.append(segmenter.update(image))
        kept.append({name: np.array(value) for name, value in vars(results[-1]).items() if hasattr(value, "dtype")})
    for result, before in zip(results, kept, strict=True):
        for name, value in before.items():
            np.testing.assert_array_equal(getattr(result, name), value, name)


def test_flow_that_is_given_in_full_size_is_as_good() -> None:
    scene = clip(camera="pan", frames=18, size=(520, 400), speed_px=5.0, textured=True)
    segmenter, flow = MotionSegmenter(), rsflow.DenseFlow(preset="fast")
    results = [segmenter.update(image, flow=flow.update(image)) for image in scene.images]
    own = segmented(scene)
    assert scores(scene, own)[0] > 0.8
    assert scores(scene, results)[0] > scores(scene, own)[0] - 0.03
    for result in (results[-1], own[-1]):
        # Of the whole frame's pixels, whatever the flow was measured on.
        assert np.nanquantile(result.residual[scene.masks[-1]], 0.9) == pytest.approx(5.0, rel=0.12)
