"""The truth of synthetic scenes holds: checked against independent evaluation, never against the renderer itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import ndimage

from rsflow import Camera, OptionError, ShapeError, synthetic
from rsflow.synthetic import (
    LIGHTING,
    MovingObject,
    Part,
    Sensor,
    Texture,
    flight,
    flight_with_object,
    motions_pair,
    shifted_pair,
    texture,
)

CLEAN = Sensor(noise=0.0, dtype="float32")
WIDE = Camera(150.0, 152.0, 80.0, 60.0, width=160, height=120, distortion=(-0.25, 0.12, 0.001, -0.0005, 0.01))


def interpolated(frame: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The frame as a function of (x, y), by a spline of order 5."""
    return lambda points: ndimage.map_coordinates(frame.astype(float), points[:, ::-1].T, order=5)


@pytest.mark.parametrize("kind", sorted(synthetic.BANDS))
def test_texture_is_standardised_and_seeded(kind: str) -> None:
    a, b = texture((200, 301), kind, seed=4), texture((200, 301), kind, seed=5)
    assert a.shape == (200, 301)
    assert abs(a.mean()) < 1e-9
    assert a.std() == pytest.approx(1.0)
    np.testing.assert_array_equal(a, texture((200, 301), kind, seed=4))
    assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.3


def test_texture_is_band_limited() -> None:
    power = np.abs(np.fft.fft2(texture((256, 256), "smooth", seed=1))) ** 2
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(256)))
    assert power[f > 0.4].sum() < 1e-4 * power.sum()


@pytest.mark.parametrize("kind", sorted(synthetic.BANDS))
def test_spline_is_within_a_thousandth_of_the_fourier_series(kind: str) -> None:
    period, over = 48, 2.0
    t = Texture.make(kind, seed=2, period=period, oversample=over)
    size = t.coefficients.shape[0]
    w = 2 * np.pi * np.fft.fftfreq(size)
    # Coefficients to grid values to Fourier series: exact for the band-limited function through the grid's points.
    response = (4 + 2 * np.cos(w)) / 6
    series = np.fft.fft2(t.coefficients) * response[:, None] * response[None, :] / size**2
    rng = np.random.default_rng(11)
    x, y = rng.uniform(-100, 100, (2, 300))
    exact = np.array([
        np.real(np.exp(1j * w * v * over) @ series @ np.exp(1j * w * u * over)) for u, v in zip(x, y, strict=True)
    ])  # fmt: skip
    error = t.sample(x, y) - exact
    assert np.sqrt(np.mean(error**2)) < 1e-3
    assert np.abs(error).max() < 5e-3


def test_separable_sampling_equals_the_general_one() -> None:
    t = Texture.make("ground", seed=3, period=64)
    x, y = np.linspace(-70, 90, 23)[None, :], np.linspace(5, 300, 17)[:, None]
    wide_x, wide_y = np.broadcast_arrays(x, y)
    np.testing.assert_allclose(t.sample(x, y), t.sample(wide_x.copy(), wide_y.copy()), atol=1e-12)


@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (3.0, -2.0), (0.37, 0.81), (-7.25, 4.5)])
def test_shifted_pair_moves_by_exactly_that(dx: float, dy: float) -> None:
    pair = shifted_pair(dx, dy, size=(64, 56), sensor=CLEAN, seed=9)
    if dx == int(dx):
        x, y = int(dx), int(dy)
        a = pair.prev[max(0, -y) : 56 - max(0, y), max(0, -x) : 64 - max(0, x)]
        b = pair.next[max(0, y) : 56 - max(0, -y), max(0, x) : 64 - max(0, -x)]
        np.testing.assert_allclose(a, b, atol=1e-4)
    # An independent interpolation moves `prev` by that much; what it leaves is less than a thousandth of a pixel.
    moved = ndimage.shift(pair.prev.astype(float), (dy, dx), order=5, mode="mirror")
    gy, gx = np.gradient(moved)
    crop = (slice(14, -14), slice(14, -14))
    jacobian = np.stack([gx[crop].ravel(), gy[crop].ravel()], axis=1)
    rest = np.linalg.lstsq(jacobian, (moved - pair.next)[crop].ravel(), rcond=None)[0]
    assert np.hypot(*rest) < 1e-3
    assert (pair.dx, pair.dy) == (dx, dy)


