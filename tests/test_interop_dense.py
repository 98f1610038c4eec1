"""Dense flow behind OpenCV's interface: what a program that used ``cv2.DISOpticalFlow`` gets, beside OpenCV itself."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import synthetic
from rsflow.interop import opencv

PAIR = synthetic.shifted_pair(3.25, -1.5, size=(160, 120), seed=3)
PREV, NEXT = PAIR.prev, PAIR.next
PRESETS = [
    (opencv.DISOPTICAL_FLOW_PRESET_ULTRAFAST, "ultrafast"),
    (opencv.DISOPTICAL_FLOW_PRESET_FAST, "fast"),
    (opencv.DISOPTICAL_FLOW_PRESET_MEDIUM, "balanced"),
]


def last_flow(library) -> np.ndarray:
    """Run a program written for OpenCV on the names of `library`."""
    dis = library.DISOpticalFlow_create(library.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow = None
    for before, after in itertools.pairwise([PREV, NEXT, PREV, NEXT]):
        flow = dis.calc(before, after, flow)
    dis = library.DISOpticalFlow_create(library.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow = dis.calc(I0=PREV, I1=NEXT, flow=flow)
    dis.collectGarbage()
    return flow


def test_a_program_runs_with_its_import_changed() -> None:
    ours, theirs = last_flow(opencv), last_flow(cv2)
    assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
    truth = np.float32([3.25, -1.5])
    inside = (slice(10, -10), slice(10, -10))
    ours, theirs = (np.linalg.norm(flow[inside] - truth, axis=2).mean() for flow in (ours, theirs))
    assert ours < min(0.1, theirs)


@pytest.mark.parametrize(("number", "preset"), PRESETS)
def test_presets_are_those_of_dense_flow(number: int, preset) -> None:
    flow = opencv.DISOpticalFlow_create(number).calc(PREV, NEXT, None)
    np.testing.assert_array_equal(flow, rsflow.dense_flow(PREV, NEXT, preset=preset).uv)


def test_numbers_of_presets_are_those_of_opencv() -> None:
    for name in ("ULTRAFAST", "FAST", "MEDIUM"):
        assert getattr(opencv, f"DISOPTICAL_FLOW_PRESET_{name}") == getattr(cv2, f"DISOPTICAL_FLOW_PRESET_{name}")
    np.testing.assert_array_equal(
        opencv.DISOpticalFlow_create().calc(PREV, NEXT, None), opencv.DenseFlow(preset="fast").calc(PREV, NEXT)
    )


@pytest.mark.parametrize(
    ("shape", "dtype", "used"),
    [
        ((120, 160, 2), np.float32, True),
        ((4, 5, 2), np.float32, False),
        ((120, 160, 2), np.float64, False),
        ((120, 160), np.float32, False),
    ],
)
def test_the_given_array_is_used_where_opencv_uses_it(shape: tuple[int, ...], dtype: type, used: bool) -> None:
    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    want = opencv.DenseFlow(preset="fast").calc(PREV, NEXT, None)
    for estimator in (opencv.DenseFlow(preset="fast"), dis):
        given = np.zeros(shape, dtype)
        flow = estimator.calc(PREV, NEXT, given)
        assert (flow.shape, flow.dtype) == ((120, 160, 2), np.float32)
        assert (flow is given) == used
        assert given.any() == used
        if estimator is not dis:
            np.testing.assert_array_equal(flow, want)


def test_an_array_that_must_not_be_written_is_left_alone() -> None:
    given = np.zeros((120, 160, 2), np.float32)
    given.flags.writeable = False
    assert opencv.DenseFlow(preset="fast").calc(PREV, NEXT, given).any()
    assert not given.any()


def test_misuse_is_told_at_once() -> None:
    with pytest.raises(rsflow.OptionError, match=r"preset: got 3, expected 0 \(ultrafast\), 1 \(fast\) or 2"):
        opencv.DISOpticalFlow_create(3)
    with pytest.raises(rsflow.OptionError, match='preset: got "slow"'):
        opencv.DenseFlow(preset="slow")  # type: ignore[arg-type]
    with pytest.raises(rsflow.OptionError, match="max_displacement: got -1"):
        opencv.DenseFlow(max_displacement=-1)
    estimator = opencv.DenseFlow()
    with pytest.raises(rsflow.ShapeError, match="I0: got colour"):
        estimator.calc(np.dstack([PREV] * 3), np.dstack([NEXT] * 3), None)
    with pytest.raises(rsflow.ShapeError, match="expected the shape of I0"):
        estimator.calc(PREV, NEXT[:50], None)
