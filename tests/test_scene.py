"""The scene behind what moves: in colour, from before and after, in the light of the frame, carried by the camera."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsflow.objects import ObjectTracker
from rsflow.plotting import drawing, labels
from rsflow.segmentation.patches import parts_around, softened
from rsflow.segmentation.result import MotionSegmentation, SegmentationStatus
from rsflow.segmentation.scene import StaticScene

HEIGHT, WIDTH = 96, 128


def painting(seed: int, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """A smooth picture in colour."""
    noise = np.random.default_rng(seed).normal(0, 1, (height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    return np.clip(128 + 45 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def seen(picture: np.ndarray, moving: np.ndarray, motion: np.ndarray | None = None) -> MotionSegmentation:
    """What a segmenter that makes no mistake would say."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    things = ObjectTracker().update(moving) if moving.any() else ()
    return MotionSegmentation(
        image=grey,
        moving=moving,
        residual=np.zeros(moving.shape, np.float32),
        camera_motion=np.eye(3) if motion is None else motion,
        camera_model="static" if motion is None else "translation",
        parallax=False,
        objects=things,
        labels=moving.astype(np.int32),
        background=grey.astype(np.float32),
        status=SegmentationStatus.OK,
    )


def passing(frame: int, *, speed: int = 4, size: int = 24, start: int = 8) -> np.ndarray:
    """The mask of a square that goes to the right."""
    moving = np.zeros((HEIGHT, WIDTH), bool)
    moving[30 : 30 + size, start + speed * frame : start + speed * frame + size] = True
    return moving


def film(scene: np.ndarray, masks: list[np.ndarray], seed: int = 9) -> list[np.ndarray]:
    """The scene, two levels of noise, and a red thing where the masks are."""
    rng = np.random.default_rng(seed)
    frames = []
    for mask in masks:
        frame = np.clip(scene + rng.normal(0, 2, scene.shape), 0, 255).astype(np.uint8)
        frame[mask] = (20, 20, 220)
        frames.append(frame)
    return frames


def test_behind_a_thing_is_the_scene_in_colour_from_before_and_after() -> None:
    scene = painting(1)
    masks = [passing(frame) for frame in range(20)]
    memory, ready = StaticScene(look_ahead=12), []
    for frame, mask in zip(film(scene, masks), masks, strict=True):
        ready += memory.add(seen(frame, mask), frame)
    assert len(ready) == 8
    ready += memory.finish()
    # The first thing stands where nothing was seen before it left.
    for number, (picture, mask) in enumerate(zip(ready, masks, strict=True)):
        error = np.abs(picture[mask].astype(int) - scene[mask])
        assert np.quantile(error, 0.95) < 12, number
    best, known = memory.best()
    assert known.all()
    assert np.quantile(np.abs(best.astype(int) - scene), 0.95) < 8


def test_what_nobody_saw_is_hatched() -> None:
    scene = painting(2)
    masks = [passing(0)] * 5
    memory, ready = StaticScene(), []
    for frame, mask in zip(film(scene, masks), masks, strict=True):
        ready += memory.add(seen(frame, mask), frame)
    assert set(np.unique(ready[-1][masks[0]])) == {70, 110}
    _, known = memory.best()
    assert not known[masks[0]].any()
    assert known[~passing(0, size=34, start=3)].mean() > 0.9


def test_a_thing_that_stood_for_a_while_is_not_the_scene() -> None:
    scene = painting(3)
    still = passing(0, start=60)
    nothing = np.zeros_like(still)
    # It stands there unnoticed at first, is gone for longer, and another comes by.
    masks = [nothing] * 20 + [nothing] * 60 + [still]
    frames = film(scene, masks)
    for frame in frames[:20]:
        frame[still] = (20, 20, 220)
    memory, ready = StaticScene(), []
    for frame, mask in zip(frames, masks, strict=True):
        ready += memory.add(seen(frame, mask), frame)
    for picture in (ready[-1], memory.best()[0]):
        assert np.quantile(np.abs(picture[still].astype(int) - scene[still]), 0.95) < 12


@pytest.mark.parametrize(("gain", "offset"), [(0.6, 0), (1.0, 40), (1.3, -20)])
def test_light_that_is_switched_changes_what_is_behind_too(gain: float, offset: float) -> None:
    scene = (painting(4) * 0.6 + 40).astype(np.uint8)
    masks = [passing(frame) for frame in range(20)]
    memory, ready = StaticScene(), []
    for number, (frame, mask) in enumerate(zip(film(scene, masks), masks, strict=True)):
        lit = np.clip(frame * (gain if number >= 12 else 1.0) + (offset if number >= 12 else 0), 0, 255).astype(
            np.uint8
        )
        ready += memory.add(seen(lit, mask), lit)
    expected = np.clip(scene * gain + offset, 0, 255)
    for number in (12, 13, 19):
        error = np.abs(ready[number][masks[number]] - expected[masks[number]])
        assert np.quantile(error, 0.9) < 14, number


def test_a_moving_camera_carries_the_scene() -> None:
    scene = painting(5, 200, 400)
    thing = passing(0, start=50)
    memory, ready, truth = StaticScene(look_ahead=8), [], []
    for number in range(30):
        x, y = 6 * number, 2 * number
        truth.append(scene[y : y + HEIGHT, x : x + WIDTH])
        frame = truth[-1].copy()
        frame[thing] = (20, 20, 220)
        motion = np.array([[1.0, 0, -6 if number else 0], [0, 1, -2 if number else 0], [0, 0, 1]])
        ready += memory.add(seen(frame, thing, motion), frame)
    ready += memory.finish()
    for number in range(3, 30):
        shown = ~np.isin(ready[number][thing], (70, 110)).all(axis=1)
        error = np.abs(ready[number][thing][shown].astype(int) - truth[number][thing][shown])
        assert shown.mean() > (0.95 if number > 4 else 0.5), number
        assert np.quantile(error, 0.9) < 12, number
    best, known = memory.best()
    assert known.mean() > 0.95
    assert np.quantile(np.abs(best[known].astype(int) - truth[-1][known]), 0.9) < 12


