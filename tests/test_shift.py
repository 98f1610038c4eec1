"""rsflow.estimate_shift: accuracy, honesty, light, frames of every type and layout."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rsflow
from rsflow import ShiftStatus, estimate_shift
from shift_helpers import moved, pair, particles, scene


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
        ({"roi": (0.5, 0, 20, 20)}, rsflow.OptionError, "four integers"),
        ({"roi": 7}, rsflow.OptionError, "four integers"),
        ({"illumination": "gain"}, rsflow.OptionError, "gain_offset"),
        ({"max_displacement": -1.0}, rsflow.OptionError, "max_displacement: got -1"),
        ({"max_displacement": float("nan")}, rsflow.OptionError, "max_displacement: got NaN"),
        ({"mask": np.ones((60, 59), dtype=bool)}, rsflow.ShapeError, "mask"),
        ({"mask": np.ones((60, 60))}, rsflow.DTypeError, "mask"),
        ({"next_mask": np.ones((60, 59), dtype=bool)}, rsflow.ShapeError, "next_mask"),
        ({"deformation": "linear"}, rsflow.OptionError, "affine"),
    ],
)
def test_misuse_is_explained(options, error, message):
    prev, nxt = pair(1, 1)
    with pytest.raises(error, match=message):
        estimate_shift(prev, nxt, **options)


def test_the_longest_displacement_is_a_length_not_a_side():
    prev, nxt = pair(7.0, 7.0)
    assert estimate_shift(prev, nxt, max_displacement=10.0).valid
    # Each axis is within 8 pixels, the way is not.
    shift = estimate_shift(prev, nxt, max_displacement=8.0)
    assert (shift.status, shift.valid) == (rsflow.ShiftStatus.NO_MATCH, False)
    assert np.isnan([shift.dx, shift.dy, shift.gain, shift.offset, shift.residual]).all()
    assert np.isinf(np.diag(shift.covariance)).all()


def test_frames_of_different_size_are_explained():
    with pytest.raises(rsflow.ShapeError, match="next"):
        estimate_shift(np.zeros((9, 9), np.uint8), np.zeros((9, 8), np.uint8))


def lit(frame: np.ndarray, kind: str) -> np.ndarray:
    """The frame in light that changed in place."""
    y, x = np.mgrid[0 : frame.shape[0], 0 : frame.shape[1]]
    if kind == "spotlight":
        return frame + 60 * np.exp(-((x - 50) ** 2 + (y - 20) ** 2) / (2 * 30**2))
    if kind == "hard shadow":
        return np.where(x + 0.5 * y > 40, 0.5 * frame, frame)
    return frame * np.linspace(0.7, 1.3, frame.shape[1])


@pytest.mark.parametrize(("kind", "limit"), [("ramp", 0.03), ("spotlight", 0.05), ("hard shadow", 0.1)])
@pytest.mark.parametrize("seed", range(4))
def test_light_that_changes_in_place(kind, limit, seed):
    prev, nxt = pair(2.3 - seed, 0.8 * seed, noise=1.0, seed=seed)
    shift = estimate_shift(prev, lit(nxt, kind).astype(np.float32))
    assert shift.valid
    assert np.hypot(shift.dx - 2.3 + seed, shift.dy - 0.8 * seed) < limit


@pytest.mark.parametrize("kind", ["none", "ramp", "spotlight", "hard shadow"])
def test_the_range_of_grey_levels_does_not_matter(kind):
    prev, nxt = pair(2.3, -1.4, noise=1.0)
    nxt = nxt if kind == "none" else lit(nxt, kind)
    prev, nxt = (np.clip(np.round(frame), 0, 255).astype(np.uint8) for frame in (prev, nxt))
    want = estimate_shift(prev, nxt)
    assert want.valid
    for scale, convert in (
        (257, lambda a: a.astype(np.uint16) * np.uint16(257)),
        (1 / 255, lambda a: (a / 255).astype(np.float32)),
        (1e-6, lambda a: (a * 1e-6).astype(np.float32)),
    ):
        found = estimate_shift(convert(prev), convert(nxt))
        assert np.hypot(found.dx - want.dx, found.dy - want.dy) < 1e-4
        assert found.gain == pytest.approx(want.gain, rel=1e-4)
        assert found.offset == pytest.approx(scale * want.offset, rel=1e-3, abs=1e-3 * scale)
        assert found.residual == pytest.approx(scale * want.residual, rel=1e-4)
        np.testing.assert_allclose(found.covariance, want.covariance, rtol=1e-2, atol=1e-7)


@pytest.mark.parametrize("sigma", [1.3, 4.0])
@pytest.mark.parametrize("gain", [1.0, 0.7])
def test_the_covariance_covers(sigma, gain):
    rng = np.random.default_rng(round(10 * sigma + gain))
    errors = []
    for run in range(250):
        if run % 10 == 0:
            dx, dy = rng.uniform(-3, 3, 2)
            prev, nxt = (frame.astype(np.float64) for frame in pair(dx, dy, seed=run, sigma=sigma))
        frames = (prev, gain * nxt + 10)
        shift = estimate_shift(*(np.round(f + rng.standard_normal(f.shape)).astype(np.uint8) for f in frames))
        assert shift.valid
        errors += [(shift.dx - dx) / np.sqrt(shift.covariance[0, 0]), (shift.dy - dy) / np.sqrt(shift.covariance[1, 1])]
    inside = [np.mean(np.abs(errors) < deviations) for deviations in (1, 2)]
    assert 0.60 < inside[0] < 0.76
    assert 0.90 < inside[1] < 0.99


@pytest.mark.parametrize("sigma", [1.3, 5.0])
def test_unrelated_windows_are_no_match(sigma):
    for seed in range(10):
        prev, _ = pair(0, 0, seed=seed, noise=1.0, sigma=sigma)
        nxt, _ = pair(0, 0, seed=seed + 500, noise=1.0, sigma=sigma)
        assert estimate_shift(prev, nxt).status == ShiftStatus.NO_MATCH


@pytest.mark.parametrize(("size", "most"), [(60, 0.06), (100, 0.01)])
def test_a_hard_shadow_on_smooth_windows_does_not_draw_the_displacement(size: int, most: float) -> None:
    off = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        dx, dy = rng.uniform(-5, 5, 2)
        prev, nxt = pair(dx, dy, noise=1.0, seed=seed, sigma=4.0, size=size)
        y, x = np.mgrid[0:size, 0:size] - size / 2
        angle = rng.uniform(0, 2 * np.pi)
        border = x * np.cos(angle) + y * np.sin(angle) - rng.uniform(-0.2, 0.2) * size
        shift = estimate_shift(prev, np.where(border > 0, 0.5, 1.0).astype(np.float32) * nxt)
        if shift.valid:
            std = np.sqrt(np.diag(shift.covariance))
            off.append([shift.dx - dx, shift.dy - dy, (shift.dx - dx) / std[0], (shift.dy - dy) / std[1]])
    lengths = np.hypot(*np.transpose(off)[:2])
    assert len(off) >= 22
    assert np.median(lengths) < most
    assert np.sum(lengths > 0.3) <= 1
    assert np.mean(np.abs(off)[:, 2:] < 2) > 0.8


def test_noise_is_no_texture():
    rng = np.random.default_rng(4)
    prev, nxt = (rng.normal(100, 5, (80, 80)).astype(np.float32) for _ in range(2))
    assert estimate_shift(prev, nxt).status == ShiftStatus.NO_TEXTURE


def test_the_command_prints_what_was_measured(tmp_path, capsys):
    cv2 = pytest.importorskip("cv2")
    from rsflow.cli import main

    paths = []
    for name, frame in zip("ab", pair(3.25, -1.5), strict=True):
        paths.append(str(tmp_path / f"{name}.png"))
        cv2.imwrite(paths[-1], np.round(frame).astype(np.uint8))
    assert main(["shift", *paths, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["valid"]
    assert found["dx"] == pytest.approx(3.25, abs=0.02)
    assert main(["shift", *paths, "--roi", "10,10,40,40"]) == 0
    text = capsys.readouterr().out
    assert "sigma_x" in text
    assert "VALID: measured" in text
    flat = str(tmp_path / "flat.png")
    cv2.imwrite(flat, np.full((60, 60), 9, dtype=np.uint8))
    assert main(["shift", flat, flat, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["dx"] is None
    assert main(["shift", flat, str(tmp_path / "none.png")]) == 1
    assert "none.png: cannot be read: No such file" in capsys.readouterr().err


@pytest.mark.parametrize("illumination", ["none", "offset", "gain_offset"])
@pytest.mark.parametrize("level", [0, 90, 255])
def test_a_blank_frame_is_not_measured(illumination: str, level: int) -> None:
    """A gain of zero explains any blank frame; it is not light."""
    pair = rsflow.synthetic.shifted_pair(1.0, 0.0, size=(96, 72), seed=99)
    blank = np.full_like(pair.prev, level)
    for prev, nxt in ((pair.next, blank), (blank, pair.next), (blank, blank)):
        shift = rsflow.estimate_shift(prev, nxt, illumination=illumination)
        assert shift.status in (rsflow.ShiftStatus.NO_TEXTURE, rsflow.ShiftStatus.NO_MATCH), shift
        assert np.isnan(shift.dx)
        assert np.isinf(shift.covariance[0, 0])


def test_a_window_that_deforms_gives_its_centre_and_its_gradient() -> None:
    gradient = np.array([[0.0, 0.03], [-0.01, 0.02]])
    centre = 79.5

    def field(x, y):
        return (
            1.2 + gradient[0, 0] * (x - centre) + gradient[0, 1] * (y - centre),
            -0.7 + gradient[1, 0] * (x - centre) + gradient[1, 1] * (y - centre),
        )

    off, units = [], []
    for seed in range(5):
        prev, nxt = particles(field, 160, seed)
        for x0 in range(16, 144, 32):
            for y0 in range(16, 144, 32):
                shift = estimate_shift(prev, nxt, roi=(x0, y0, 32, 32), max_displacement=8, deformation="affine")
                assert shift.valid
                truth = np.array(field(x0 + 15.5, y0 + 15.5))
                off.append([shift.dx, shift.dy] - truth)
                errors = np.concatenate([off[-1], (shift.gradient - gradient).ravel()])
                units.append(errors / np.sqrt(np.diag(shift.joint_covariance)))
                np.testing.assert_array_equal(shift.joint_covariance[:2, :2], shift.covariance)
                assert shift.gradient_covariance.shape == (4, 4)
    assert np.sqrt(np.mean(np.sum(np.square(off), axis=1))) < 0.02
    assert 0.60 < np.mean(np.abs(units) < 1) < 0.82
    assert 0.90 < np.mean(np.abs(units) < 2) < 0.995


@pytest.mark.parametrize(
    "matrix", [((0.0, 0.05), (0.0, 0.0)), ((0.05, 0.0), (0.0, 0.05)), ((0.0, -0.03), (0.03, 0.0))], ids=str
)
def test_a_window_that_deforms_is_not_sure_and_wrong_without_its_gradient(matrix) -> None:
    """It may settle on a part that moves alike: then the deviation says how far off the middle may be."""
    (xx, xy), (yx, yy) = matrix

    def move(x, y):
        x, y = x - 79.5, y - 59.5
        return 1.3 + xx * x + xy * y, -0.6 + yx * x + yy * y

    for seed in range(4):
        scene = rsflow.synthetic.textured_pair(move, size=(160, 120), seed=seed)
        shift = estimate_shift(scene.prev, scene.next)
        assert shift.status in (ShiftStatus.VALID, ShiftStatus.NO_MATCH, ShiftStatus.NOT_CONVERGED)
        if shift.valid:
            assert (np.abs([shift.dx - 1.3, shift.dy + 0.6]) < 3 * np.sqrt(np.diag(shift.covariance))).all()
        whole = estimate_shift(scene.prev, scene.next, deformation="affine")
        assert whole.valid
        assert np.hypot(whole.dx - 1.3, whole.dy + 0.6) < 0.02


def test_windows_of_a_vortex_say_how_far_off_their_centre_may_be() -> None:
    """The displacement is not linear over a window: the centre is corrected, and its covariance holds the rest."""
    centre = 127.5

    def field(x, y):
        turn = 0.075 * np.exp(-np.hypot(x - centre, y - centre) / 100)
        return -(y - centre) * turn, (x - centre) * turn

    off, units = [], []
    for seed in range(2):
        prev, nxt = particles(field, 256, seed)
        for x0 in range(16, 224, 32):
            for y0 in range(16, 224, 32):
                shift = estimate_shift(prev, nxt, roi=(x0, y0, 32, 32), max_displacement=8, deformation="affine")
                assert shift.valid
                off.append([shift.dx, shift.dy] - np.array(field(x0 + 15.5, y0 + 15.5)))
                units.append(off[-1] / np.sqrt(np.diag(shift.covariance)))
    assert np.sqrt(np.mean(np.sum(np.square(off), axis=1))) < 0.03
    assert np.mean(np.abs(units) < 1) > 0.55
    assert np.mean(np.abs(units) < 2) > 0.85


@pytest.mark.parametrize("side", ["prev", "next", "both"])
@pytest.mark.parametrize("fill", [0.0, 255.0, np.nan])
def test_an_overlay_that_is_masked_says_nothing(side: str, fill: float) -> None:
    off = []
    for seed in range(12):
        dx, dy = np.random.default_rng(seed).uniform(-3, 3, 2)
        prev, nxt = pair(dx, dy, size=64, noise=1.0, seed=seed)
        keep = np.ones(prev.shape, dtype=bool)
        keep[8:30, 20:50] = False
        frames = {"prev": prev.copy(), "next": nxt.copy()}
        masks = {}
        for name, argument in (("prev", "mask"), ("next", "next_mask")):
            if side in (name, "both"):
                frames[name][~keep] = fill
                masks[argument] = keep
        shift = estimate_shift(frames["prev"], frames["next"], **masks)
        assert shift.valid
        std = np.sqrt(np.diag(shift.covariance))
        off += [(shift.dx - dx) / std[0], (shift.dy - dy) / std[1]]
    assert np.abs(off).max() < 4
    assert np.mean(np.abs(off) < 2) > 0.8


def test_dead_pixels_cost_little() -> None:
    rng = np.random.default_rng(1)
    valid = 0
    for seed in range(20):
        dx, dy = rng.uniform(-4, 4, 2)
        prev, nxt = (frame.copy() for frame in pair(dx, dy, size=60, noise=1.0, seed=seed))
        for frame in (prev, nxt):
            frame[rng.random(frame.shape) < 0.01] = np.nan
        shift = estimate_shift(prev, nxt)
        valid += shift.valid and np.hypot(shift.dx - dx, shift.dy - dy) < 0.1
    assert valid == 20


def test_no_support_in_common_is_told() -> None:
    prev, nxt = pair(1.0, 1.0)
    left = np.zeros(prev.shape, dtype=bool)
    left[:, :30] = True
    assert not estimate_shift(prev, nxt, mask=left, next_mask=~left).valid
    assert estimate_shift(prev, nxt, mask=np.zeros_like(left)).status == ShiftStatus.TOO_SMALL
