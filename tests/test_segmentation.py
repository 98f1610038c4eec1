"""Static and moving: masks against the truth, camera models, light, backgrounds."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import skimage.data

import rsflow
from rsflow.segmentation import MotionSegmenter

HEIGHT, WIDTH = 160, 208


def texture(name: str, low: float, high: float) -> np.ndarray:
    image = cv2.GaussianBlur(getattr(skimage.data, name)().astype(np.float32), (0, 0), 1.0)
    return low + (image - image.min()) * (high - low) / np.ptp(image)


GROUND = texture("gravel", 50, 200)
THING = texture("grass", 90, 250)


def scene(
    frames: int,
    *,
    camera: tuple[float, float] = (0.0, 0.0),
    zoom: float = 1.0,
    thing: tuple[float, float] | None = (3.0, 1.0),
    seed: int = 1,
    noise: float = 1.0,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Frames over photographed ground with an ellipse that moves by `thing` px a frame over it; and its masks."""
    rng = np.random.default_rng(seed)
    images, masks = [], []
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    for k in range(frames):
        scale = zoom**k
        centre = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
        at_x = 250 + (x - centre[0]) / scale + camera[0] * k
        at_y = 250 + (y - centre[1]) / scale + camera[1] * k
        image = cv2.remap(GROUND, at_x, at_y, cv2.INTER_CUBIC)
        mask = np.zeros((HEIGHT, WIDTH), bool)
        if thing is not None:
            # On the ground at (220, 235) in the first frame.
            dx, dy = at_x - 220 - thing[0] * k, at_y - 235 - thing[1] * k
            mask = (dx / 24) ** 2 + (dy / 18) ** 2 <= 1
            image[mask] = cv2.remap(THING, dx + 200, dy + 200, cv2.INTER_CUBIC)[mask]
        images.append(np.clip(image + rng.normal(0, noise, image.shape), 0, 255).round().astype(np.uint8))
        masks.append(mask)
    return images, masks


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return np.count_nonzero(a & b) / max(np.count_nonzero(a | b), 1)


CAMERAS = {
    "still": ({}, "static"),
    "pans": ({"camera": (2.3, -1.2)}, "moving"),
    "comes near": ({"zoom": 1.012, "camera": (0.5, 0.0)}, "moving"),
}


@pytest.mark.parametrize("case", CAMERAS)
def test_the_mask_is_the_thing_that_moves(case: str) -> None:
    options, mode = CAMERAS[case]
    images, masks = scene(10, **options)
    segmenter = MotionSegmenter(camera_motion=mode)
    results = [segmenter.update(image) for image in images]
    assert results[0].status == "first_frame"
    assert not results[0].valid
    assert not results[0].moving.any()
    assert np.isnan(results[0].residual).all()
    scores = [iou(result.moving, mask) for result, mask in zip(results, masks, strict=True)]
    print(case, np.round(scores, 2))
    assert np.median(scores[2:]) > 0.75
    assert min(scores[2:]) > 0.6
    for result, mask in zip(results[2:], masks[2:], strict=True):
        near = cv2.dilate(mask.astype(np.uint8), np.ones((25, 25))).astype(bool)
        assert np.count_nonzero(result.moving & ~near) < 0.002 * mask.size
        (thing,) = [thing for thing in result.objects if thing.area > 200]
        assert thing.id == results[2].objects[0].id
        assert np.hypot(thing.x - np.nonzero(mask)[1].mean(), thing.y - np.nonzero(mask)[0].mean()) < 4
    assert thing.age_frames >= 7
    assert thing.vx_px_per_frame == pytest.approx(3.0, abs=0.5)
    assert thing.vy_px_per_frame == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize(
    ("options", "model"),
    [({"camera": (2.3, -1.2)}, {"translation"}), ({"zoom": 1.015}, {"similarity", "affine", "homography"})],
)
def test_the_camera_s_motion_is_found_beside_the_thing_s(options: dict, model: set) -> None:
    images, _ = scene(3, **options)
    segmenter = MotionSegmenter(camera_motion="moving")
    result = [segmenter.update(image) for image in images][-1]
    assert result.camera_model in model
    centre = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    zoom, shift = options.get("zoom", 1.0), np.array(options.get("camera", (0, 0)))
    for point in ([20, 20], [180, 30], [30, 140]):
        mapped = result.camera_motion @ [*point, 1.0]
        expected = centre + zoom * (np.array(point) - centre) - shift
        np.testing.assert_allclose(mapped[:2] / mapped[2], expected, atol=0.15)


