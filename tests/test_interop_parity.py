"""OpenCV's point functions and ours on the same input: many pictures and motions, each flag, each criterion."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from rsflow import RsflowError
from rsflow.interop import opencv

PICTURES = ["camera", "coins", "moon", "page", "brick", "text"]

# dx, dy, turn in degrees, zoom.
MOTIONS = [(1.3, -0.6, 0.3, 1.0), (6.2, 4.1, 0.0, 1.0), (-14.5, 9.0, 2.0, 1.03)]

CALLS = {
    "defaults": {},
    "large": {"winSize": (31, 31), "maxLevel": 4},
    "eigenvalues and a threshold": {"flags": cv2.OPTFLOW_LK_GET_MIN_EIGENVALS, "minEigThreshold": 1e-3},
}


def pair(name: str, motion: tuple[float, float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    prev = np.ascontiguousarray(getattr(data, name)()[:400, :480])
    height, width = prev.shape
    dx, dy, turn, zoom = motion
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), turn, zoom)
    matrix[:, 2] += dx, dy
    moved = cv2.warpAffine(prev, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    noise = np.random.default_rng(7).standard_normal(prev.shape)
    return prev, np.clip(moved + noise, 0, 255).astype(np.uint8)


def agreement(got, want) -> tuple[float, float]:
    """The share of equal statuses, and the median difference of the points that both found."""
    both = ((got[1] == 1) & (want[1] == 1))[:, 0]
    return (got[1] == want[1]).mean(), np.median(np.linalg.norm((got[0] - want[0])[both, 0], axis=1))


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_and_motion(name, motion, call):
    prev, nxt = pair(name, motion)
    # Corners stand up to the border, and some leave the frame.
    start = cv2.goodFeaturesToTrack(prev, 400, 0.01, 7)
    want = cv2.calcOpticalFlowPyrLK(prev, nxt, start, None, **CALLS[call])
    got = opencv.calcOpticalFlowPyrLK(prev, nxt, start, None, **CALLS[call])
    status, difference = agreement(got, want)
    assert status >= 0.99
    assert difference < 0.01
    both = ((got[1] == 1) & (want[1] == 1))[:, 0]
    # OpenCV leaves the errors of lost points unset: they may be anything, NaN too.
    error = np.abs(got[2][both, 0] - want[2][both, 0])
    assert np.median(error) <= 0.01 * np.median(want[2][both])


def test_windows_over_the_border_go_where_opencv_has_them():
    prev, nxt = pair("camera", MOTIONS[0])
    height, width = prev.shape
    along = np.arange(2.5, min(height, width), 6, dtype=np.float32)
    edges = [
        np.stack(sides, axis=1)
        for near in (0.0, 3.25, 9.5)
        for sides in (
            (along, np.full_like(along, near)),
            (along, np.full_like(along, height - 1 - near)),
            (np.full_like(along, near), along),
            (np.full_like(along, width - 1 - near), along),
        )
    ]
    start = np.concatenate(edges)[:, None].astype(np.float32)
    want = cv2.calcOpticalFlowPyrLK(prev, nxt, start, None, maxLevel=1)
    got = opencv.calcOpticalFlowPyrLK(prev, nxt, start, None, maxLevel=1)
    status, difference = agreement(got, want)
    assert status >= 0.99
    assert difference < 0.01


CRITERIA = {
    "count 1": (cv2.TERM_CRITERIA_COUNT, 1, 0.0),
    "count 0": (cv2.TERM_CRITERIA_COUNT, 0, 0.0),
    "count above what is allowed": (cv2.TERM_CRITERIA_COUNT, 1000, 0.0),
    "epsilon 10": (cv2.TERM_CRITERIA_EPS, 0, 10.0),
    "epsilon below 0": (cv2.TERM_CRITERIA_EPS, 0, -1.0),
    "both": (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 3, 0.2),
    "neither": (0, 3, 0.2),
}


@pytest.mark.parametrize("criteria", CRITERIA)
def test_every_criterion(criteria):
    prev, nxt = pair("camera", MOTIONS[0])
    start = cv2.goodFeaturesToTrack(prev, 300, 0.01, 7)
    want = cv2.calcOpticalFlowPyrLK(prev, nxt, start, None, criteria=CRITERIA[criteria])
    got = opencv.calcOpticalFlowPyrLK(prev, nxt, start, None, criteria=CRITERIA[criteria])
    status, difference = agreement(got, want)
    assert status >= 0.99
    assert difference < 0.01


def test_both_flags_at_once_and_points_outside():
    prev, nxt = pair("camera", (20.4, 3.7, 0.0, 1.0))
    start = cv2.goodFeaturesToTrack(prev[60:-60, 60:-60], 200, 0.01, 7) + 60
    outside = np.float32([[[-300, 10]], [[10, -300]], [[2000, 10]], [[10, 2000]]])
    start = np.concatenate([start, outside])
    guess = start + np.float32([20, 4])
    arguments = {
        "maxLevel": 1,
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW | cv2.OPTFLOW_LK_GET_MIN_EIGENVALS,
    }
    want = cv2.calcOpticalFlowPyrLK(prev, nxt, start, guess.copy(), **arguments)
    got = opencv.calcOpticalFlowPyrLK(prev, nxt, start, guess.copy(), **arguments)
    status, difference = agreement(got, want)
    assert status >= 0.99
    assert difference < 0.01
    assert not got[1][-4:].any()
    np.testing.assert_array_equal(got[1][-4:], want[1][-4:])
    found = want[1][:, 0] == 1
    assert np.median(np.abs(got[2][found] - want[2][found])) <= 0.01 * np.median(want[2][found])


def test_flags_are_those_of_opencv():
    assert opencv.OPTFLOW_USE_INITIAL_FLOW == cv2.OPTFLOW_USE_INITIAL_FLOW
    assert opencv.OPTFLOW_LK_GET_MIN_EIGENVALS == cv2.OPTFLOW_LK_GET_MIN_EIGENVALS


def test_one_point_and_strided_frames():
    prev, nxt = pair("camera", MOTIONS[0])
    start = np.float32([[[100.5, 90.25]]])
    want = cv2.calcOpticalFlowPyrLK(
        np.ascontiguousarray(prev[::2, ::2]), np.ascontiguousarray(nxt[::2, ::2]), start, None
    )
    got = opencv.calcOpticalFlowPyrLK(prev[::2, ::2], nxt[::2, ::2], start, None)
    assert got[0].shape == (1, 1, 2)
    assert got[1].shape == got[2].shape == (1, 1)
    np.testing.assert_allclose(got[0], want[0], atol=0.01)


@pytest.mark.parametrize("window", [(21, 21), (9, 15), (101, 101)])
@pytest.mark.parametrize("most", [0, 1, 3, 12])
def test_pyramids_have_opencvs_levels(window, most):
    prev = pair("coins", MOTIONS[0])[0]
    want_level, want = cv2.buildOpticalFlowPyramid(prev, window, most, withDerivatives=False)
    level, got = opencv.buildOpticalFlowPyramid(prev, window, most, withDerivatives=False)
    assert level == want_level
    assert [picture.shape for picture in got] == [picture.shape for picture in want]
    for ours, theirs in zip(got, want, strict=True):
        assert np.abs(ours.astype(int) - theirs.astype(int)).max() <= 1


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("name", PICTURES)
def test_corners_of_every_picture(name, dtype):
    frame = pair(name, MOTIONS[0])[1].astype(dtype)
    want = cv2.goodFeaturesToTrack(frame, 300, 0.01, 8)
    got = opencv.goodFeaturesToTrack(frame, 300, 0.01, 8)
    assert got.shape[1:] == want.shape[1:]
    assert got.dtype == want.dtype
    ours, theirs = ({tuple(corner) for corner in corners[:, 0].tolist()} for corners in (got, want))
    assert len(ours & theirs) >= 0.97 * max(len(ours), len(theirs))


BAD_CORNERS = {
    "quality": {"qualityLevel": 0.0},
    "negative quality": {"qualityLevel": -1.0},
    "distance": {"minDistance": -1.0},
    "mask size": {"mask": np.ones((3, 3), np.uint8)},
}


@pytest.mark.parametrize("bad", BAD_CORNERS)
def test_corners_that_opencv_refuses_are_refused(bad):
    frame = pair("coins", MOTIONS[0])[0]
    arguments = {"maxCorners": 10, "qualityLevel": 0.1, "minDistance": 3, **BAD_CORNERS[bad]}
    with pytest.raises(cv2.error):
        cv2.goodFeaturesToTrack(frame, **arguments)
    with pytest.raises(RsflowError):
        opencv.goodFeaturesToTrack(frame, **arguments)
