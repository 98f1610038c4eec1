"""What results print: three lines at most, with what matters; and what a notebook shows of them."""

from __future__ import annotations

import base64
import enum
import inspect
import re

import cv2
import numpy as np
import pytest

import public_calls
import rsflow
from rsflow._display import html, measured

CLASSES = [
    name
    for name, value in public_calls.public().items()
    if inspect.isclass(value) and not issubclass(value, (BaseException, enum.Enum))
]
PAGES = ("rsflow.Calibration", "rsflow.FlowField", "rsflow.Frame", "rsflow.MotionSegmentation", "rsflow.Tracks")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    public_calls.make_files(folder)
    return folder


def made(name, folder):
    kind, arguments = public_calls.CALLS[name](folder)
    return kind(**arguments)


@pytest.mark.parametrize("name", CLASSES)
def test_every_result_prints_itself_in_three_lines(name, files):
    result = made(name, files)
    lines = repr(result).splitlines()
    assert 1 <= len(lines) <= 3
    assert max(map(len, lines)) <= 240
    assert type(result).__name__ in lines[0]
    assert not re.search(r"object at 0x|array\(", repr(result))


@pytest.mark.parametrize("name", CLASSES)
def test_every_result_can_be_compared_and_be_a_key(name, files):
    result, other = made(name, files), made(name, files)
    assert isinstance(result == other, bool)
    assert len({result, other}) == (1 if result == other else 2)


@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_shows_a_small_picture(name, files):
    result = made(name, files)
    page = result._repr_html_()
    code = re.search(r'src="data:image/png;base64,([^"]+)"', page)
    assert code is not None
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(code[1]), np.uint8), cv2.IMREAD_COLOR)
    assert 1 < picture.shape[0] <= 360
    assert 1 < picture.shape[1] <= 480
    assert np.ptp(picture) > 0
    assert page.startswith(f"<pre>{type(result).__name__}")


def test_a_large_picture_is_made_to_fit_and_text_is_escaped():
    page = html('Frame(name="<b>&")', np.zeros((1080, 1920, 3), np.uint8))
    data = base64.b64decode(page.split("base64,")[1].rstrip('">'))
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape == (270, 480, 3)
    assert "<b>" not in page
    assert html("a", np.zeros((0, 5, 3), np.uint8)) == "<pre>a</pre>"


def test_numbers_are_rounded_by_their_deviation():
    assert measured(2.25031, 0.00412) == "2.2503 +- 0.0041"
    assert measured(-1234.5, 67.0) == "-1234 +- 67"
    assert measured(float("nan"), float("inf")) == "nan"


def test_what_a_shift_prints_is_what_it_measured():
    pair = rsflow.synthetic.shifted_pair(2.25, -1.5, seed=1)
    shift = rsflow.estimate_shift(pair.prev, pair.next)
    told = re.match(r"Shift\(dx=(\S+) \+- (\S+), dy=(\S+) \+- (\S+) px, .*, VALID\)$", repr(shift))
    assert told is not None
    dx, std_x, dy, std_y = map(float, told.groups())
    np.testing.assert_allclose((dx, dy), (shift.dx, shift.dy), atol=1e-3)
    np.testing.assert_allclose((std_x, std_y), np.sqrt(np.diag(shift.covariance)), rtol=0.05)
    blank = np.full((60, 60), 90, np.uint8)
    assert repr(rsflow.estimate_shift(blank, blank)).startswith("Shift(NO_TEXTURE: the window shows no structure")


def test_a_shift_of_an_edge_prints_the_displacement_across_it():
    x = np.arange(80, dtype=np.float32)[None, :].repeat(80, axis=0)
    before, after = ((128 + 100 * np.tanh((x - 40 - by) / 3)).astype(np.float32) for by in (0.0, 1.5))
    shift = rsflow.estimate_shift(before, after)
    assert shift.status is rsflow.ShiftStatus.APERTURE
    assert re.match(r"Shift\(-?1\.500\d+ \+- 0\.\d+ px along \(-?1\.000, -?0\.000\) alone, APERTURE: ", repr(shift))


def test_what_a_flow_prints():
    pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
    field = rsflow.dense_flow(pair.prev, pair.next)
    assert re.match(r"FlowField\(96 x 64, \d+% valid: mean \(\+2\.0\d, -1\.0\d\) px, median 2\.2\d px\)$", repr(field))
    blank = np.full((40, 50), 9, np.uint8)
    assert repr(rsflow.dense_flow(blank, blank)) == "FlowField(50 x 40, none valid)"
    empty = rsflow.dense_flow(blank[:0], blank[:0])
    assert repr(empty) == "FlowField(50 x 0, none valid)"
    assert "<img" not in empty._repr_html_()


def test_a_calibration_of_many_views_stays_short():
    found = public_calls.a_calibration()
    many = type(found)(**{**public_calls._fields(found), "views": found.views * 40, "doubts": ("a rolling\nshutter",)})
    assert len(repr(many).splitlines()) == 3
    assert "40 of 40 views" in repr(many)
    assert "in doubt: a rolling shutter" in repr(many)


def test_a_velocity_names_what_its_deviation_leaves_out():
    velocity = public_calls.a_velocity()
    assert velocity.unstated
    assert repr(velocity).splitlines()[1].strip() == f"without the deviation of: {', '.join(velocity.unstated)})"
    nothing = rsflow.VelocityEstimator(public_calls.CAMERA, height_m=0.2).update(public_calls.flight().images[0], 0.0)
    assert repr(nothing) == "Velocity(t=0 s, FIRST_FRAME: there is no frame before this one)"


def test_streaming_objects_say_how_far_they_are():
    frame = public_calls.frame()
    flow, tracker = rsflow.DenseFlow(preset="fast"), rsflow.PointTracker(max_corners=9)
    segmenter, estimator = rsflow.MotionSegmenter(), rsflow.VelocityEstimator(public_calls.CAMERA, height_m=0.2)
    assert "no frame yet" in repr(flow)
    for streaming in (flow, tracker, segmenter):
        streaming.update(frame)
    estimator.update(frame, 0.5)
    assert repr(flow) == 'DenseFlow(preset="fast", illumination="gain_offset"): frames of 32 x 24'
    assert repr(tracker).endswith("): 1 frame")
    assert repr(segmenter).endswith("): frames of 32 x 24")
    assert repr(estimator) == "VelocityEstimator(32 x 24 camera, height_m=0.2): last frame at 0.5 s"
