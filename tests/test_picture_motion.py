"""Things that are followed by their own pictures: how far they go, what they are, and what is none."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from rsflow import synthetic
from rsflow.objects import ObjectTracker, TrackedObject
from rsflow.synthetic import Thing


def followed(scene: synthetic.MovingThings, **options: bool) -> list[tuple[TrackedObject, ...]]:
    """Follow the exact masks of a scene by its frames, without any flow."""
    tracker = ObjectTracker(min_area=12, min_age=2, **options)
    steps = [
        np.eye(3),
        *(b @ np.linalg.inv(a) for a, b in zip(scene.homographies, scene.homographies[1:], strict=False)),
    ]
    return [
        tracker.update(mask, None, step, image=frame.image)
        for frame, mask, step in zip(scene, scene.masks, steps, strict=True)
    ]


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("camera", ["static", "hand_held"])
def test_the_speed_of_a_thing_is_right_after_ten_frames(camera: str, dtype: str) -> None:
    thing = Thing(60.0, 70.0, dx=1.3, dy=-0.4, width=40.0, height=26.0, seed=4)
    scene = synthetic.moving_things([thing], frames=24, size=(160, 120), camera=camera, seed=3)
    if dtype != "uint8":
        images = scene.images.astype(dtype) * (257 if dtype == "uint16" else 1)
        scene = dataclasses.replace(scene, images=images.astype(dtype))
    for k, things in enumerate(followed(scene)):
        (one,) = things or (None,)
        if k > 10:
            assert one is not None
            true = scene.velocities_px[k, 0]
            off = math.hypot(one.vx_px_per_frame - true[0], one.vy_px_per_frame - true[1])
            assert off < 0.05 * math.hypot(*true), f"frame {k}"


def test_motion_of_the_ground_in_the_mask_does_not_hold_a_thing_back() -> None:
    thing = Thing(30.0, 60.0, dx=3.0, width=30.0, height=30.0, seed=4)
    scene = synthetic.moving_things([thing], frames=20, size=(160, 120), seed=3)
    tracker = ObjectTracker(min_area=12)
    for frame, mask in zip(scene, scene.masks, strict=True):
        # Flow of the ground: zero wherever the thing is.
        (one,) = tracker.update(mask, np.zeros((*mask.shape, 2), np.float32), image=frame.image)
    assert one.vx_px_per_frame == pytest.approx(3.0, rel=0.03)


def drifting(picture: Callable[[int], np.ndarray], frames: int = 24) -> list[tuple[TrackedObject, ...]]:
    """Follow a mask that drifts over pictures."""
    tracker = ObjectTracker(min_area=12, min_age=2, only_travelling=True)
    found = []
    for k in range(frames):
        mask = np.zeros((90, 160), bool)
        mask[30:50, 20 + 3 * k : 50 + 3 * k] = True
        found.append(tracker.update(mask, image=picture(k)))
    return found


def test_a_change_of_light_that_wanders_over_the_ground_is_no_thing() -> None:
    rng = np.random.default_rng(5)

    def noisy(k: int) -> np.ndarray:
        return np.clip(128 + rng.normal(0, 1.5, (90, 160)), 0, 255).astype(np.uint8)

    def with_thing(k: int) -> np.ndarray:
        out = noisy(k)
        out[30:50, 20 + 3 * k : 50 + 3 * k] -= 60
        return out

    assert not any(drifting(noisy)[1:])
    assert all(len(things) == 1 for things in drifting(with_thing)[4:])


def test_what_leaves_over_the_border_keeps_its_number_to_the_end() -> None:
    thing = Thing(90.0, 60.0, dx=3.0, width=50.0, height=30.0, shape="rectangle", seed=2)
    scene = synthetic.moving_things([thing], frames=26, size=(160, 120), seed=3)
    seen = followed(scene)
    # More than half of it is beyond the border then.
    assert scene.positions_px[25, 0, 0] > 160
    assert {one.id for things in seen for one in things} == {1}
    assert all(len(things) == 1 for things in seen)
    (one,) = seen[25]
    assert one.vx_px_per_frame == pytest.approx(3.0, rel=0.05)


def test_a_foot_that_comes_in_first_becomes_a_part_of_the_rest() -> None:
    tracker = ObjectTracker(min_area=12)
    counts = []
    for k in range(40):
        mask = np.zeros((120, 200), bool)
        # The foot swings, in front of the body that follows.
        foot = 180 - 3 * k + (4 if k % 4 < 2 else 0)
        mask[80:88, max(foot, 0) : max(foot + 10, 0)] = True
        body = 188 - 3 * k
        if k > 4:
            mask[20:84, max(body, 0) : max(body + 24, 0)] = True
        counts.append(len(tracker.update(mask)))
    assert counts[0] == 1
    assert set(counts[25:]) == {1}
