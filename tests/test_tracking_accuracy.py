"""Points: no bias at any sub-pixel phase, and corners that the light does not move, beside OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import rsflow
from rsflow.synthetic import LIGHTING, Part, Sensor, Texture, motions_pair

SHAPE = (240, 320)


def grid(step: int, margin: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(margin, SHAPE[1] - margin, step), np.arange(margin, SHAPE[0] - margin, step))
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float32)


@pytest.mark.parametrize(("kind", "seeds"), [("fine", 4), ("smooth", 16)])
@pytest.mark.parametrize("light", [1.0, 0.7])
def test_no_sub_pixel_phase_has_a_bias(kind, seeds, light):
    points = grid(10, 20)
    x, y = np.arange(SHAPE[1])[None, :], np.arange(SHAPE[0])[:, None]
    sensor = Sensor()
    for phase in np.arange(0.0, 1.0, 0.125):
        shift = np.array([2 + phase, -1 - phase])
        means = []
        for seed in range(seeds):
            texture = Texture.make(kind, seed=seed % 4)
            rng = np.random.default_rng([seed, round(8 * phase)])
            prev = sensor.expose(110 + 30 * texture.sample(x, y), rng)
            after = sensor.expose(light * (110 + 30 * texture.sample(x - shift[0], y - shift[1])), rng)
            tracks = rsflow.track_points(prev, after, points)
            assert tracks.valid.mean() > 0.95
            means.append((tracks.displacement - shift)[tracks.valid].mean(axis=0))
        bias = np.mean(means, axis=0)
        assert np.abs(bias).max() < 0.003, f"phase {phase}: {bias}"


@pytest.mark.parametrize("kind", ["fine", "smooth"])
@pytest.mark.parametrize("light", LIGHTING)
def test_corners_come_back_in_other_light_as_often_as_opencvs(kind, light):
    def repeated(find):
        shares = []
        for seed in range(2):
            parts = [Part(dx=5.3, dy=-3.7, kind=kind)]
            pair = motions_pair(parts, size=SHAPE[::-1], lighting=LIGHTING[light], seed=seed)
            moved, there = pair.truth(find(pair.prev)), find(pair.next)
            moved = moved[((moved > 8) & (moved < np.array(SHAPE[::-1]) - 8)).all(axis=1)]
            distance = np.hypot(*(moved[:, None] - there[None]).T).min(axis=0)
            shares.append((distance < 1.5).mean())
        return np.mean(shares)

    theirs = repeated(lambda image: cv2.goodFeaturesToTrack(image, 400, 0.01, 8)[:, 0])
    ours = repeated(lambda image: rsflow.detect_corners(image, max_corners=400, quality=0.01, min_distance=8))
    assert theirs > 0.2
    assert ours >= theirs - 0.01
