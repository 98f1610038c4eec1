"""rsflow.estimate_shift: accuracy, honesty, light, frames of every type and layout."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import rsflow
from rsflow import ShiftStatus, estimate_shift


def scene(height: int = 120, width: int = 140, *, sigma: float = 1.5, seed: int = 0) -> np.ndarray:
    """A smooth random scene in grey levels, mean 110 and standard deviation 25."""
    texture = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal((height, width)), sigma)
    return 110 + 25 * (texture - texture.mean()) / texture.std()


def moved(picture: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """The picture with its content moved by (dx, dy)."""
    return ndimage.shift(picture, (dy, dx), order=5, mode="reflect")


def pair(dx: float, dy: float, *, size: int = 60, noise: float = 0.0, seed: int = 0, sigma: float = 1.5):
    big = scene(size + 80, size + 80, sigma=sigma, seed=seed)
    part = (slice(40, 40 + size),) * 2
    rng = np.random.default_rng(seed + 1000)
    frames = [big[part], moved(big, dx, dy)[part]]
    return tuple((frame + noise * rng.standard_normal(frame.shape)).astype(np.float32) for frame in frames)


@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (0.5, -0.25), (3.3, 1.7), (-7.6, 9.2), (19.8, -12.4)])
def test_a_window_is_measured_to_a_hundredth(dx, dy):
    prev, nxt = pair(dx, dy)
    shift = estimate_shift(prev, nxt)
    assert shift.valid
    assert np.hypot(shift.dx - dx, shift.dy - dy) < 0.01


@pytest.mark.parametrize(
    ("illumination", "gain", "offset"),
    [("gain_offset", 1.3, -20.0), ("gain_offset", 0.6, 30.0), ("offset", 1.0, 25.0), ("none", 1.0, 0.0)],
)
def test_light_is_told_apart_from_motion(illumination, gain, offset):
    prev, nxt = pair(2.3, -1.6)
    shift = estimate_shift(prev, (gain * nxt + offset).astype(np.float32), illumination=illumination)
    assert shift.valid
    assert np.hypot(shift.dx - 2.3, shift.dy + 1.6) < 0.01
    assert shift.gain == pytest.approx(gain, abs=0.01)
    assert shift.offset == pytest.approx(offset, abs=1.0)


def test_identical_frames_did_not_move():
    prev, _ = pair(0, 0, noise=2.0)
    shift = estimate_shift(prev, prev)
    assert shift.valid
    assert (shift.dx, shift.dy) == (0.0, 0.0)


def test_swapped_frames_negate_exactly():
    prev, nxt = pair(4.3, -2.7, noise=1.0)
    there, back = estimate_shift(prev, nxt), estimate_shift(nxt, prev)
    assert (there.dx, there.dy) == (-back.dx, -back.dy)
    assert there.gain == pytest.approx(1 / back.gain, rel=1e-6)


def test_a_roi_follows_content_out_of_its_window():
    big = scene(200, 220)
    prev, nxt = big.astype(np.float32), moved(big, 22.4, -14.7).astype(np.float32)
    shift = estimate_shift(prev, nxt, roi=(80, 70, 48, 40), max_displacement=30)
    assert shift.valid
    assert np.hypot(shift.dx - 22.4, shift.dy + 14.7) < 0.02


def test_nan_and_masked_pixels_are_left_out():
    prev, nxt = pair(2.4, 1.3, size=80)
    prev, nxt = prev.copy(), nxt.copy()
    prev[10:20, 30:50] = np.nan
    nxt[60:63] = np.nan
    mask = np.ones(prev.shape, dtype=bool)
    mask[40:60, 5:25] = False
    prev[41:59, 6:24] = 255
    shift = estimate_shift(prev, nxt, mask=mask)
    assert shift.valid
    assert np.hypot(shift.dx - 2.4, shift.dy - 1.3) < 0.02


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0), (1, 1), (3, 200)])
def test_tiny_frames_are_told_not_guessed(shape):
    frame = np.zeros(shape, dtype=np.uint8)
    shift = estimate_shift(frame, frame)
    assert shift.status == ShiftStatus.TOO_SMALL
    assert not shift.valid
    assert np.isnan([shift.dx, shift.dy, shift.gain, shift.offset, shift.residual]).all()
    assert np.isinf(np.diag(shift.covariance)).all()


def test_no_texture_is_told():
    flat = np.full((60, 60), 90, dtype=np.uint8)
    assert estimate_shift(flat, flat).status == ShiftStatus.NO_TEXTURE


def test_one_direction_of_texture_is_an_aperture():
    stripes = np.tile(scene(1, 60)[0], (60, 1))
    rng = np.random.default_rng(3)
    prev, nxt = (np.round(stripes + rng.standard_normal(stripes.shape)).astype(np.uint8) for _ in range(2))
    shift = estimate_shift(prev, nxt)
    assert shift.status == ShiftStatus.APERTURE
    assert np.isnan(shift.dx)


def test_every_type_and_layout_gives_the_same():
    prev, nxt = (np.round(frame).astype(np.uint8) for frame in pair(3.4, -1.2))
    want = estimate_shift(prev, nxt)
    for convert in (
        lambda a: a.astype(np.uint16),
        lambda a: a.astype(np.float32),
        np.asfortranarray,
        lambda a: a[::-1, ::-1].copy()[::-1, ::-1],
        lambda a: np.repeat(a, 2, axis=1)[:, ::2],
    ):
        found = estimate_shift(convert(prev), convert(nxt))
        assert (found.dx, found.dy, found.status) == (want.dx, want.dy, want.status)


def test_threads_do_not_change_a_bit():
    prev, nxt = pair(3.4, -1.2, size=300, noise=1.0)
    before = rsflow.get_num_threads()
    found = []
    try:
        for threads in (1, 2, 7):
            rsflow.set_num_threads(threads)
            shift = estimate_shift(prev, nxt)
            found.append((shift.dx, shift.dy, shift.gain, shift.residual, shift.covariance.tobytes()))
    finally:
        rsflow.set_num_threads(before)
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"roi": (50, 0, 20, 20)}, rsflow.OptionError, "inside of the frame"),
        ({"roi": (0, 0, 20)}, rsflow.OptionError, "four integers"),
        ({"roi": (-1, 0, 20, 20)}, rsflow.OptionError, "not negative"),
        ({"roi": (0.5, 0, 20, 20)}, rsflow.DTypeError, "four integers"),
        ({"roi": 7}, rsflow.DTypeError, "four integers"),
        ({"illumination": "gain"}, rsflow.OptionError, "gain_offset"),
        ({"max_displacement": -1.0}, rsflow.OptionError, "max_displacement: got -1"),
        ({"max_displacement": float("nan")}, rsflow.OptionError, "max_displacement: got NaN"),
        ({"mask": np.ones((60, 59), dtype=bool)}, rsflow.ShapeError, "mask"),
        ({"mask": np.ones((60, 60))}, rsflow.DTypeError, "mask"),
    ],
)
def test_misuse_is_explained(options, error, message):
    prev, nxt = pair(1, 1)
    with pytest.raises(error, match=message):
        estimate_shift(prev, nxt, **options)


def test_frames_of_different_size_are_explained():
    with pytest.raises(rsflow.ShapeError, match="next"):
        estimate_shift(np.zeros((9, 9), np.uint8), np.zeros((9, 8), np.uint8))