def test_shifted_pair_shows_new_content_at_the_border() -> None:
    pair = shifted_pair(10.0, 0.0, size=(60, 60), sensor=CLEAN, seed=1)
    circular = np.roll(pair.prev, 10, axis=1)
    np.testing.assert_allclose(circular[:, 10:], pair.next[:, 10:], atol=1e-4)
    assert np.abs(circular[:, :10] - pair.next[:, :10]).mean() > 5.0


def test_shifted_pair_light_noise_and_dtype() -> None:
    steady = shifted_pair(1.5, 0.5, sensor=CLEAN, seed=2)
    lit = shifted_pair(1.5, 0.5, sensor=CLEAN, seed=2, lighting=synthetic.gain(0.8, plus=7.0))
    np.testing.assert_array_equal(steady.prev, lit.prev)
    np.testing.assert_allclose(lit.next, 0.8 * steady.next + 7.0, rtol=1e-5)
    noisy = shifted_pair(1.5, 0.5, size=(200, 200), sensor=Sensor(noise=3.0, dtype="float32"), seed=2)
    clean = shifted_pair(1.5, 0.5, size=(200, 200), sensor=CLEAN, seed=2)
    assert (noisy.prev - clean.prev).std() == pytest.approx(3.0, rel=0.03)
    sixteen = shifted_pair(0.0, 0.0, sensor=Sensor(noise=0.0, dtype="uint16"), seed=2)
    assert sixteen.prev.dtype == np.uint16
    np.testing.assert_allclose(sixteen.prev / 257.0, np.clip(steady.prev, 0, 255), atol=0.01)
    assert clean.bound_px == 0.0
    assert 0.003 < shifted_pair(0.0, 0.0, seed=2).bound_px < 0.02


def test_parts_go_where_their_motion_says() -> None:
    turning = Part(dx=9.25, dy=-4.5, turn_deg=15, zoom=1.1, x=80, y=60, box=(50, 30, 60, 60))
    pair = motions_pair([Part(dx=-3.5, dy=2.25), turning], size=(160, 120), sensor=CLEAN, seed=3)
    prev, after = (interpolated(frame) for frame in (pair.prev, pair.next))
    rng = np.random.default_rng(0)
    points = rng.uniform((10, 10), (150, 110), (400, 2))
    clear = pair.clear(points, radius=6)
    assert 0.2 < clear.mean() < 0.9
    inside = turning.covers(points)
    np.testing.assert_allclose(turning.trace(turning.move(points)), points, atol=1e-9)
    truth = pair.truth(points)
    np.testing.assert_allclose(truth[clear & ~inside], (points + np.array([-3.5, 2.25]))[clear & ~inside])
    np.testing.assert_allclose(truth[clear & inside], turning.move(points)[clear & inside])
    for part in (False, True):
        chosen = clear & (inside == part)
        assert chosen.sum() > 20
        difference = prev(points[chosen]) - after(truth[chosen])
        # Grey levels of unrelated places differ by some 50.
        assert np.sqrt(np.mean(difference**2)) < 1.0


@pytest.mark.parametrize("name", sorted(LIGHTING))
def test_lighting_keeps_the_shape_and_changes_the_light(name: str) -> None:
    image = np.linspace(20.0, 200.0, 24 * 32).reshape(24, 32)
    before = image.copy()
    lit = LIGHTING[name](image)
    assert lit.shape == image.shape
    np.testing.assert_array_equal(image, before)
    assert (name == "steady") == np.array_equal(lit, image)


def test_lighting_is_what_its_name_says() -> None:
    flat = np.full((10, 20), 100.0)
    assert synthetic.offset(25.0)(flat)[0, 0] == 125.0
    np.testing.assert_allclose(synthetic.ramp(0.5, 1.5)(flat)[0, [0, 19]], [50.0, 150.0])
    np.testing.assert_allclose(synthetic.ramp(0.5, 1.5, axis="y")(flat)[[0, 9], 0], [50.0, 150.0])
    np.testing.assert_allclose(synthetic.gamma(0.5)(np.array([[0.0, 63.75, 255.0]])), [[0.0, 127.5, 255.0]])
    assert synthetic.spotlight(40.0, x=0.5, y=0.5)(flat)[5, 10] == 140.0
    assert set(np.unique(synthetic.shadow(0.5)(flat))) == {50.0, 100.0}


