"""rsflow.estimate_shift over every kind of content: edges, gratings, repeats, photographs, flat shapes, particles."""

from __future__ import annotations

import numpy as np
import pytest
import skimage.data
from scipy import ndimage

from rsflow import ShiftStatus, estimate_shift
from shift_helpers import moved, pair, particles, scene


def test_no_texture_is_told():
    flat = np.full((60, 60), 90, dtype=np.uint8)
    assert estimate_shift(flat, flat).status == ShiftStatus.NO_TEXTURE


def test_one_direction_of_texture_is_an_aperture():
    stripes = np.tile(scene(1, 60)[0], (60, 1))
    rng = np.random.default_rng(3)
    prev, nxt = (np.round(stripes + rng.standard_normal(stripes.shape)).astype(np.uint8) for _ in range(2))
    shift = estimate_shift(prev, nxt)
    assert shift.status == ShiftStatus.APERTURE
    assert not shift.valid
    assert abs(shift.dx) < 5 * np.sqrt(shift.direction_variance)
    assert shift.direction_variance < 0.01
    assert abs(shift.direction[0]) > 0.999
    assert np.isinf(shift.covariance[1, 1])


def edge(size: int, angle: float, blur: float, dx: float = 0.0, dy: float = 0.0) -> np.ndarray:
    """A straight edge at `angle` degrees, blurred over `blur` pixels, the mean over each pixel of 8 x 8 samples."""
    at = (np.arange(8 * size) + 0.5) / 8 - size / 2
    x, y = at[None, :] - dx, at[:, None] - dy
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    across = 8 * (x * cosine + y * sine - 1.3)
    # The share of each sample's square, of sides one, that lies beyond the edge.
    a, b = max(abs(cosine), 1e-3), max(abs(sine), 1e-3)
    ends = (((a + b) / 2, 1), ((a - b) / 2, -1), ((b - a) / 2, -1), (-(a + b) / 2, 1))
    fine = sum(sign * np.maximum(across + end, 0) ** 2 for end, sign in ends) / (2 * a * b)
    if blur:
        fine = ndimage.gaussian_filter(fine, 8 * blur, mode="nearest")
    return 40 + 160 * fine.reshape(size, 8, size, 8).mean((1, 3))


@pytest.mark.parametrize("illumination", ["none", "offset", "gain_offset"])
@pytest.mark.parametrize("blur", [0.0, 0.3, 0.5, 1.2])
@pytest.mark.parametrize("angle", [0.0, 90.0, 45.0, 4.0, 26.6, 64.2])
def test_an_edge_is_not_measured_along_itself_and_not_too_surely_across(angle, blur, illumination):
    rng = np.random.default_rng(round(10 * angle + blur))
    gain, offset = {"none": (1.0, 0.0), "offset": (1.0, 12.0), "gain_offset": (1.15, -8.0)}[illumination]
    for size in (32, 48, 64):
        for move in ((0.5, -0.5), (-1.25, 1.7), (1.0, -2.0)):
            for noise in (0.0, 1.0):
                frames = edge(size, angle, blur), gain * edge(size, angle, blur, *move) + offset
                prev, nxt = ((f + noise * rng.standard_normal(f.shape)).astype(np.float32) for f in frames)
                shift = estimate_shift(prev, nxt, illumination=illumination)
                assert shift.status == ShiftStatus.APERTURE
                across = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
                error = abs((np.array([shift.dx, shift.dy]) - move) @ across)
                if np.isfinite(error):
                    assert error < max(0.02, 5 * np.sqrt(shift.direction_variance)), (size, move, noise)