LIGHTS = {
    "gain": lambda k, x: 1 + 0.12 * (k % 2),
    "ramp": lambda k, x: 1 + (0.04 * k) * x / WIDTH,
    "lamp": lambda k, x: 1 + 0.3 * np.exp(-(((x - 60 - 4 * k) / 50) ** 2)),
}


def depth_scene(frames: int, nearer: float, seed: int = 4) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    """A camera that travels over ground with stones on it that are `nearer`, and a disk that moves across its way."""
    rng = np.random.default_rng(seed)
    places = [(40, 30), (110, 40), (170, 110), (60, 120), (200, 30)]
    images, masks = [], []
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    for k in range(frames):
        image = cv2.remap(GROUND, x + 250 + 2.0 * k, y + 250 + 0.4 * k, cv2.INTER_CUBIC)
        stones = np.zeros(image.shape, bool)
        for number, (cx, cy) in enumerate(places):
            at_x, at_y = x - cx + nearer * 2.0 * k, y - cy + nearer * 0.4 * k
            stone = (np.abs(at_x) < 14) & (np.abs(at_y) < 11)
            image[stone] = cv2.remap(THING, at_x + 60 + 60 * number, at_y + 200, cv2.INTER_CUBIC)[stone]
            stones |= stone
        dx, dy = x - 120 + 2.0 * k, y - 105 + 3.0 * k
        mask = (dx / 15) ** 2 + (dy / 15) ** 2 <= 1
        image[mask] = cv2.remap(THING, dx + 300, dy + 300, cv2.INTER_CUBIC)[mask]
        images.append(np.clip(image + rng.normal(0, 1, image.shape), 0, 255).round().astype(np.uint8))
        masks.append(mask)
    return images, masks, stones


def test_what_stands_nearer_than_the_ground_does_not_move() -> None:
    images, masks, stones = depth_scene(8, nearer=2.0)
    assert 0.08 < stones.mean() < 0.1
    segmenter = MotionSegmenter(camera_motion="moving")
    results = [segmenter.update(image) for image in images]
    wrong = []
    for result, mask in zip(results[2:], masks[2:], strict=True):
        assert result.parallax
        near = cv2.dilate(mask.astype(np.uint8), np.ones((15, 15))).astype(bool)
        assert np.count_nonzero(result.moving & mask) > 0.8 * np.count_nonzero(mask)
        wrong.append((result.moving & ~near).mean())
    print(np.round(wrong, 3))
    # Without a look at parallax all stones move; with it, some of their edges, where flow is of neither side.
    assert np.mean(wrong) < 0.03


def test_one_thing_that_moves_is_not_parallax() -> None:
    images, _ = scene(5, camera=(2.3, -1.2))
    segmenter = MotionSegmenter(camera_motion="moving")
    assert not any(segmenter.update(image).parallax for image in images)


@pytest.mark.parametrize("mode", ["static", "moving"])
@pytest.mark.parametrize("light", LIGHTS)
def test_changing_light_alone_moves_nothing(light: str, mode: str) -> None:
    camera = (0.0, 0.0) if mode == "static" else (1.5, 0.7)
    images, _ = scene(8, thing=None, camera=camera)
    x = np.arange(WIDTH)
    segmenter = MotionSegmenter(camera_motion=mode)
    for k, image in enumerate(images):
        lit = np.clip(image * 0.75 * LIGHTS[light](k, x), 0, 255).astype(np.uint8)
        result = segmenter.update(lit)
        assert np.mean(result.moving) < 0.005, (light, mode, k)


@pytest.mark.parametrize("mode", ["static", "moving"])
def test_a_still_scene_has_nothing_that_moves(mode: str) -> None:
    images, _ = scene(6, thing=None, noise=3.0)
    segmenter = MotionSegmenter(camera_motion=mode)
    for image in images:
        assert not segmenter.update(image).moving.any()


@pytest.mark.parametrize("mode", ["static", "moving"])
def test_the_background_is_what_stands_still(mode: str) -> None:
    camera = (0.0, 0.0) if mode == "static" else (1.0, 0.5)
    images, masks = scene(22, camera=camera, thing=(5.0, 0.0))
    bare, _ = scene(22, camera=camera, thing=None, noise=0.0)
    segmenter = MotionSegmenter(camera_motion=mode)
    results = [segmenter.update(image) for image in images]
    result = results[-1]
    # Where the thing is now and was not at first, the background is the ground behind it.
    behind = masks[-1] & np.isfinite(result.background)
    assert np.count_nonzero(behind) > 0.5 * np.count_nonzero(masks[-1])
    error = np.abs(result.background[behind] - bare[-1][behind])
    assert np.median(error) < 4
    view = result.static_view()
    assert np.median(np.abs(view[..., 0][behind].astype(float) - bare[-1][behind])) < 6