def test_flight_truth_is_consistent() -> None:
    f = flight(WIDE, frames=6, rate_hz=15.0, height_m=0.3, velocity_m_s=(0.05, -0.02, 0.06),
               rate_rad_s=(0.2, -0.1, 0.5), tilt_rad=(0.1, -0.05), sensor=CLEAN, seed=1)  # fmt: skip
    assert len(f) == 6
    assert f.images.dtype == np.float32
    assert np.isnan(f.velocity_m_s[0]).all()
    assert [(frame.index, frame.t_s) for frame in f] == [(k, k / 15.0) for k in range(6)]
    np.testing.assert_allclose(np.linalg.norm(f.down, axis=1), 1.0)
    np.testing.assert_allclose(f.height_m, -f.position_m[:, 2])
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(f.position_m, axis=0), axis=1) * 15.0, np.linalg.norm((0.05, -0.02, 0.06)), rtol=1e-12
    )
    level = flight(frames=3, height_m=0.2, velocity_m_s=(0.0, 0.0, 0.3), sensor=CLEAN)
    np.testing.assert_allclose(level.height_m, 0.2 - 0.3 * level.t_s)


@pytest.mark.parametrize(
    ("camera", "motion"),
    [
        (None, {"velocity_m_s": (0.05, 0.03, 0.0)}),
        (None, {"velocity_m_s": (0.0, 0.0, 0.5)}),
        (WIDE, {"velocity_m_s": (0.05, -0.02, 0.1), "rate_rad_s": (0.3, -0.2, 1.0), "tilt_rad": (0.15, -0.1)}),
    ],
)
def test_flow_is_where_the_ground_goes(camera: Camera | None, motion: dict[str, object]) -> None:
    """The next picture, read where the flow points, shows the previous one, to the accuracy of the reading."""
    f = flight(camera, frames=2, kind="smooth", sensor=CLEAN, seed=3, **motion)  # type: ignore[arg-type]
    flow = f.flow(1)
    height, width = f.images[0].shape
    y, x = np.indices((height, width))
    to_x, to_y = x + flow[..., 0], y + flow[..., 1]
    inside = (to_x > 4) & (to_x < width - 5) & (to_y > 4) & (to_y < height - 5)
    assert inside.mean() > 0.5
    # Not cv2.remap, which rounds positions to 1/32 px in some versions.
    read = ndimage.map_coordinates(f.images[1].astype(float), [to_y[inside], to_x[inside]], order=5)
    error = read - f.images[0][inside]
    slope = np.hypot(*np.gradient(f.images[0].astype(float)))[inside]
    assert np.sqrt(np.mean(error**2)) / np.sqrt(np.mean(slope**2)) < 0.005


def test_flow_of_a_level_flight_is_the_reports_equation() -> None:
    f = flight(frames=2, rate_hz=30.0, height_m=0.2, velocity_m_s=(0.02, -0.01, 0.0))
    np.testing.assert_allclose(f.flow(1)[..., 0], -0.02 * 180 / 0.2 / 30, atol=1e-9)
    np.testing.assert_allclose(f.flow(1)[..., 1], 0.01 * 180 / 0.2 / 30, atol=1e-9)


def test_rendered_motion_is_the_true_one_to_a_thousandth_of_a_pixel() -> None:
    f = flight(frames=2, rate_hz=30.0, height_m=0.2, velocity_m_s=(0.013, -0.007, 0.0), sensor=CLEAN, seed=5)
    truth = f.flow(1)[0, 0]
    moved = ndimage.shift(f.images[0].astype(float), (truth[1], truth[0]), order=5, mode="mirror")
    gy, gx = np.gradient(moved)
    crop = (slice(15, -15), slice(15, -15))
    jacobian = np.stack([gx[crop].ravel(), gy[crop].ravel()], axis=1)
    rest = np.linalg.lstsq(jacobian, (moved - f.images[1])[crop].ravel(), rcond=None)[0]
    assert np.hypot(*rest) < 1e-3


