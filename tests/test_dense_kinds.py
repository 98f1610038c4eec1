"""Dense flow by kind of motion, light and content, on photographs: each kind has its limit beside OpenCV's DIS."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
import skimage.data
from numpy.typing import NDArray

import rsflow

SIZE = (384, 480)
BORDER = 16

Light = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def photograph(name: str) -> NDArray[np.float64]:
    picture = getattr(skimage.data, name)()
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) if picture.ndim == 3 else picture
    top, left = ((grey.shape[axis] - SIZE[axis]) // 2 for axis in (0, 1))
    return grey[top : top + SIZE[0], left : left + SIZE[1]].astype(np.float64)


def turned(degrees: float, zoom: float = 1.0, dx: float = 0.0, dy: float = 0.0) -> NDArray[np.float64]:
    height, width = SIZE
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, zoom)
    matrix[:, 2] += dx, dy
    return matrix


def shaded(share: float) -> Light:
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    darker = 2 * share * ((x / SIZE[1] - 0.5) ** 2 + (y / SIZE[0] - 0.5) ** 2)
    return lambda picture: picture * (1 - darker)


def shadowed(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    return np.where(x + 0.5 * y > 0.7 * SIZE[1], 0.5 * picture, picture)


def steady(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    return picture


GENTLE = turned(-1.0, 1.0, 2.3, 1.2)
# Motion, light of the second frame, noise in grey levels, and the largest share of the error of DIS medium.
KINDS: dict[str, tuple[NDArray[np.float64], Light, float, float]] = {
    "shift of half a pixel": (turned(0, 1, 0.5, -0.3), steady, 1, 0.7),
    "shift of 4 pixels": (turned(0, 1, 4.3, -2.2), steady, 1, 0.8),
    "shift of 12 pixels": (turned(0, 1, 9.6, 6.4), steady, 1, 0.8),
    "turn": (turned(-8), steady, 1, 0.5),
    "zoom": (turned(0, 1.1), steady, 1, 0.5),
    "noise": (GENTLE, steady, 6, 0.6),
    "blur": (GENTLE, lambda picture: cv2.GaussianBlur(picture, (0, 0), 1.5), 1, 0.8),
    "gain": (GENTLE, lambda picture: 0.7 * picture + 10, 1, 0.5),
    "lens shading": (GENTLE, shaded(0.3), 1, 0.6),
    "hard shadow": (GENTLE, shadowed, 1, 0.6),
}


def pair(
    prev: NDArray[np.float64], matrix: NDArray[np.float64], light: Light, noise: float
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_]]:
    """Give both frames, the true flow, and where both frames show the same."""
    height, width = SIZE
    moved = cv2.warpAffine(prev, matrix, (width, height), flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)
    generator = np.random.default_rng(7)
    frames = [
        np.clip(np.rint(frame + noise * generator.standard_normal(SIZE)), 0, 255).astype(np.uint8)
        for frame in (prev, light(moved))
    ]
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    to = np.stack([row[0] * x + row[1] * y + row[2] for row in matrix], -1)
    inside = (to >= BORDER).all(-1) & (to[..., 0] < width - BORDER) & (to[..., 1] < height - BORDER)
    inside[:BORDER], inside[-BORDER:], inside[:, :BORDER], inside[:, -BORDER:] = False, False, False, False
    return frames[0], frames[1], to - np.stack([x, y], -1), inside


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_measured_better_than_by_dis_and_rightly_called_valid(kind: str) -> None:
    matrix, light, noise, most = KINDS[kind]
    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    ours, theirs, wrong = [], [], []
    for name in ("camera", "coffee"):
        prev, after, truth, inside = pair(photograph(name), matrix, light, noise)
        field = rsflow.dense_flow(prev, after)
        error = np.hypot(*(field.uv - truth).transpose(2, 0, 1))
        ours.append(error[inside].mean())
        theirs.append(np.hypot(*(dis.calc(prev, after, None) - truth).transpose(2, 0, 1))[inside].mean())
        valid = field.valid & inside
        assert valid.sum() > 0.5 * inside.sum(), (name, valid.sum() / inside.sum())
        wrong.append((error[valid] > 1).mean())
    assert np.mean(ours) < most * np.mean(theirs), (np.mean(ours), np.mean(theirs))
    assert np.mean(wrong) < 0.01, wrong


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "balanced", "accurate"])
@pytest.mark.parametrize(
    "matrix", [turned(-10.5), turned(0, 1.13), turned(12, 1.05, 2, -1)], ids=["turn", "zoom", "both"]
)
def test_strong_turns_and_zooms_are_measured_and_valid(preset: rsflow.Preset, matrix: NDArray[np.float64]) -> None:
    wrong = []
    for name in ("astronaut", "gravel", "grass"):
        prev, after, truth, inside = pair(photograph(name), matrix, steady, 1)
        field = rsflow.dense_flow(prev, after, preset=preset)
        error = np.hypot(*(field.uv - truth).transpose(2, 0, 1))
        right = (error[inside] < 0.5).mean()
        valid = field.valid & inside
        assert right > 0.9, (name, right)
        assert valid.sum() > (right - 0.15) * inside.sum(), (name, right, valid.sum() / inside.sum())
        wrong.append((error[valid] > 1).mean())
    assert np.mean(wrong) < 0.01, wrong


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "balanced", "accurate"])
def test_nothing_is_valid_where_the_motion_was_lost(preset: rsflow.Preset) -> None:
    # A few windows in a hundred of a wrong flow fit by chance.
    for name in ("brick", "gravel"):
        prev, after, truth, inside = pair(photograph(name), turned(-28), steady, 1)
        field = rsflow.dense_flow(prev, after, preset=preset)
        error = np.hypot(*(field.uv - truth).transpose(2, 0, 1))
        assert (error[field.valid & inside] > 1).sum() < 0.002 * inside.sum(), name


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "balanced", "accurate"])
def test_unrelated_pictures_and_flat_ground_are_not_valid(preset: rsflow.Preset) -> None:
    generator = np.random.default_rng(3)
    pictures = [photograph(name).astype(np.uint8) for name in ("gravel", "brick")]
    assert rsflow.dense_flow(*pictures, preset=preset).valid.mean() < 0.002
    flat = [np.rint(120 + 2 * generator.standard_normal(SIZE)).astype(np.uint8) for _ in range(2)]
    assert rsflow.dense_flow(*flat, preset=preset).valid.mean() < 0.002


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "balanced", "accurate"])
def test_what_stays_with_the_sensor_is_kept_out_by_both_masks(preset: rsflow.Preset) -> None:
    prev, after, truth, _ = pair(photograph("gravel"), turned(0, 1, 6.5, 2), steady, 1)
    clean = rsflow.dense_flow(prev, after, preset=preset)
    counts = np.ones(SIZE, np.bool_)
    counts[120:220, 140:280] = False
    for frame in (prev, after):
        frame[~counts] = 30
        cv2.putText(frame, "SPEED", (150, 190), cv2.FONT_HERSHEY_SIMPLEX, 1, 255, 3)
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    to = counts[np.minimum(y + 2, SIZE[0] - 1), np.minimum(np.rint(x + 6.5).astype(int), SIZE[1] - 1)]
    beside = cv2.dilate((~(counts & to)).astype(np.uint8), np.ones((25, 25), np.uint8)) == 1
    beside &= counts & to
    one, field = (rsflow.dense_flow(prev, after, preset=preset, mask=counts, next_mask=m) for m in (None, counts))
    errors = [np.hypot(*(f.uv - truth).transpose(2, 0, 1)) for f in (one, field, clean)]
    of_one, of_both, of_clean = (error[beside].mean() for error in errors)
    assert of_both < min(of_one, 2 * of_clean), (of_one, of_both, of_clean)
    error = errors[1]
    assert not field.valid[counts & ~to].any()
    assert (error[beside & field.valid] > 1).mean() < 0.01


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "balanced", "accurate"])
@pytest.mark.parametrize("name", ["astronaut", "gravel"])
def test_flat_ground_moves_with_what_is_around_it(preset: rsflow.Preset, name: str) -> None:
    picture = photograph(name)
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    picture = np.where(x + 0.4 * y < 0.45 * SIZE[1], 30.0, picture)
    prev, following, truth, inside = pair(picture, turned(0, 1, 4.3, -2.2), steady, 1)
    field = rsflow.dense_flow(prev, following, preset=preset)
    error = np.hypot(*np.moveaxis(field.uv - truth, 2, 0))
    flat = inside & (x + 0.4 * y < 0.45 * SIZE[1] - 24)
    # Nothing can be measured there, and nothing is valid: what is around is the best guess, of 4.8 pixels.
    assert np.median(error[flat]) < 1.2
    assert field.valid[flat].mean() < 0.01


def drawn(kind: str, shift: float) -> NDArray[np.uint8]:
    sides = 8
    big = np.full((256 * sides, 256 * sides), 20, np.uint8)
    moved = round(shift * sides)
    if kind == "disc":
        cv2.circle(big, (115 * sides + moved, 128 * sides + moved), 20 * sides, 255, -1)
    elif kind == "lines":
        for k in range(6):
            start = ((30 + 30 * k) * sides + moved, 40 * sides + moved)
            cv2.line(big, start, ((60 + 25 * k) * sides + moved, 210 * sides + moved), 180, 2 * sides)
    else:
        cv2.putText(big, "rsflow", (20 * sides + moved, 140 * sides + moved), 0, 2 * sides, 255, 5 * sides)
    return cv2.resize(big, (256, 256), interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize(
    ("preset", "kind", "shift"),
    [
        ("fast", "disc", 2.0),
        ("fast", "lines", 2.0),
        ("fast", "text", 2.0),
        ("fast", "lines", 6.0),
        ("fast", "text", 6.0),
        ("balanced", "lines", 2.0),
        ("balanced", "lines", 6.0),
        ("balanced", "text", 6.0),
    ],
)
def test_the_motion_of_a_shape_is_not_taken_for_light(preset: rsflow.Preset, kind: str, shift: float) -> None:
    prev, following = drawn(kind, 0.0), drawn(kind, shift)
    field = rsflow.dense_flow(prev, following, preset=preset)
    down, along = np.gradient(prev.astype(float))
    steep = np.hypot(along, down)
    edge = steep > 10
    off = field.uv - shift
    across = np.abs(off[..., 0] * along + off[..., 1] * down)[edge] / steep[edge]
    assert np.median(across) < 0.3
