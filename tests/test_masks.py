"""Masks of what is fixed to the sensor: velocity, points, what moves, extraction and the commands leave it out."""

from __future__ import annotations

import numpy as np
import pytest

import rsflow
from mask_scenes import SHAPE, overlay, overlay_mask
from rsflow import PointStatus, synthetic
from rsflow.capture.masks import FixedMask
from rsflow.errors import DTypeError, ShapeError

KINDS = ("below", "around", "letters", "middle")


def blinking(k: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """A clock: blocks that are others in each frame."""
    blocks = np.random.default_rng(100 + k).integers(0, 2, (shape[0] // 4, shape[1] // 4), np.uint8)
    return np.kron(blocks * np.uint8(255), np.ones((4, 4), np.uint8))


def still_scene(frames: int) -> list[np.ndarray]:
    """A camera at rest before a scene at rest, with noise."""
    rng = np.random.default_rng(3)
    ground = 120 + 30 * synthetic.texture(SHAPE, "fine", seed=1)
    return [np.clip(np.round(ground + rng.normal(0, 1, SHAPE)), 0, 255).astype(np.uint8) for _ in range(frames)]


def same_arrays(first: object, second: object, names: tuple[str, ...]) -> None:
    for name in names:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)


# --- velocity -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.25, 0.46])
@pytest.mark.parametrize("kind", KINDS)
def test_velocity_beside_an_overlay_is_as_right_as_it_says(kind: str, share: float) -> None:
    keep = overlay_mask(kind, share)
    assert abs(keep.mean() - (1 - share)) < 0.03
    over = {True: [], False: []}
    for climb in (0.0, 0.15):
        f = synthetic.flight(frames=6, velocity_m_s=(0.05, 0.02, climb), seed=3)
        for masked in (True, False):
            estimator = rsflow.VelocityEstimator(f.camera, height_std_m=0.0, mask=keep if masked else None)
            for k, frame in enumerate(f):
                seen = np.where(keep, frame.image, overlay())
                v = estimator.update(seen, frame.t_s, height_m=float(f.height_m[k]))
                if k and (v.valid or masked):
                    assert v.valid
                    error = np.array([v.vx_m_s, v.vy_m_s]) - f.velocity_m_s[k][:2]
                    over[masked].append(np.abs(error) / np.sqrt(np.diag(v.covariance)[:2]))
    assert np.mean(np.concatenate(over[True]) < 2) > 0.85
    assert np.max(over[True]) < 5
    if share > 0.4:
        # Without the mask the overlay holds nearly as much as the ground: frames are not measured, or wrong.
        assert len(over[False]) < len(over[True]) or np.median(over[False]) > 5


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_velocity_does_not_depend_on_what_the_mask_leaves_out(dtype: type) -> None:
    keep = overlay_mask("letters", 0.3)
    f = synthetic.flight(frames=4, velocity_m_s=(0.05, 0.02, 0.1), rate_rad_s=(0.1, -0.2, 0.4), seed=5)
    found = []
    for number in range(3):
        rng = np.random.default_rng(number)
        estimator = rsflow.VelocityEstimator(f.camera, mask=keep)
        for k, frame in enumerate(f):
            covered = rng.integers(0, 256, SHAPE).astype(dtype)
            if dtype is np.float32 and number == 2:
                covered[:] = np.nan
            seen = np.where(keep, frame.image.astype(dtype), covered)
            rate = f.rate_rad_s[k] if k else None
            v = estimator.update(seen, frame.t_s, height_m=float(f.height_m[k]), rate_rad_s=rate)
        assert v.valid
        found.append((v.vx_m_s, v.vy_m_s, v.vz_m_s, *v.covariance.ravel(), v.n_points))
    assert found[1] == found[0]
    assert found[2] == found[0]


def test_a_picture_without_pixels_that_count_has_no_velocity() -> None:
    f = synthetic.flight(frames=2, seed=1)
    estimator = rsflow.VelocityEstimator(f.camera, height_m=0.2, mask=np.zeros(SHAPE, bool))
    estimator.update(f.images[0], 0.0)
    v = estimator.update(f.images[1], 0.1)
    assert v.status.name == "NO_TEXTURE"
    assert np.isnan(v.vx_m_s)


def test_a_mask_that_does_not_fit_is_told() -> None:
    camera = synthetic.flight(frames=1).camera
    with pytest.raises(ShapeError, match=r"mask: got shape \(10, 20\), expected that of the camera's pictures, \(144"):
        rsflow.VelocityEstimator(camera, mask=np.ones((10, 20), bool))
    for wrong in (np.ones(SHAPE), np.ones(SHAPE, np.uint8), "mask.png", [[True]]):
        for make in (lambda mask: rsflow.VelocityEstimator(camera, mask=mask), rsflow.MotionSegmenter,
                     rsflow.PointTracker):  # fmt: skip
            with pytest.raises(DTypeError, match=r"mask: got .*, expected a bool array"):
                make(mask=wrong)
    with pytest.raises(DTypeError, match=r"True where to measure; of a picture of numbers mask != 0$"):
        rsflow.PointTracker(mask=np.full(SHAPE, 255, np.uint8))
    for stream in (rsflow.MotionSegmenter(mask=np.ones((9, 9), bool)), rsflow.PointTracker(mask=np.ones((9, 9), bool))):
        with pytest.raises(ShapeError, match=r"mask: got shape \(9, 9\), expected that of the frames, \(144, 176\)"):
            stream.update(np.zeros(SHAPE, np.uint8))


def test_the_callers_array_may_change_afterwards() -> None:
    keep = overlay_mask("middle", 0.3)
    frames = still_scene(3)
    streams = [rsflow.PointTracker(mask=keep), rsflow.PointTracker(mask=keep.copy())]
    segmenters = [rsflow.MotionSegmenter(mask=keep), rsflow.MotionSegmenter(mask=keep.copy())]
    keep[:] = False
    for frame in frames:
        found = [stream.update(frame) for stream in streams]
        same_arrays(*found, ("points", "status"))
        same_arrays(*(segmenter.update(frame) for segmenter in segmenters), ("moving", "residual", "mask"))
    assert found[0].valid.any()


# --- points ---------------------------------------------------------------------------------------------------------


def test_a_tracker_leaves_out_what_its_mask_and_the_frames_mask_leave_out() -> None:
    keep, later = overlay_mask("below", 0.3), overlay_mask("middle", 0.2)
    f = synthetic.flight(frames=4, velocity_m_s=(0.05, 0.02, 0.0), seed=2)
    fixed, each = rsflow.PointTracker(mask=keep), rsflow.PointTracker()
    for k, frame in enumerate(f):
        seen = np.where(keep, frame.image, overlay())
        with_mask = fixed.update(seen, mask=later if k == 3 else None)
        by_hand = each.update(seen, mask=keep & later if k == 3 else keep)
        same_arrays(with_mask, by_hand, ("points", "status", "covariance", "ids"))
        at = np.round(with_mask.points[with_mask.valid | (with_mask.status == PointStatus.NEW)]).astype(int)
        assert (keep & later if k == 3 else keep)[at[:, 1], at[:, 0]].all()
    assert with_mask.valid.sum() > 20


# --- what moves -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera_motion", ["static", "moving"])
@pytest.mark.parametrize("kind", ["corner", *KINDS])
def test_a_blinking_clock_that_is_masked_does_not_move(kind: str, camera_motion: str) -> None:
    keep = np.ones(SHAPE, bool)
    if kind == "corner":
        keep[6:34, 80:164] = False
    else:
        keep = overlay_mask(kind, 0.4)
    masked = rsflow.MotionSegmenter(camera_motion=camera_motion, mask=keep)
    plain = rsflow.MotionSegmenter(camera_motion=camera_motion)
    moving = 0
    for k, frame in enumerate(still_scene(8)):
        seen = np.where(keep, frame, blinking(k))
        result = masked.update(seen)
        assert not result.moving.any()
        assert result.objects == ()
        assert not result.labels.any()
        assert np.isnan(result.residual[~keep]).all()
        assert np.isnan(result.background[~keep]).all()
        np.testing.assert_array_equal(result.mask, keep)
        np.testing.assert_array_equal(result.static_view()[..., 0][~keep], seen[~keep])
        moving = max(moving, int(plain.update(seen).moving.sum()))
    assert result.valid
    if camera_motion == "static":
        assert np.isfinite(result.background[keep]).all()
    assert np.nanmedian(result.residual) < 0.1
    if kind == "corner":
        # Without the mask the clock is what moves.
        assert moving > 0.5 * np.count_nonzero(~keep)


def test_a_thing_beside_the_overlay_is_found_and_ends_at_it() -> None:
    keep = overlay_mask("around", 0.3)
    flight = synthetic.flight_with_object(frames=8)
    segmenter, plain = rsflow.MotionSegmenter(mask=keep), rsflow.MotionSegmenter()
    scores: dict[bool, list[float]] = {True: [], False: []}
    for k, frame in enumerate(flight):
        seen = np.where(keep, frame.image, blinking(k))
        for masked, result in ((True, segmenter.update(seen)), (False, plain.update(frame.image))):
            if masked:
                assert not result.moving[~keep].any()
                assert not result.labels[~keep].any()
            truth = (flight.masks[k] > 0) & keep
            both = result.moving & keep
            scores[masked].append(np.count_nonzero(both & truth) / np.count_nonzero(both | truth))
    # As well as without an overlay.
    assert np.mean(scores[True][3:]) > np.mean(scores[False][3:]) - 0.05
    assert np.mean(scores[True][3:]) > 0.6


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("camera_motion", ["static", "moving"])
def test_segmentation_does_not_depend_on_what_the_mask_leaves_out(camera_motion: str, dtype: type) -> None:
    keep = overlay_mask("letters", 0.2)
    flight = synthetic.flight_with_object(frames=6)
    found: list[list[rsflow.MotionSegmentation]] = []
    for number in range(3):
        rng = np.random.default_rng(number)
        segmenter = rsflow.MotionSegmenter(camera_motion=camera_motion, mask=keep)
        results = []
        for frame in flight:
            covered = rng.integers(0, 256, SHAPE).astype(dtype)
            if dtype is np.float32 and number == 2:
                covered[:] = np.nan
            results.append(segmenter.update(np.where(keep, frame.image.astype(dtype), covered)))
        found.append(results)
    assert any(result.moving.any() for result in found[0]) or camera_motion == "static"
    for results in found[1:]:
        for one, other in zip(results, found[0], strict=True):
            same_arrays(one, other, ("moving", "residual", "labels", "background", "camera_motion"))
            assert repr(one.objects) == repr(other.objects)


def test_filling_takes_the_nearest_pixel_that_counts() -> None:
    rng = np.random.default_rng(1)
    for keep in (rng.random((23, 31)) < 0.05, np.ones((5, 6), bool), np.zeros((5, 6), bool), rng.random((1, 9)) < 0.5):
        picture = rng.random(keep.shape).astype(np.float32)
        filled = picture.copy()
        FixedMask(keep).fill(filled)
        np.testing.assert_array_equal(filled[keep], picture[keep])
        if not keep.any():
            assert (filled == 0).all()
            continue
        rows, columns = np.nonzero(keep)
        for y, x in zip(*np.nonzero(~keep), strict=True):
            apart = np.hypot(rows - y, columns - x)
            # OpenCV's distance is of steps of 1, 1.4 and 2.2 pixels.
            near = apart <= apart.min() * 1.05 + 1e-6
            assert filled[y, x] in picture[rows[near], columns[near]]