def test_motion_blur_averages_the_way() -> None:
    still = flight(times_s=[0.0, 0.1], velocity_m_s=(0.1, 0.0, 0.0), sensor=CLEAN, seed=2)
    blurred = flight(times_s=[0.0, 0.1], velocity_m_s=(0.1, 0.0, 0.0), sensor=CLEAN, seed=2, exposure_s=0.05)
    # 0.1 m/s * 0.05 s * 180 px / 0.2 m is 4.5 px along x: nine instants, half a pixel apart.
    reference = [
        ndimage.shift(still.images[0].astype(float), (0.0, -way), order=5, mode="mirror")
        for way in (np.arange(9) - 4) * 0.5
    ]
    difference = (np.mean(reference, axis=0) - blurred.images[0])[:, 12:-12]
    assert np.abs(difference).max() < 0.2
    assert np.abs(still.images[0] - blurred.images[0]).mean() > 2.0


def test_exposure_drift_follows_time() -> None:
    f = flight(times_s=[0.0, 0.5], velocity_m_s=(0.0, 0.0, 0.0), sensor=CLEAN,
               exposure_drift=synthetic.auto_exposure(0.2, period_s=2.0))  # fmt: skip
    np.testing.assert_allclose(f.images[1], 1.2 * f.images[0], rtol=1e-5)


def test_mask_shows_the_object_and_the_flow_its_motion() -> None:
    thing = MovingObject(center_m=(0.02, 0.0), size_m=(0.06, 0.04), velocity_m_s=(0.0, 0.09), shape="rectangle")
    f = flight_with_object(frames=2, objects=[thing], velocity_m_s=(0.03, 0.0, 0.0), sensor=CLEAN)
    rows, columns = np.nonzero(f.masks[0])
    # 0.02 m at 180 px / 0.2 m is 18 px right of the centre; 0.06 m is 54 px wide.
    assert columns.mean() == pytest.approx(87.5 + 18, abs=0.6)
    assert columns.max() - columns.min() == pytest.approx(54, abs=1)
    assert rows.max() - rows.min() == pytest.approx(36, abs=1)
    flow = f.flow(1)
    np.testing.assert_allclose(flow[f.masks[0] == 1], [(-0.9, 2.7)] * int((f.masks[0] == 1).sum()), atol=1e-9)
    np.testing.assert_allclose(flow[f.masks[0] == 0][:, 1], 0.0, atol=1e-9)


def test_same_arguments_give_the_same_pixels() -> None:
    a, b = flight_with_object(frames=2, seed=7), flight_with_object(frames=2, seed=7)
    np.testing.assert_array_equal(a.images, b.images)
    assert not np.array_equal(a.images, flight_with_object(frames=2, seed=8).images)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: texture((4, 4), "wool"), 'kind: got "wool", expected "noise", "fine", "smooth" or "ground"'),
        (lambda: texture((0, 4)), r"shape: got \(0, 4\), expected \(height, width\), integers from 1 to 20000"),
        (lambda: Sensor(noise=-1.0), "noise: got -1.0, expected a finite number from 0"),
        (lambda: Sensor(dtype="int8"), 'dtype: got "int8", expected "uint8", "uint16" or "float32"'),
        (lambda: shifted_pair(float("nan"), 0.0), "dx: got NaN, expected a finite number of pixels"),
        (lambda: flight(frames=0), "frames: got 0"),
        (lambda: flight(times_s=[0.0, 0.0]), "each later than the one before"),
        (lambda: flight(height_m=0.0), "height_m: got 0.0, expected a finite number of metres"),
        (
            lambda: flight(velocity_m_s=(1.0, 2.0)),
            r"velocity_m_s: got shape \(2,\), expected finite numbers, \(3,\)",
        ),
        (lambda: flight(velocity_m_s=(0.0, 0.0, 1.0)), "the camera reaches the ground"),
        (lambda: flight(texture_scale_m=0.0), "texture_scale_m: got 0.0, expected a finite number of metres"),
        (lambda: flight(exposure_s=-1.0), "exposure_s: got -1.0"),
        (lambda: flight(frames=1).flow(0), "index: got 0, expected an integer from 1 to 0"),
        (lambda: MovingObject((0, 0), (1, 1), (0, 0), shape="star"), 'shape: got "star"'),
        (lambda: MovingObject((0, 0), (0, 1), (0, 0)), "size_m: got"),
        (
            lambda: flight(Camera(1.0, 1.0, 0.0, 0.0, width=9, height=9, distortion=(0.1,) * 8)),
            "8 distortion terms, expected 'pinhole' with at most 5",
        ),
        (
            lambda: flight(Camera(50.0, 50.0, 80.0, 60.0, width=160, height=120, distortion=(-0.9, 0.0, 0.0, 0.0))),
            "can be inverted over the whole picture",
        ),
    ],
)
def test_misuse_says_what_where_got_and_expected(make: object, message: str) -> None:
    with pytest.raises((OptionError, ShapeError), match=message):
        make()  # type: ignore[operator]


