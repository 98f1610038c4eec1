"""Pictures of motion: exact colours, scales that hold, arrows only where there is motion."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import plotting
from rsflow.plotting import QuiverStyle, color_wheel, fitted_max_flow, flow_over_picture

SVG = "{http://www.w3.org/2000/svg}"


def middlebury_reference(u: float, v: float) -> list[int]:
    """Colour of one vector of length at most 1, by the published code, one pixel at a time: red, green, blue."""
    colors = [(255, 255 * i // 15, 0) for i in range(15)]
    colors += [(255 - 255 * i // 6, 255, 0) for i in range(6)]
    colors += [(0, 255, 255 * i // 4) for i in range(4)]
    colors += [(0, 255 - 255 * i // 11, 255) for i in range(11)]
    colors += [(255 * i // 13, 0, 255) for i in range(13)]
    colors += [(255, 0, 255 - 255 * i // 6) for i in range(6)]
    radius = np.hypot(u, v)
    place = (np.arctan2(-v, -u) / np.pi + 1) / 2 * (55 - 1)
    k = int(place)
    out = []
    for channel in range(3):
        color = ((1 - place + k) * colors[k][channel] + (place - k) * colors[(k + 1) % 55][channel]) / 255
        color = 1 - radius * (1 - color) if radius <= 1 else color * 0.75
        out.append(int(255 * color))
    return out


def test_colours_are_middlebury_s() -> None:
    rng = np.random.default_rng(5)
    uv = rng.uniform(-1.2, 1.2, (40, 50, 2)).astype(np.float32)
    expected = np.array([[middlebury_reference(u, v) for u, v in row] for row in uv])
    got = rsflow.flow_to_color(uv * 7, max_flow=7, order="rgb").astype(int)
    assert np.abs(got - expected).max() <= 1
    assert np.array_equal(
        rsflow.flow_to_color(uv, max_flow=1)[..., ::-1], rsflow.flow_to_color(uv, max_flow=1, order="rgb")
    )


def test_unknown_is_black_and_still_is_white() -> None:
    uv = np.zeros((3, 4, 2), np.float32)
    uv[0, 0] = np.nan
    valid = np.ones((3, 4), bool)
    valid[1, 1] = False
    for picture in (rsflow.flow_to_color(uv, valid=valid), rsflow.flow_to_color(SimpleNamespace(uv=uv, valid=valid))):
        assert {tuple(map(int, at)) for at in np.argwhere(~picture.any(axis=2))} == {(0, 0), (1, 1)}
        assert np.all(picture[2] == 255)
    assert not rsflow.flow_to_color(np.full((2, 2, 2), np.nan)).any()


def test_the_scale_is_the_largest_or_the_one_given() -> None:
    uv = np.zeros((2, 2, 2), np.float32)
    uv[0, 0] = 3, 4
    uv[1, 1] = 1.5, 2
    by_largest = rsflow.flow_to_color(uv)
    np.testing.assert_array_equal(by_largest, rsflow.flow_to_color(uv, max_flow=5))
    np.testing.assert_array_equal(by_largest[1, 1], rsflow.flow_to_color(uv * 2, max_flow=10)[1, 1])
    assert fitted_max_flow(np.zeros((5, 5, 2))) == 0.5
    assert fitted_max_flow([np.full((5, 5, 2), (3, 4)), np.full((5, 5, 2), np.nan)]) == 5


def test_the_wheel_is_round_and_labelled() -> None:
    wheel = color_wheel(101)
    y, x = np.mgrid[:101, :101] - 50
    assert np.all(wheel[np.hypot(x, y) > 50] == 0)
    assert wheel[50, 50].tolist() == [255, 255, 255]
    assert wheel[50, 100].tolist() == [0, 0, 255], "to the right is red"
    legend = rsflow.flow_to_color(np.zeros((200, 300, 2)), max_flow=2, legend=True)
    changed = np.argwhere((legend != 255).any(axis=2))
    assert changed.min(axis=0).tolist() > [80, 200], "the legend keeps to its corner"
    tiny = rsflow.flow_to_color(np.zeros((20, 20, 2)), max_flow=2, legend=True)
    assert np.all(tiny == 255), "no room, no legend"


def test_colour_over_a_picture_keeps_what_stands_still() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (60, 80), np.uint8)
    uv = np.zeros((60, 80, 2), np.float32)
    uv[20:40, 20:40, 0] = 4
    out = flow_over_picture(uv, picture, max_flow=4, legend=False)
    still = ~uv.any(axis=2)
    assert np.all(out[still] == picture[still][:, None])
    red = out[30, 30].astype(int)
    assert red[2] > red[0] + 100


def arrow_rows(picture: np.ndarray, style: QuiverStyle) -> np.ndarray:
    """Where pixels are close to the colour of the arrows."""
    return np.abs(picture.astype(int) - style.color).max(axis=2) < 60


def test_an_arrow_starts_at_its_pixel_and_has_its_length() -> None:
    uv = np.zeros((81, 81, 2), np.float32)
    uv[...] = np.nan
    uv[40, 40] = 6, 0
    style = QuiverStyle(step=81, scale=5, key=False)
    ink = np.argwhere(arrow_rows(rsflow.quiver(uv, style=style), style))
    assert abs(ink[:, 1].min() - 40) <= 1
    assert abs(ink[:, 1].max() - 70) <= 1
    assert abs(ink[:, 0].mean() - 40) < 0.5
    zoomed = np.argwhere(arrow_rows(rsflow.quiver(uv, style=style, zoom=3), style))
    assert abs(zoomed[:, 1].min() - 121) <= 1.5
    assert abs(zoomed[:, 1].max() - 211) <= 1.5


def test_arrows_only_where_motion_is_known() -> None:
    uv = np.full((160, 200, 2), 3, np.float32)
    valid = np.zeros((160, 200), bool)
    valid[:, :100] = True
    style = QuiverStyle(step=20, scale=4, key=False)
    for picture in (
        rsflow.quiver(uv, valid=valid, style=style),
        rsflow.quiver(SimpleNamespace(uv=uv, valid=valid), style=style),
        rsflow.quiver(np.where(valid[..., None], uv, np.nan), style=style),
    ):
        ink = arrow_rows(picture, style)
        assert ink[:, :100].sum() > 500
        assert ink[:, 120:].sum() == 0
    empty = rsflow.quiver(uv, valid=np.zeros_like(valid), style=style)
    assert np.all(empty == 48)


def test_what_stands_still_is_a_dot_and_a_long_arrow_is_cut() -> None:
    uv = np.zeros((100, 100, 2), np.float32)
    style = QuiverStyle(step=10, key=False)
    assert arrow_rows(rsflow.quiver(uv, style=style), style).sum() == 100
    uv[...] = np.nan
    uv[49, 49] = 500, 0
    cut = QuiverStyle(step=100, scale=1, max_length=20, key=False)
    ink = np.argwhere(arrow_rows(rsflow.quiver(uv, style=cut), cut))
    assert abs(ink[:, 1].max() - 69) <= 1
    assert np.ptp(ink[:, 0]) <= 1, "no head"


def test_one_style_keeps_the_scale_over_a_clip() -> None:
    fields = [np.full((480, 640, 2), speed, np.float32) for speed in (1, 3)]
    style = QuiverStyle.fitted(fields)
    assert (style.step, style.zoom) == (16, 1)
    assert style.scale == 5
    assert QuiverStyle.fitted(np.zeros((144, 176, 2))).scale == 20
    assert QuiverStyle.fitted(np.zeros((144, 176, 2))).zoom == 3
    keys = [rsflow.quiver(field, style=style)[420:, :100] for field in np.zeros((2, 480, 640, 2))]
    np.testing.assert_array_equal(*keys)


@pytest.mark.parametrize(
    ("scale", "unit", "per_px", "label"), [(5, "px/frame", 1, "5 px/frame"), (5, "m/s", 0.031, "0.1 m/s")]
)
def test_the_key_has_a_round_length_in_its_unit(
    tmp_path: Path, scale: float, unit: str, per_px: float, label: str
) -> None:
    path = tmp_path / "a.svg"
    rsflow.quiver(
        np.full((60, 90, 2), 2), style=QuiverStyle(scale=scale, unit=unit, unit_per_px=per_px, zoom=2), path=path
    )
    tree = ElementTree.parse(path)
    assert tree.find(f".//{SVG}text").text == label
    key = next(p for p in tree.iter(f"{SVG}path") if p.get("class") == "key").get("d")
    x = [float(n) for n in re.findall(r"[ML]([\d.]+)", key)]
    expected = float(label.split()[0]) / per_px * scale * 2
    assert x[1] - x[0] == pytest.approx(expected, abs=0.02)


def test_an_svg_has_vectors_over_the_picture(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    frame = np.random.default_rng(2).integers(0, 256, (60, 80), np.uint8)
    uv = np.full((60, 80, 2), (3, -1), np.float32)
    uv[:, 40:] = np.nan
    rsflow.quiver(uv, picture=frame, step=20, scale=4, zoom=1, path=path)
    tree = ElementTree.parse(path)
    arrows = tree.findall(f".//{SVG}g[@id='arrows']/{SVG}path")
    assert len(arrows) == 6
    numbers = [float(n) for n in re.findall(r"-?[\d.]+", arrows[0].get("d"))]
    assert numbers[2] - numbers[0] == pytest.approx(12, abs=0.02)
    assert numbers[3] - numbers[1] == pytest.approx(-4, abs=0.02)
    data = tree.find(f".//{SVG}image").get("href")
    import base64

    png = cv2.imdecode(np.frombuffer(base64.b64decode(data.split(",")[1]), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(png[..., 0], frame)


def test_points_and_pictures_of_every_type(tmp_path: Path) -> None:
    frame = np.random.default_rng(2).integers(0, 65536, (120, 160), np.uint16)
    points = np.array([[20, 20], [100, 60], [5, 5]], np.float32)
    moved = np.array([[4, 0], [0, 4], [np.nan, 0]], np.float32)
    style = QuiverStyle(scale=5, key=False)
    for picture in (
        frame,
        frame.astype(np.float32),
        (frame >> 8).astype(np.uint8),
        np.dstack([frame >> 8] * 3).astype(np.uint8),
    ):
        out = rsflow.quiver(moved, points=points, picture=picture, style=style, path=tmp_path / "a.png")
        np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a.png")), out)
        assert not np.array_equal(
            out[20, 20:40], rsflow.quiver(moved[2:], points=points[2:], picture=picture, style=style)[20, 20:40]
        )
    nothing = rsflow.quiver(np.zeros((0, 2)), points=np.zeros((0, 2)), picture=frame)
    assert nothing.shape == (360, 480, 3)


def test_the_caller_s_arrays_stay_as_they_are() -> None:
    frame = np.zeros((50, 50, 3), np.uint8)
    uv = np.full((50, 50, 2), 3, np.float32)
    uv[0, 0] = np.nan
    before = uv.copy()
    rsflow.quiver(uv, picture=frame, step=10)
    rsflow.flow_to_color(uv, legend=True)
    flow_over_picture(uv, frame)
    assert not frame.any()
    np.testing.assert_array_equal(uv, before)


def test_misuse_says_what_is_wrong(tmp_path: Path) -> None:
    uv = np.ones((10, 12, 2), np.float32)
    with pytest.raises(rsflow.OptionError, match="quiver: got the knob 'colour', expected one of step"):
        rsflow.quiver(uv, colour=(1, 2, 3))
    with pytest.raises(rsflow.OptionError, match="step: got 0, expected an integer from 1"):
        rsflow.quiver(uv, step=0)
    with pytest.raises(rsflow.OptionError, match="scale: got -1, expected a finite number"):
        rsflow.quiver(uv, scale=-1)
    with pytest.raises(rsflow.ShapeError, match=r"picture: got shape \(5, 5\), expected that of the flow, \(10, 12\)"):
        rsflow.quiver(uv, picture=np.zeros((5, 5), np.uint8))
    with pytest.raises(rsflow.ShapeError, match=r"valid: got shape \(3,\), expected that of the motion, \(10, 12\)"):
        rsflow.quiver(uv, valid=np.ones(3, bool))
    with pytest.raises(rsflow.ShapeError, match=r"field: got the motion of points, .*expected points="):
        rsflow.quiver(np.ones((4, 2)))
    with pytest.raises(rsflow.ShapeError, match=r"points: got shape \(3, 2\), expected that of their motion"):
        rsflow.quiver(np.ones((4, 2)), points=np.ones((3, 2)), picture=np.zeros((5, 5), np.uint8))
    with pytest.raises(rsflow.DTypeError, match='style: got "color", expected a QuiverStyle'):
        rsflow.quiver(uv, style="color")
    with pytest.raises(rsflow.OptionError, match="picture: got None, expected the picture"):
        rsflow.quiver(np.ones((4, 2)), points=np.ones((4, 2)))
    with pytest.raises(rsflow.DTypeError, match="picture: got dtype int64, expected uint8, uint16 or floating point"):
        rsflow.quiver(uv, picture=np.zeros((10, 12), np.int64))
    with pytest.raises(
        rsflow.OptionError, match=r'path: got ".*a\.gif", expected a name that ends in \.png, \.jpg, \.jpeg or \.svg'
    ):
        rsflow.quiver(uv, path=tmp_path / "a.gif")
    with pytest.raises(rsflow.OptionError, match="max_flow: got 0, expected a finite number of pixels"):
        rsflow.flow_to_color(uv, max_flow=0)
    with pytest.raises(rsflow.OptionError, match='order: got "bgra", expected "bgr" or "rgb"'):
        rsflow.flow_to_color(uv, order="bgra")
    with pytest.raises(rsflow.ShapeError, match="valid: got shape"):
        rsflow.flow_to_color(uv, valid=np.ones(3, bool))
    with pytest.raises(rsflow.ShapeError, match="picture: got shape"):
        flow_over_picture(uv, np.zeros((5, 5), np.uint8))
    with pytest.raises(rsflow.OptionError, match="opacity: got 2, expected a finite number from 0 to 1"):
        flow_over_picture(uv, np.zeros((10, 12), np.uint8), opacity=2)
    with pytest.raises(rsflow.OptionError, match="size: got 1, expected an integer of pixels from 3"):
        plotting.color_wheel(1)
    assert list(tmp_path.iterdir()) == []