@pytest.mark.parametrize("illumination", ["none", "offset", "gain_offset"])
@pytest.mark.parametrize("size", [48, 64, 128])
def test_an_edge_that_moved_by_whole_pixels_did_so(size, illumination):
    for column in (size // 4, 2 * size // 5, size // 2):
        for dx in (-4, -1, 0, 1, 2, 3):
            prev, nxt = (np.where(np.arange(size) < at, 40, 200) for at in (column, column + dx))
            prev, nxt = (np.tile(row.astype(np.float32), (size, 1)) for row in (prev, nxt))
            shift = estimate_shift(prev, nxt, illumination=illumination)
            assert shift.status == ShiftStatus.APERTURE
            assert abs(shift.dx - dx) < 0.02


@pytest.mark.parametrize("period", [4.0, 9.0, 20.0])
@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_a_grating_is_an_aperture_and_not_measured_along_itself(period, angle):
    rng = np.random.default_rng(round(10 * period + angle))
    y, x = np.mgrid[0:60, 0:60]
    across = 2 * np.pi / period * (x * np.cos(angle) + y * np.sin(angle))
    prev, nxt = (110 + 50 * np.sin(across - phase) + rng.standard_normal(x.shape) for phase in (0.0, 1.1))
    shift = estimate_shift(prev.astype(np.float32), nxt.astype(np.float32))
    assert shift.status == ShiftStatus.APERTURE
    # One period is as good as another: nothing is measured across it either.
    assert np.isnan(shift.dx)
    assert np.isinf(shift.direction_variance)


def checked(dx: float, dy: float, period: float, extra: float, seed: int) -> list[np.ndarray]:
    """Two frames of an egg box pattern over a texture of standard deviation `extra`, with noise."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:60, 0:60]
    texture = scene(140, 140, seed=seed) - 110
    frames = []
    for u, v, plain in ((0.0, 0.0, texture), (dx, dy, moved(texture, dx, dy))):
        waves = np.sin(2 * np.pi / period * (x - u)) + np.sin(2 * np.pi / period * (y - v))
        frame = 110 + 30 * waves + extra / 25 * plain[40:100, 40:100] + rng.standard_normal(x.shape)
        frames.append(np.clip(np.round(frame), 0, 255).astype(np.uint8))
    return frames


@pytest.mark.parametrize("period", [6.0, 10.0, 16.0])
def test_a_pattern_that_repeats_is_ambiguous_unless_the_motion_is_known_to_be_short(period):
    dx, dy = 0.3 * period, -0.2 * period
    frames = checked(dx, dy, period, extra=0.0, seed=3)
    assert estimate_shift(*frames).status == ShiftStatus.AMBIGUOUS
    shift = estimate_shift(*frames, max_displacement=0.45 * period)
    assert shift.valid
    assert np.hypot(shift.dx - dx, shift.dy - dy) < 0.02


@pytest.mark.parametrize("seed", range(8))
def test_a_texture_tells_one_period_from_the_next(seed):
    dx, dy = np.random.default_rng(seed).uniform(-9, 9, 2)
    shift = estimate_shift(*checked(dx, dy, 10.0, extra=9.0, seed=seed))
    assert shift.valid
    assert np.hypot(shift.dx - dx, shift.dy - dy) < 0.05


@pytest.mark.parametrize("seed", range(8))
def test_two_motions_are_not_averaged(seed):
    rng = np.random.default_rng(seed)
    left, right = (rng.uniform(-3, 3, 2) for _ in range(2))
    right = left + np.sign(right) * (1.5 + np.abs(right))
    halves = [pair(*motion, seed=seed + 100 * k, sigma=2.0, noise=1.0) for k, motion in enumerate((left, right))]
    prev, nxt = (np.where(np.arange(60) < 30, a, b) for a, b in zip(*halves, strict=True))
    shift = estimate_shift(prev, nxt)
    if shift.valid:
        assert min(np.hypot(shift.dx - dx, shift.dy - dy) for dx, dy in (left, right)) < 0.5


def photographs() -> list[np.ndarray]:
    """Pictures that scikit-image ships."""
    names = ("camera", "coins", "moon", "page", "text", "brick", "grass", "gravel")
    return [np.ascontiguousarray(getattr(skimage.data, name)()) for name in names]


def test_unrelated_photographs_are_no_match() -> None:
    """A gain that makes next to nothing of one frame, or varies wildly over it, explains any two windows."""
    rng = np.random.default_rng(5)
    pictures = photographs()
    valid = 0
    for run in range(1500):
        size = (32, 60, 64)[run % 3]
        frames = []
        for index in rng.choice(len(pictures), 2, replace=False):
            height, width = pictures[index].shape
            y, x = rng.integers(0, height - size), rng.integers(0, width - size)
            frames.append(pictures[index][y : y + size, x : x + size])
        for illumination in ("none", "offset", "gain_offset"):
            valid += estimate_shift(*frames, illumination=illumination).valid
    assert valid <= 1


def test_photographs_in_a_ramp_of_light() -> None:
    """One light for the window that varies over it is told from motion, and from a light for each part."""
    rng = np.random.default_rng(6)
    off = []
    for picture in photographs():
        for _ in range(8):
            y, x = (rng.integers(20, side - 80) for side in picture.shape)
            dx, dy = rng.integers(-5, 6, 2)
            prev = picture[y : y + 60, x : x + 60]
            nxt = picture[y - dy : y - dy + 60, x - dx : x - dx + 60] * np.linspace(0.75, 1.0, 60)
            shift = estimate_shift(prev, np.round(nxt).astype(np.uint8))
            if shift.valid:
                off.append([shift.dx - dx, shift.dy - dy])
    lengths = np.hypot(*np.transpose(off))
    assert len(lengths) >= 58
    assert np.median(lengths) < 0.01
    assert lengths.max() < 0.2


def flat_shape(kind: str, height: int, width: int, dx: float, dy: float) -> np.ndarray:
    """A shape of one grey level on plain ground, sampled eight times as finely and averaged."""
    fine = 8
    y, x = np.mgrid[0 : height * fine, 0 : width * fine]
    x, y = (x + 0.5) / fine - 0.5 - width / 2 - dx, (y + 0.5) / fine - 0.5 - height / 2 - dy
    unit = min(height, width)
    inside = {
        "disc": np.hypot(x - 2.3, y + 1.1) < 0.25 * unit,
        "square": (np.abs(x + 1.7) < 0.22 * unit) & (np.abs(y - 0.6) < 0.18 * unit),
        "silhouette": np.hypot(x, y) < unit * (0.2 + 0.05 * np.sin(3 * np.arctan2(y, x)) + 0.03 * np.cos(5 * x / unit)),
        "letters": (np.abs(y) < 0.3 * unit)
        & (np.abs(x) < 0.35 * unit)
        & (np.sin(x * (1 + x / unit) * 25 / unit) * np.cos(y * (1 + y / unit) * 21 / unit) > 0.2),
    }[kind]
    return (30 + 190 * inside).reshape(height, fine, width, fine).mean((1, 3))


@pytest.mark.parametrize("illumination", ["none", "offset", "gain_offset"])
@pytest.mark.parametrize("kind", ["disc", "square", "silhouette", "letters"])
@pytest.mark.parametrize("size", [(32, 32), (64, 80), (120, 160)])
def test_flat_shapes_are_measured(kind: str, size: tuple[int, int], illumination: str) -> None:
    rng = np.random.default_rng(len(kind) + size[0])
    for dx, dy in ((1.0, 2.0), (-2.0, 1.0), (0.25, -1.5)):
        frames = [flat_shape(kind, *size, 0.0, 0.0), flat_shape(kind, *size, dx, dy)]
        for noise, dtype in ((0.0, np.uint8), (1.5, np.uint8), (0.0, np.float32)):
            noisy = [frame + noise * rng.standard_normal(size) for frame in frames]
            shift = estimate_shift(
                *((np.round(f) if dtype is np.uint8 else f).astype(dtype) for f in noisy), illumination=illumination
            )
            assert shift.valid, (dx, dy, noise, dtype, shift.status)
            assert np.hypot(shift.dx - dx, shift.dy - dy) < 0.12, (dx, dy, noise, dtype)


@pytest.mark.parametrize("illumination", ["none", "offset", "gain_offset"])
def test_rolled_discs_are_exact(illumination: str) -> None:
    y, x = np.mgrid[0:120, 0:160]
    for radius in (20, 30, 40):
        for cx, cy in ((60.0, 50.0), (74.8, 66.4), (97.0, 58.2)):
            disc = np.round(10 + 230 * np.clip(radius - np.hypot(x - cx, y - cy) + 0.5, 0, 1)).astype(np.uint8)
            for d in ((1, 1), (-2, 1), (3, -2), (0, 2)):
                shift = estimate_shift(disc, np.roll(disc, d[::-1], (0, 1)), illumination=illumination)
                assert shift.valid
                assert np.hypot(shift.dx - d[0], shift.dy - d[1]) < 1e-3


@pytest.mark.parametrize("angle", [0.0, 25.0, 90.0, 140.0])
def test_an_edge_is_measured_across(angle: float) -> None:
    rng = np.random.default_rng(round(angle))
    normal = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    y, x = np.mgrid[0:64, 0:64] - 31.5
    frames = [
        np.round(110 + 60 * np.tanh((normal[0] * x + normal[1] * y - t) / 2) + rng.standard_normal(x.shape))
        for t in (0.0, 1.3)
    ]
    shift = estimate_shift(*(frame.astype(np.uint8) for frame in frames))
    assert shift.status == ShiftStatus.APERTURE
    assert abs(shift.direction @ normal) > 0.999
    assert normal @ [shift.dx, shift.dy] == pytest.approx(1.3, abs=5 * np.sqrt(shift.direction_variance) + 0.02)
    assert np.isinf(np.diag(shift.covariance)).any()


def test_particles_of_which_many_are_lost_are_accepted_for_what_they_are_worth() -> None:
    errors, total = [], 0
    for seed in range(6):
        prev, nxt = particles(lambda x, y: (2.3 + 0 * x, -1.4 + 0 * y), 160, seed, loss=0.25)
        for x0 in range(16, 144, 32):
            for y0 in range(16, 144, 32):
                shift = estimate_shift(prev, nxt, roi=(x0, y0, 32, 32), max_displacement=8)
                total += 1
                if shift.valid:
                    errors.append((np.array([shift.dx - 2.3, shift.dy + 1.4]), np.sqrt(np.diag(shift.covariance))))
    assert len(errors) > 0.9 * total
    off, std = (np.array(part) for part in zip(*errors, strict=True))
    assert np.abs(off).max() < 1.0
    assert np.mean(np.abs(off) < 2 * std) > 0.9


def test_unrelated_particles_are_no_match() -> None:
    still = np.zeros_like
    for seed in range(12):
        (prev, _), (nxt, _) = (particles(lambda x, y: (still(x), still(y)), 64, s) for s in (seed, seed + 900))
        for x0, y0 in ((0, 0), (32, 0), (16, 24)):
            assert not estimate_shift(prev, nxt, roi=(x0, y0, 32, 32), max_displacement=12).valid