def test_layers_have_the_motion_that_is_asked_for_and_hide_each_other() -> None:
    for seed, median in ((1, 27.0), (2, 6.5)):
        pair = synthetic.layers_pair(size=(240, 180), median_px=median, seed=seed)
        assert pair.flow.shape == (180, 240, 2)
        assert pair.flow.dtype == np.float32
        assert np.median(np.hypot(pair.flow[..., 0], pair.flow[..., 1])) == pytest.approx(median, abs=1e-3)
        assert 0.4 < pair.visible.mean() < 0.98
        assert len(np.unique(pair.layer)) > 4
        again = synthetic.layers_pair(size=(240, 180), median_px=median, seed=seed)
        np.testing.assert_array_equal(pair.prev, again.prev)
        np.testing.assert_array_equal(pair.next, again.next)
        np.testing.assert_array_equal(pair.flow, again.flow)
    assert (synthetic.layers_pair(size=(240, 180), seed=9).prev != pair.prev).any()


def test_what_is_visible_in_layers_is_where_the_flow_says() -> None:
    for seed in range(3):
        pair = synthetic.layers_pair(size=(240, 180), median_px=9.0, shutter=0.0, fog=0.5, sensor=CLEAN, seed=seed)
        y, x = np.mgrid[0:180, 0:240].astype(float)
        to = np.stack([x, y], axis=-1) + pair.flow
        moved = interpolated(pair.next)(to.reshape(-1, 2)).reshape(180, 240)
        inner = ndimage.binary_erosion(pair.visible, iterations=4)
        # Away from outlines, which are softened over a pixel.
        for index in np.unique(pair.layer):
            inside = ndimage.binary_erosion(pair.layer == index, iterations=4) & inner
            if inside.sum() > 200:
                difference = np.abs(moved - pair.prev)[inside]
                assert np.median(difference) < 0.3, (seed, index)
                assert np.percentile(difference, 95) < 1.5, (seed, index)
        hidden = ndimage.binary_erosion(~pair.visible & (to > 4).all(-1) & (to < (235, 175)).all(-1), iterations=2)
        assert np.median(np.abs(moved - pair.prev)[hidden]) > 5.0


def test_fog_takes_contrast_from_what_is_far_and_the_shutter_blurs() -> None:
    kwargs = {"size": (240, 180), "sensor": CLEAN, "seed": 4}
    clear = synthetic.layers_pair(fog=0.0, shutter=0.0, **kwargs)
    foggy = synthetic.layers_pair(fog=0.6, shutter=0.0, **kwargs)
    ground = ndimage.binary_erosion(clear.layer == 0, iterations=3)
    assert foggy.prev[ground].std() == pytest.approx(0.4 * clear.prev[ground].std(), rel=1e-4)
    blurred = synthetic.layers_pair(fog=0.0, shutter=0.5, **kwargs)
    np.testing.assert_array_equal(blurred.flow, clear.flow)
    slope = [np.abs(np.diff(pair.prev, axis=1)).mean() for pair in (clear, blurred)]
    assert slope[1] < 0.6 * slope[0]


@pytest.mark.parametrize(
    ("kwargs", "text"),
    [
        ({"median_px": 500}, "median_px: got 500"),
        ({"things": -1}, "things: got -1"),
        ({"shutter": 1.5}, "shutter: got 1.5"),
        ({"fog": float("nan")}, "fog: got NaN"),
        ({"size": (4, 4)}, "size: got"),
    ],
)
def test_layers_that_cannot_be_are_refused(kwargs: dict[str, object], text: str) -> None:
    with pytest.raises(OptionError, match=text):
        synthetic.layers_pair(**kwargs)


@pytest.mark.parametrize("size", [(8, 8), (16, 16), (64, 30)])
def test_small_layers_move_by_less(size: tuple[int, int]) -> None:
    pair = synthetic.layers_pair(size=size, seed=2)
    assert pair.prev.shape == size[::-1]
    assert np.median(np.hypot(*pair.flow.transpose(2, 0, 1))) <= 0.25 * min(size) + 0.01
