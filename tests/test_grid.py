"""Measuring grids: displacement, gradient and covariance against the exact truth of made scenes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rsflow
from rsflow import synthetic
from rsflow.grid.strain import strain_of
from rsflow.synthetic import lighting

SIZE = (224, 192)


def stretch(x, y):
    return 0.02 * (x - 100) + 0.3, -0.006 * (y - 100) + 1.2


def turn(x, y):
    angle = np.deg2rad(5)
    x, y = x - 110, y - 95
    return np.cos(angle) * x - np.sin(angle) * y - x, np.sin(angle) * x + np.cos(angle) * y - y


def vortex(x, y):
    x, y = x - 112.3, y - 95.8
    r2 = x * x + y * y + 1e-9
    k = 4 * 1.1209 * 60 / 0.7153 * (1 - np.exp(-r2 / 60**2)) / r2
    return -k * y, k * x


def wave(x, y):
    return 0.5 * np.sin(2 * np.pi * (x + 3) / 64), 0 * y


def errors(grid, scene):
    """Errors of what is valid, and over their deviations."""
    wrong = np.stack([grid.u, grid.v], -1) - scene.truth(grid.x, grid.y)
    return wrong[grid.valid], (wrong / grid.std)[grid.valid]


# Root mean square error allowed, in pixels: those of the bench, and a tenth more.
CASES = {
    "stretched speckle": (synthetic.speckle_pair, stretch, {}, {}, 0.0036),
    "turned speckle": (synthetic.speckle_pair, turn, {}, {}, 0.0036),
    "a wave in speckle": (synthetic.speckle_pair, wave, {}, {"shape": "quadratic"}, 0.0105),
    "uniform particles": (synthetic.particle_pair, lambda x, y: (2.37, -1.61), {}, {}, 0.0075),
    "a vortex": (synthetic.particle_pair, vortex, {}, {"shape": "quadratic", "window_size": 41}, 0.0125),
    "a vortex in other light": (
        synthetic.particle_pair,
        vortex,
        {"lighting": lambda image: lighting.ramp(0.7, 0.9)(image)},
        {"shape": "quadratic", "window_size": 41},
        0.0135,
    ),
    "a fifth of the particles lost": (
        synthetic.particle_pair,
        vortex,
        {"lost": 0.2},
        {"shape": "quadratic", "window_size": 41, "robust": True},
        0.023,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_errors_are_small_and_of_the_size_that_is_said(case):
    make, motion, conditions, options, allowed = CASES[case]
    scene = make(motion, size=SIZE, seed=7, **conditions)
    grid = rsflow.displacement_grid(scene.prev, scene.next, **options)
    wrong, sigmas = errors(grid, scene)
    assert grid.valid.mean() >= 0.98
    assert np.sqrt((wrong**2).mean()) < allowed
    # A Gaussian has 68 % and 95 % of its values within one and two deviations.
    assert 0.56 < (abs(sigmas) < 1).mean() < 0.84
    assert (abs(sigmas) < 2).mean() > 0.88
    assert abs(sigmas).max() < 8


def test_the_gradient_has_deviations_too():
    scene = synthetic.speckle_pair(stretch, size=SIZE, seed=3)
    grid = rsflow.displacement_grid(scene.prev, scene.next)
    wrong = grid.gradient - scene.gradient(grid.x, grid.y)
    std = np.sqrt(np.diagonal(grid.joint_covariance[..., 2:, 2:], axis1=-2, axis2=-1)).reshape(wrong.shape)
    assert abs(wrong.mean(axis=(0, 1))).max() < 1e-4
    assert 0.55 < (abs(wrong) < std).mean() < 0.85
    for kind, xx in (("small", 0.02), ("green", 0.02 + 0.0002), ("hencky", np.log(1.02))):
        strain = grid.strain(kind)
        assert abs(strain.xx.mean() - xx) < 1e-4
        assert abs(strain.yy.mean() - -0.006) < 1e-4
        assert 0.5 < (abs(strain.xx - xx) < strain.std_xx).mean() < 0.9
        assert strain.gauge_length_px == 32.0


def test_what_turns_is_not_strained():
    scene = synthetic.speckle_pair(turn, size=SIZE, seed=5)
    grid = rsflow.displacement_grid(scene.prev, scene.next)
    assert abs(np.median(grid.vorticity) - 2 * np.sin(np.deg2rad(5))) < 2e-4
    assert abs(np.median(grid.divergence) - 2 * (np.cos(np.deg2rad(5)) - 1)) < 2e-4
    assert (grid.vorticity_std < 2e-3).all()
    for kind in ("green", "hencky"):
        assert abs(np.median(grid.strain(kind).xx)) < 1e-4


def test_strain_bias_is_below_one_in_a_hundred_thousand_without_noise():
    scene = synthetic.speckle_pair(
        lambda x, y: (0.01 * x, 0 * y), size=SIZE, speckle_px=2.5, sensor=synthetic.Sensor(0.0, dtype="float32"), seed=2
    )
    grid = rsflow.displacement_grid(scene.prev, scene.next)
    assert abs(grid.gradient[..., 0, 0].mean() - 0.01) < 1e-5


def test_masks_and_borders_have_honest_deviations():
    scene = synthetic.speckle_pair(stretch, size=SIZE, seed=11)
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    keep = np.hypot(x - 110, y - 90) > 40
    prev = np.where(keep, scene.prev, np.random.default_rng(1).integers(0, 256, keep.shape)).astype(np.uint8)
    grid = rsflow.displacement_grid(prev, scene.next, mask=keep, step=8)
    _, sigmas = errors(grid, scene)
    at_edge = np.zeros(grid.valid.shape, bool)
    for row, column in np.ndindex(at_edge.shape):
        top, left = int(grid.y[row, column] - 15.5), int(grid.x[row, column] - 15.5)
        at_edge[row, column] = not keep[top : top + 32, left : left + 32].all()
    inside = at_edge[grid.valid]
    assert inside.sum() > 60
    for part in (inside, ~inside):
        assert 0.55 < (abs(sigmas[part]) < 1).mean() < 0.85
        assert (abs(sigmas[part]) < 2).mean() > 0.88
    assert (grid.status[~grid.valid] == rsflow.GridStatus.LOW_SUPPORT).mean() > 0.8
    assert np.isnan(grid.u[~grid.valid]).all()


def test_unrelated_frames_give_no_displacement_that_is_sure():
    for seed in range(3):
        prev = synthetic.particle_pair(lambda x, y: (0 * x, 0 * y), size=SIZE, seed=seed).prev
        other = synthetic.particle_pair(lambda x, y: (0 * x, 0 * y), size=SIZE, seed=seed + 50).prev
        for robust in (False, True):
            grid = rsflow.displacement_grid(prev, other, robust=robust)
            assert grid.valid.mean() < 0.02


def test_far_and_turned_motion_is_found():
    def far(x, y):
        u, v = turn(x, y)
        return u + 27.3, v - 19.1

    scene = synthetic.particle_pair(far, size=(288, 256), seed=4)
    grid = rsflow.displacement_grid(scene.prev, scene.next)
    wrong, _ = errors(grid, scene)
    assert grid.valid.mean() > 0.75
    assert abs(wrong).max() < 0.3
    again = rsflow.displacement_grid(scene.prev, scene.next, initial=grid)
    assert abs(again.u - grid.u)[again.valid & grid.valid].max() < 0.05


def test_what_was_replaced_stands_apart():
    scene = synthetic.speckle_pair(stretch, size=SIZE, seed=1)
    keep = np.ones(SIZE[::-1], bool)
    keep[70:130, 80:150] = False
    grid = rsflow.displacement_grid(scene.prev, scene.next, mask=keep)
    filled = grid.replaced()
    assert filled.replaced.any()
    assert (filled.replaced == ~grid.valid).all()
    assert np.array_equal(filled.u[grid.valid], grid.u[grid.valid])
    truth = scene.truth(grid.x, grid.y)
    assert abs(filled.u - truth[..., 0]).max() < 0.3
    assert np.isnan(grid.u[~grid.valid]).all()
    assert np.isinf(grid.std[~grid.valid]).all()


def test_units_are_those_that_were_given():
    scene = synthetic.particle_pair(lambda x, y: (2.0, -1.0), size=(96, 96), seed=1)
    grid = rsflow.displacement_grid(scene.prev, scene.next, scale_m_px=5e-5, dt_s=1e-3)
    assert np.allclose(np.nanmean(grid.velocity_m_s, axis=(0, 1)), [0.1, -0.05], atol=1e-3)
    plain = rsflow.displacement_grid(scene.prev, scene.next)
    with pytest.raises(rsflow.OptionError, match="velocity_m_s: got scale_m_px=None, dt_s=None"):
        _ = plain.velocity_m_s


def test_a_lens_is_taken_out():
    camera = rsflow.Camera(200.0, 200.0, 111.5, 95.5, width=224, height=192, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))

    def seen(x, y):
        # A pure shift before the lens, as the lens shows it.
        ideal = camera.undistort_points(np.stack([x.ravel(), y.ravel()], 1).astype(float)) + np.array([3.0, -2.0])
        moved = camera.distort_points(ideal).reshape(*x.shape, 2)
        return moved[..., 0] - x, moved[..., 1] - y

    scene = synthetic.speckle_pair(seen, size=SIZE, seed=9)
    grid = rsflow.displacement_grid(scene.prev, scene.next, camera=camera)
    assert abs(grid.u - 3.0)[grid.valid].max() < 0.05
    assert abs(grid.v + 2.0)[grid.valid].max() < 0.05
    assert abs(grid.gradient[grid.valid]).max() < 0.006
    assert 0.5 < (abs(grid.u - 3.0) < grid.std[..., 0])[grid.valid].mean() < 0.9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window_size": 7}, "window_size: got 7, expected an integer of pixels from 8 to 256"),
        ({"step": 0}, "step: got 0"),
        ({"shape": "cubic"}, "shape: got"),
        ({"robust": 1}, "robust: got 1, expected True or False"),
        ({"initial": np.zeros((3, 3, 2))}, "initial: got shape"),
        ({"scale_m_px": 0}, "scale_m_px: got 0"),
        ({"camera": 3}, "camera: got"),
    ],
)
def test_what_does_not_fit_is_told(options, message):
    frame = synthetic.texture((96, 96), seed=1).astype(np.float32)
    with pytest.raises(rsflow.RsflowError, match=message):
        rsflow.displacement_grid(frame, frame, **options)


def test_frames_without_room_have_no_nodes():
    frame = np.zeros((20, 200), np.uint8)
    grid = rsflow.displacement_grid(frame, frame)
    assert grid.u.shape == (0, 0)
    assert len(grid.to_table()["u_px"]) == 0
    assert "0 of 0 measured" in repr(grid)


@settings(max_examples=40, deadline=None)
@given(
    values=st.lists(st.floats(-0.3, 0.3), min_size=4, max_size=4),
    deviations=st.lists(st.floats(1e-5, 1e-2), min_size=4, max_size=4),
)
def test_strain_deviations_are_those_of_small_changes(values, deviations):
    gradient = np.array(values).reshape(1, 1, 2, 2)
    covariance = np.diag(np.square(deviations))[None, None]
    for kind in ("small", "green", "hencky"):
        found = strain_of(kind, gradient, covariance, 1.0)
        variance = 0.0
        for k, deviation in enumerate(deviations):
            change = np.zeros(4)
            change[k] = 1e-6
            moved = strain_of(kind, gradient + change.reshape(1, 1, 2, 2), covariance, 1.0)
            variance += ((moved.xy - found.xy) / 1e-6 * deviation) ** 2
        assert np.allclose(found.std_xy, np.sqrt(variance), rtol=1e-3, atol=1e-9)


def test_made_scenes_are_what_they_say():
    still = synthetic.Sensor(0.0)
    particles = synthetic.particle_pair(lambda x, y: (3.0, -2.0), size=(96, 80), sensor=still, seed=1)
    # Whole pixels: the second frame is the first one, moved.
    assert np.array_equal(particles.prev[6:70, 4:80], particles.next[4:68, 7:83])
    speckle = synthetic.speckle_pair(lambda x, y: (3.0 + 0 * x, 0 * y), size=(96, 80), sensor=still, seed=1)
    assert np.array_equal(speckle.prev[:, :90], speckle.next[:, 3:93])
    lost = synthetic.particle_pair(lambda x, y: (0.0, 0.0), size=(96, 80), lost=1.0, sensor=still, seed=1)
    assert np.corrcoef(lost.prev.ravel(), lost.next.ravel())[0, 1] < 0.2
    with pytest.raises(rsflow.ShapeError, match="displacement: got float, expected a function"):
        synthetic.speckle_pair(lambda x, y: 3.0, size=(64, 64))


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.tuples(st.integers(0, 90), st.integers(0, 90)),
    window=st.integers(8, 60),
    step=st.integers(1, 40),
    shape=st.sampled_from(["translation", "affine", "quadratic"]),
    robust=st.booleans(),
    kind=st.sampled_from(["uint8", "uint16", "float32", "huge", "holes"]),
    illumination=st.sampled_from(["none", "offset", "gain_offset"]),
)
def test_any_frames_give_a_grid_that_is_whole(seed, size, window, step, shape, robust, kind, illumination):
    rng = np.random.default_rng(seed)
    frames = []
    for _ in range(2):
        frame = rng.integers(0, 256, size[::-1])
        if kind in ("uint8", "uint16"):
            frames.append((frame * (257 if kind == "uint16" else 1)).astype(kind))
            continue
        frame = frame.astype(np.float32) * np.float32(1e30 if kind == "huge" else 1.0)
        if kind == "holes" and frame.size:
            frame[rng.random(frame.shape) < 0.1] = rng.choice([np.nan, np.inf, -np.inf])
        frames.append(frame)
    if rng.random() < 0.5:
        frames[1] = frames[0].copy()
    keep = rng.random(size[::-1]) < 0.9 if rng.random() < 0.3 else None
    options = {"window_size": window, "step": step, "shape": shape, "robust": robust, "illumination": illumination}
    grid = rsflow.displacement_grid(*frames, mask=keep, initial=(0.5, -0.5) if seed % 2 else None, **options)
    assert grid.u.shape == grid.status.shape == grid.x.shape
    assert np.isfinite(grid.raw[grid.valid]).all()
    variance = grid.joint_covariance[..., [0, 1], [0, 1]]
    assert (np.isfinite(variance) == grid.valid[..., None]).all()
    assert (variance >= 0).all()
    if shape != "translation":
        assert np.isfinite(grid.gradient[grid.valid]).all()
    assert (grid.status <= 7).all()
