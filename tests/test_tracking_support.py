"""Points: every pixel that counts belongs to the window, and no other; texture that repeats is told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import rsflow
from rsflow import PointStatus

SHAPE = (180, 240)
MOTIONS = [(0.4, 0.3), (-0.1, 0.0), (-2.4, 1.3), (5.2, -6.1), (-8.0, 0.0)]


def pair(seed: int, sigma: float, motion: tuple[float, float], gain: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A texture and the same moved, with noise of 1.5 grey levels: what comes in at the border is new."""
    rng = np.random.default_rng(seed)
    shape = (SHAPE[0] + 80, SHAPE[1] + 80)
    layers = [ndimage.gaussian_filter(rng.standard_normal(shape), s) for s in (sigma, 4 * sigma)]
    picture = sum(layer / layer.std() for layer in layers) * 25 + 120
    moved = ndimage.shift(picture, motion[::-1], order=5, mode="reflect") * gain
    inner = np.s_[40:-40, 40:-40]
    noisy = [p[inner] + 1.5 * rng.standard_normal(SHAPE) for p in (picture, moved)]
    first, second = (np.clip(np.round(p), 0, 255).astype(np.uint8) for p in noisy)
    return first, second


def deviations(tracks: rsflow.Tracks, motion: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Errors in pixels, and each component over its stated deviation."""
    error = (tracks.displacement - np.float32(motion))[tracks.valid]
    std = np.sqrt(tracks.covariance[tracks.valid][:, [0, 1], [0, 1]])
    return np.hypot(*error.T), np.abs(error / std).ravel()


@pytest.mark.parametrize("distance", [0, 2, 5, 9, 14])
@pytest.mark.parametrize("sigma", [1.2, 3.0])
@pytest.mark.parametrize("overlay", [False, True])
def test_windows_at_a_border_or_mask_use_their_own_pixels(distance, sigma, overlay):
    error, over = [], []
    for seed, motion in enumerate(MOTIONS):
        for gain in (1.0, 0.7):
            prev, after = pair(seed, sigma, motion, gain)
            masks, left = {}, 0
            if overlay:
                left = 40
                keep = np.ones(SHAPE, bool)
                keep[:, :left] = False
                y, x = np.mgrid[: SHAPE[0], :left]
                prev[:, :left] = after[:, :left] = np.where((x // 6 + y // 6) % 2, 250, 5)
                masks = {"mask": keep, "next_mask": keep}
            points = np.float32([(left + distance, y) for y in range(24, SHAPE[0] - 24, 5)])
            tracks = rsflow.track_points(prev, after, points, **masks)
            # Of a window that all but leaves, too little may be left on the coarse levels to lead it.
            stays = points[:, 0] + motion[0] >= left + 3
            assert tracks.valid[stays].mean() > 0.9 if stays.any() else True
            found = deviations(tracks, motion)
            error.append(found[0])
            over.append(found[1])
    over = np.concatenate(over)
    assert np.median(np.concatenate(error)) < (0.03 if sigma < 2 else 0.07)
    assert 0.55 < (over < 1).mean() < 0.8
    assert 0.88 < (over < 2).mean() < 0.995


def test_dead_pixels_cost_themselves_and_not_the_point():
    prev, after = (p.astype(np.float32) for p in pair(3, 1.5, (4.3, -2.6)))
    points = rsflow.detect_corners(prev)
    whole = rsflow.track_points(prev, after, points)
    rng = np.random.default_rng(1)
    for share in (0.0005, 0.002, 0.01):
        dead = rng.random(SHAPE) < share
        holes = [np.where(dead, np.float32(np.nan), p) for p in (prev, after)]
        tracks = rsflow.track_points(*holes, points)
        assert tracks.valid.sum() >= 0.95 * whole.valid.sum()
        assert np.median(deviations(tracks, (4.3, -2.6))[0]) < 0.03
        corners = rsflow.detect_corners(holes[0])
        assert len(corners) > 0.6 * len(points)
        assert not dead[corners[:, 1].astype(int), corners[:, 0].astype(int)].any()


def test_too_little_support_is_a_status_of_its_own():
    prev, after = pair(4, 1.5, (1.0, 0.5))
    hole = np.ones(SHAPE, bool)
    hole[60:120, 80:160] = False
    hole[90, 120] = True
    tracks = rsflow.track_points(prev, after, [[120, 90], [120, 70], [30, 30]], mask=hole)
    assert tracks.status.tolist() == [PointStatus.LOW_SUPPORT, PointStatus.MASKED, PointStatus.TRACKED]
    tracks = rsflow.track_points(prev, after, [[120, 90], [30, 30]], next_mask=hole)
    assert not tracks.valid[0]
    assert tracks.valid[1]


@pytest.mark.parametrize("illumination", ["none", "gain_offset"])
def test_a_single_row_or_column_that_counts_is_too_little_support(illumination):
    prev, after = pair(4, 1.5, (1.0, 0.5))
    for line in (np.s_[90, :], np.s_[:, 120]):
        mask = np.zeros(SHAPE, bool)
        mask[line] = True
        tracks = rsflow.track_points(prev, after, [[120, 90]], mask=mask, illumination=illumination)
        assert tracks.status.tolist() == [PointStatus.LOW_SUPPORT]
    # Where all pixels count, stripes have too little texture.
    stripes = np.tile(prev[90], (SHAPE[0], 1))
    tracks = rsflow.track_points(stripes, stripes, [[120, 90]], illumination=illumination)
    assert tracks.status.tolist() == [PointStatus.LOW_TEXTURE]


def test_corners_are_made_of_pixels_that_count():
    frame = np.full((80, 100), 90, np.uint8)
    frame[20:40, 30:50] = 200
    frame[:, 80:] = 5
    frame[60:, 80:] = 250
    keep = np.ones(frame.shape, bool)
    keep[:, 80:] = False
    corners = rsflow.detect_corners(frame, mask=keep)
    assert len(corners) == 4
    assert corners[:, 0].max() < 55


def test_a_tracker_does_not_drift_at_the_border():
    rng = np.random.default_rng(5)
    big = ndimage.gaussian_filter(rng.standard_normal((260, 340)), 2.0)
    big = 120 + 40 * big / big.std()
    tracker = rsflow.PointTracker(max_corners=200)
    start: dict[int, np.ndarray] = {}
    drift = []
    for step in range(12):
        moved = ndimage.shift(big, (0.0, -0.4 * step), order=5, mode="reflect")[40:-40, 40:-40]
        frame = np.clip(np.round(moved + rng.standard_normal(moved.shape)), 0, 255).astype(np.uint8)
        tracks = tracker.update(frame)
        for ident, point, status in zip(tracks.ids, tracks.points, tracks.status, strict=True):
            if status == PointStatus.NEW:
                start[int(ident)] = point + np.float32([0.4 * step, 0])
            elif status == PointStatus.TRACKED and point[0] < 10:
                drift.append(np.hypot(*(point + np.float32([0.4 * step, 0]) - start[int(ident)])))
    assert len(drift) > 20
    assert np.median(drift) < 0.1


def test_threads_change_no_bit_with_masks():
    prev, after = pair(6, 1.5, (2.3, -1.2))
    keep = np.random.default_rng(7).random(SHAPE) > 0.01
    keep[:, :30] = False
    points = np.float32([(x, y) for x in range(30, 236, 7) for y in range(2, 178, 7)])
    threads = rsflow.get_num_threads()
    found = []
    try:
        for count in (1, 2, 5):
            rsflow.set_num_threads(count)
            found.append(rsflow.track_points(prev, after, points, mask=keep, next_mask=keep))
    finally:
        rsflow.set_num_threads(threads)
    for other in found[1:]:
        np.testing.assert_array_equal(other.points, found[0].points)
        np.testing.assert_array_equal(other.covariance, found[0].covariance)
        np.testing.assert_array_equal(other.status, found[0].status)


@pytest.mark.parametrize("deformation", ["none", "affine"])
def test_windows_deform_where_the_caller_says(deformation):
    prev, _ = pair(8, 2.0, (0.0, 0.0))
    angle = np.deg2rad(3)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = np.array([SHAPE[1] / 2, SHAPE[0] / 2])
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    back = (np.stack([x, y], -1) - middle) @ turn + middle
    after = ndimage.map_coordinates(prev.astype(float), [back[..., 1], back[..., 0]], order=3, mode="reflect")
    points = np.float32([(x, y) for x in range(60, 181, 20) for y in range(50, 131, 20)])
    tracks = rsflow.track_points(prev, np.round(after).clip(0, 255).astype(np.uint8), points, deformation=deformation)
    deformed = (tracks.deformation[tracks.valid] != np.eye(2, dtype=np.float32)).any(axis=(1, 2))
    if deformation == "none":
        assert not deformed.any()
    else:
        assert tracks.valid.mean() > 0.8
        assert deformed.mean() > 0.9
        assert np.abs(tracks.deformation[tracks.valid][deformed] - turn).max() < 0.05


def repeating(kind: str, period: float, motion: tuple[float, float], scene: bool) -> np.ndarray:
    """A pattern that fills the picture, or a part of a scene; both move by `motion`."""
    y, x = np.mgrid[:260, :340].astype(float)
    x, y = x - motion[0], y - motion[1]
    if kind == "board":
        wave = np.tanh(4 * np.sin(2 * np.pi * x / period)) * np.tanh(4 * np.sin(2 * np.pi * y / period))
    elif kind == "eggs":
        wave = np.cos(2 * np.pi * x / period) + np.cos(2 * np.pi * y / period)
    else:
        row = np.floor(2 * y / period)
        along, across = (x + row * period / 2) % period, y % (period / 2)
        joint = np.minimum(np.minimum(along, period - along), np.minimum(across, period / 2 - across))
        wave = np.clip(joint - 1, -1, 1)
    picture = 120 + 40 * wave
    if scene:
        inside = np.clip(np.minimum(np.minimum(x - 90, 250 - x), np.minimum(y - 60, 200 - y)) + 0.5, 0, 1)
        around = ndimage.gaussian_filter(np.random.default_rng(12).standard_normal((380, 460)), 2.0)
        around = ndimage.shift(around / around.std(), motion[::-1], order=3, mode="reflect")[60:-60, 60:-60]
        picture = inside * picture + (1 - inside) * (120 + 35 * around)
    noise = np.random.default_rng(9 + int(10 * abs(sum(motion)))).standard_normal(picture.shape)
    return np.clip(np.round(picture + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("angle", [0, 90, 33])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.7, 1.0, 1.5])
@pytest.mark.parametrize(("kind", "period"), [("board", 24), ("eggs", 18), ("bricks", 32), ("board", 12)])
def test_texture_that_repeats_is_told(kind, period, share, angle):
    """Where a pattern fills the picture, motion by a share of its period is the same as by one period less."""
    motion = (share * period * np.cos(np.deg2rad(angle)), share * period * np.sin(np.deg2rad(angle)))
    prev, after = (repeating(kind, period, way, scene=False) for way in ((0.0, 0.0), motion))
    tracks = rsflow.track_points(prev, after, rsflow.detect_corners(prev))
    assert tracks.valid.mean() <= 0.01
    assert (tracks.status == PointStatus.AMBIGUOUS).mean() > 0.8


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
@pytest.mark.parametrize(("kind", "period"), [("board", 24), ("eggs", 18)])
def test_the_longest_displacement_says_which_of_several_it_was(kind, period, share):
    motion = (share * period, 0.0)
    prev, after = (repeating(kind, period, way, scene=False) for way in ((0.0, 0.0), motion))
    corners = rsflow.detect_corners(prev)
    corners = corners[((corners > 16) & (corners < np.float32([323, 243]))).all(axis=1)]
    tracks = rsflow.track_points(prev, after, corners, max_displacement=0.4 * period)
    right = tracks.valid & (np.hypot(*(tracks.displacement - np.float32(motion)).T) < 1)
    assert (tracks.status == PointStatus.AMBIGUOUS).mean() <= 0.03
    assert right.mean() > 0.9


@pytest.mark.parametrize("angle", [0, 33])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.7, 1.0])
@pytest.mark.parametrize(("kind", "period"), [("board", 24), ("eggs", 18), ("bricks", 32)])
def test_what_ends_a_pattern_says_how_it_moves(kind, period, share, angle):
    motion = (share * period * np.cos(np.deg2rad(angle)), share * period * np.sin(np.deg2rad(angle)))
    prev, after = (repeating(kind, period, way, scene=True) for way in ((0.0, 0.0), motion))
    pattern = np.zeros(prev.shape, bool)
    pattern[72:188, 102:238] = True
    corners = rsflow.detect_corners(prev, mask=pattern)
    tracks = rsflow.track_points(prev, after, corners)
    right = tracks.valid & (np.hypot(*(tracks.displacement - np.float32(motion)).T) < 1)
    assert (tracks.valid & ~right).mean() <= 0.01
    if share < 1 / 3:
        assert (tracks.status == PointStatus.AMBIGUOUS).mean() <= 0.03
        assert right.mean() > 0.9
    else:
        assert right.mean() > 0.7
