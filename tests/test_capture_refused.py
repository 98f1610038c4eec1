"""Sources that are none: each is refused with what it is and what is expected."""

from __future__ import annotations

import numpy as np
import pytest

import rsflow

PICTURE = np.zeros((48, 64), np.uint8)


def test_sources_that_hold_nothing_are_refused(tmp_path):
    with pytest.raises(rsflow.CaptureError, match="the folder holds no picture"):
        rsflow.frames(tmp_path)
    with pytest.raises(rsflow.CaptureError, match=r"x\*\.png: no file matches"):
        rsflow.frames(tmp_path / "x*.png")
    with pytest.raises(rsflow.CaptureError, match="got an empty list"):
        rsflow.frames([])
    with pytest.raises(rsflow.CaptureError, match="got no frame"):
        rsflow.frames(iter([]))
    with pytest.raises(rsflow.CaptureError, match="got an empty path"):
        rsflow.frames("")


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.zeros((4, 5)), rsflow.DTypeError, "of float64, expected uint8, uint16 or float32"),
        (np.zeros((4, 5, 7), np.uint8), rsflow.ShapeError, r"got shape \(4, 5, 7\), expected \(H, W\)"),
        (np.zeros((0, 5), np.uint8), rsflow.ShapeError, r"empty picture of shape \(0, 5\)"),
        ("soon", rsflow.CaptureError, "soon: cannot be read"),
        (3, rsflow.DTypeError, "item 0: got int, expected an array"),
        (None, rsflow.DTypeError, "item 0: got NoneType, expected an array"),
    ],
)
def test_things_that_are_no_pictures_are_refused(image, error, message):
    with pytest.raises(error, match=message):
        list(rsflow.frames([image, image] if not isinstance(image, str) else [image]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": -1}, "start: got -1, expected an integer of at least 0"),
        ({"stop": 1.5}, "stop: got 1.5"),
        ({"stride": 0}, "stride: got 0, expected an integer of at least 1"),
        ({"frame_rate": 0.0}, "frame_rate: got 0.0"),
        ({"frame_rate": 1.0, "times": [0.0]}, "got both"),
        ({"timeout_s": -1.0}, "timeout_s: got -1.0"),
        ({"newest": True}, "newest: got True, expected False or None: a list is not live"),
        ({"camera_size": (1, 1)}, "camera_size: got .*, expected None: a list is not a camera"),
    ],
)
def test_options_outside_of_their_range_are_refused(options, message):
    with pytest.raises(rsflow.OptionError, match=message):
        rsflow.frames([PICTURE], **options)


def test_sources_of_a_wrong_kind_are_refused():
    wrong = (
        (True, "got True"),
        (-1, "source: got -1, expected an integer from 0"),
        (None, "got NoneType"),
        (np.zeros(3), "one array"),
    )
    for source, message in wrong:
        with pytest.raises(rsflow.OptionError, match=message):
            rsflow.frames(source)
    with pytest.raises(rsflow.OptionError, match="frames of another call"):
        rsflow.frames(rsflow.frames([PICTURE]))