def test_a_scene_goes_on_from_its_state_and_begins_anew_after_a_cut() -> None:
    scene = painting(6)
    masks = [passing(frame) for frame in range(14)]
    frames = film(scene, masks)
    whole, first = StaticScene(), StaticScene()
    pictures = [whole.add(seen(frame, mask), frame)[0] for frame, mask in zip(frames, masks, strict=True)]
    for frame, mask in zip(frames[:7], masks[:7], strict=True):
        first.add(seen(frame, mask), frame)
    second = StaticScene()
    second.restore(first.state())
    for number in range(7, 14):
        (picture,) = second.add(seen(frames[number], masks[number]), frames[number])
        np.testing.assert_array_equal(picture, pictures[number])
    with pytest.raises(ValueError, match="damaged"):
        second.restore({**first.state(), "planes": first.state()["planes"][1:]})
    other = painting(7)
    cut = seen(other, np.zeros((HEIGHT, WIDTH), bool))
    object.__setattr__(cut, "status", SegmentationStatus.FIRST_FRAME)
    (picture,) = second.add(cut, other)
    np.testing.assert_array_equal(picture, other)
    for frame in film(other, masks[:8]):
        second.add(seen(frame, np.zeros((HEIGHT, WIDTH), bool)), frame)
    assert np.median(np.abs(second.best()[0].astype(int) - other)) < 4


def test_parts_hold_their_boxes_and_do_not_overlap() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        boxes = [tuple(int(n) for n in (*rng.integers(0, 120, 2), *rng.integers(1, 40, 2))) for _ in range(6)]
        parts = parts_around(boxes, (100, 130), 3)
        covered = np.zeros((100, 130), int)
        for left, top, right, bottom in parts:
            covered[top:bottom, left:right] += 1
        assert covered.max(initial=0) <= 1
        for left, top, wide, high in boxes:
            assert covered[top : top + high, left : left + wide].all()


def test_an_edge_is_soft_and_stays_where_it_is() -> None:
    mask = np.zeros((40, 40), bool)
    mask[:, 20:] = True
    share = softened(mask, 2)
    assert share[:, :17].max() == 0
    assert share[:, 23:].min() == 1
    np.testing.assert_allclose(share[:, 19] + share[:, 20], 1, atol=0.02)
    assert 0 < share[5, 19] < 0.5


def test_labels_keep_inside_and_apart() -> None:
    rng = np.random.default_rng(2)
    for _ in range(30):
        corners = rng.integers(-10, 190, (12, 2))
        boxes = [(int(x), int(y), int(x) + 30, int(y) + 20) for x, y in corners]
        texts = [str(number) for number in rng.integers(1, 2000, 12)]
        used = np.zeros((200, 200), int)
        placed = labels.placed(boxes, texts, (200, 200))
        for corner, text in zip(placed, texts, strict=True):
            if corner is not None:
                wide, high = drawing.text_size(text)
                x, y = corner
                assert x >= 0, corner
                assert x + wide <= 200
                assert y - high >= 0
                assert y <= 200
                used[y - high : y, x : x + wide] += 1
        assert used.max() <= 1
        assert sum(corner is not None for corner in placed) >= 10
    assert labels.placed([(0, 0, 5, 5)], ["12345"], (10, 10)) == [None]


def test_the_ground_is_shown_as_by_the_first_frame() -> None:
    scene = painting(8, 200, 400)
    nothing = np.zeros((HEIGHT, WIDTH), bool)
    memory = StaticScene()
    for number in range(31):
        x = 20 + 4 * number
        motion = np.array([[1.0, 0, -4 if number else 0], [0, 1, 0], [0, 0, 1]])
        frame = scene[50 : 50 + HEIGHT, x : x + WIDTH]
        memory.add(seen(frame, nothing, motion), frame)
    found = memory.ground((-10.0, -5.0), (300, 120), 1.0)
    assert found is not None
    picture, known = found
    truth = scene[45 : 45 + 120, 10:310]
    assert known[10:90, 130:250].mean() > 0.95, "what the last frames show"
    assert not known[:4].any()
    assert np.quantile(np.abs(picture[known].astype(int) - truth[known]), 0.95) < 8
    half = memory.ground((-10.0, -5.0), (150, 60), 0.5)
    assert half is not None
    assert abs(half[1].mean() - known.mean()) < 0.02


def test_what_nothing_told_of_the_first_frames_is_found_by_what_came_after() -> None:
    scene = painting(9)
    masks = [passing(frame, speed=6) for frame in range(16)]
    nothing = np.zeros((HEIGHT, WIDTH), bool)
    memory, ready = StaticScene(look_ahead=14), []
    for number, (frame, mask) in enumerate(zip(film(scene, masks), masks, strict=True)):
        # A segmenter that begins to see after three frames.
        ready += memory.add(seen(frame, mask if number >= 3 else nothing), frame)
    ready += memory.finish()
    for number in range(4):
        error = np.abs(ready[number][masks[number]].astype(int) - scene[masks[number]])
        assert np.quantile(error, 0.95) < 14, number