def test_the_views() -> None:
    images, masks = scene(6)
    segmenter = MotionSegmenter(camera_motion="static")
    result = [segmenter.update(image) for image in images][-1]
    view = result.moving_view(boxes=False)
    inside = cv2.erode(result.moving.view(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    np.testing.assert_array_equal(view[inside][:, 0], images[-1][inside])
    assert view[~result.moving].mean() < 0.5 * images[-1][~result.moving].mean()
    color = np.dstack([images[-1], images[-1] // 2, images[-1]])
    assert result.moving_view(color).shape == color.shape
    assert not np.array_equal(result.moving_view(), view), "boxes"
    np.testing.assert_array_equal(result.static_view(color)[~masks[-1] & (result.residual < 0)], color[:0, 0])
    with pytest.raises(rsflow.ShapeError, match="picture: got shape"):
        result.moving_view(color[1:])
    sixteen = MotionSegmenter(camera_motion="static")
    for image in images:
        result16 = sixteen.update(image.astype(np.uint16) * 256)
    assert iou(result16.moving, result.moving) > 0.9
    assert result16.static_view().dtype == np.uint8


def test_a_camera_that_sees_nothing_says_so() -> None:
    segmenter = MotionSegmenter(camera_motion="moving")
    for _ in range(3):
        result = segmenter.update(np.full((60, 80), 100, np.uint8))
    assert result.status == "no_camera_motion"
    assert result.camera_model == "none"
    assert not result.moving.any()
    assert np.isnan(result.residual).all()


def test_tiny_frames_and_nan_do_no_harm() -> None:
    for shape in ((1, 1), (1, 40), (7, 5), (40, 3)):
        for mode in ("static", "moving"):
            segmenter = MotionSegmenter(camera_motion=mode)
            for k in range(3):
                result = segmenter.update(np.full(shape, 10 * k, np.uint8))
                assert result.moving.shape == shape
    segmenter = MotionSegmenter(camera_motion="static")
    rng = np.random.default_rng(1)
    for _ in range(4):
        image = rng.normal(100, 1, (50, 60)).astype(np.float32)
        image[10:20, 10:20] = np.nan
        assert not segmenter.update(image).moving.any()


def test_misuse_says_what_is_wrong() -> None:
    with pytest.raises(rsflow.OptionError, match='camera_motion: got "still", expected "moving" or "static"'):
        MotionSegmenter(camera_motion="still")
    with pytest.raises(rsflow.OptionError, match="min_area: got 0, expected an integer of pixels of at least 1"):
        MotionSegmenter(min_area=0)
    segmenter = MotionSegmenter()
    with pytest.raises(rsflow.ShapeError, match="image: got colour"):
        segmenter.update(np.zeros((5, 5, 3), np.uint8))
    with pytest.raises(rsflow.ShapeError, match="image: got shape"):
        segmenter.update(np.zeros((0, 5), np.uint8))
    with pytest.raises(rsflow.DTypeError, match="got dtype float64"):
        segmenter.update(np.zeros((5, 5)))
    frame = np.zeros((20, 20), np.uint8)
    flow = SimpleNamespace(uv=np.zeros((20, 20, 2), np.float32), valid=np.ones((20, 20), bool))
    with pytest.raises(rsflow.OptionError, match="flow: got one for the first frame"):
        segmenter.update(frame, flow=flow)
    segmenter.update(frame)
    with pytest.raises(rsflow.ShapeError, match="expected the shape of the frames before"):
        segmenter.update(frame[1:])
    segmenter.update(frame, flow=flow)
    with pytest.raises(rsflow.OptionError, match="flow: got None, expected that of every frame after the first"):
        segmenter.update(frame)
    with pytest.raises(rsflow.ShapeError, match=r"flow\.uv: got shape"):
        segmenter.update(frame, flow=SimpleNamespace(uv=flow.uv[1:], valid=flow.valid[1:]))
    segmenter.reset()
    assert segmenter.update(frame).status == "first_frame"
