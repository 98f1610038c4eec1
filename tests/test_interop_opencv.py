"""The drop-ins beside OpenCV itself, on the same input."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from skimage import data

from rsflow.errors import DTypeError, OptionError, ShapeError
from rsflow.interop import opencv


def picture() -> np.ndarray:
    return np.ascontiguousarray(data.camera()[60:420, 30:480])


def moved(frame: np.ndarray, dx: float, dy: float, angle: float = 1.0) -> np.ndarray:
    height, width = frame.shape
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), angle, 1.01)
    matrix[:, 2] += dx, dy
    return cv2.warpAffine(frame, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def points(frame: np.ndarray) -> np.ndarray:
    corners = cv2.goodFeaturesToTrack(frame, 500, 0.01, 7)
    x, y = np.meshgrid(np.arange(4.5, frame.shape[1], 22), np.arange(3.25, frame.shape[0], 22))
    return np.concatenate([corners, np.stack([x.ravel(), y.ravel()], axis=1)[:, None]]).astype(np.float32)


CALLS = {
    "defaults": {},
    "window": {"winSize": (15, 9), "maxLevel": 2},
    "large window": {"winSize": (41, 33)},
    "one level": {"maxLevel": 0},
    "count": {"criteria": (cv2.TERM_CRITERIA_COUNT, 5, 0.0)},
    "epsilon": {"criteria": (cv2.TERM_CRITERIA_EPS, 0, 0.3)},
    "eigenvalues": {"flags": cv2.OPTFLOW_LK_GET_MIN_EIGENVALS},
    "threshold": {"minEigThreshold": 1e-2},
}


@pytest.mark.parametrize("call", CALLS)
def test_points_go_where_opencv_has_them(call):
    prev = picture()
    nxt = moved(prev, 1.3, -0.6, 0.3)
    start = points(prev)
    want = cv2.calcOpticalFlowPyrLK(prev, nxt, start, None, **CALLS[call])
    got = opencv.calcOpticalFlowPyrLK(prev, nxt, start, None, **CALLS[call])
    for ours, theirs in zip(got, want, strict=True):
        assert ours.shape == theirs.shape
        assert ours.dtype == theirs.dtype
    assert (got[1] == want[1]).mean() >= 0.99
    both = (got[1] & want[1])[:, 0] == 1
    difference = np.linalg.norm((got[0] - want[0])[both, 0], axis=1)
    assert np.median(difference) < 0.01
    inner = ((start > 40) & (start < np.float32(prev.shape[::-1]) - 40)).all(axis=2)[:, 0][both]
    assert np.quantile(difference[inner], 0.9) < 0.02
    # Over the border too: gradients are zero out there.
    assert np.quantile(difference, 0.9) < 0.03
    # OpenCV leaves the errors of lost points unset: they may be anything, NaN too.
    error = np.abs(got[2][both, 0] - want[2][both, 0])
    assert np.median(error) < 0.02 * np.median(want[2][both]) + 0.02


def test_a_first_guess_is_taken_and_outputs_are_written():
    prev = picture()
    nxt = moved(prev, 20.4, 3.7, 0.0)
    start = cv2.goodFeaturesToTrack(prev[60:-60, 60:-60], 200, 0.01, 7) + 60
    guess = start + np.float32([20, 4])
    arguments = {"maxLevel": 0, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    want, want_status, _ = cv2.calcOpticalFlowPyrLK(prev, nxt, start, guess.copy(), **arguments)
    ours = guess.copy()
    status = np.zeros((len(start), 1), np.uint8)
    got, got_status, _ = opencv.calcOpticalFlowPyrLK(prev, nxt, start, ours, status, **arguments)
    assert got is ours
    assert got_status is status
    assert (status == want_status).mean() >= 0.99
    assert np.median(np.linalg.norm(got - want, axis=2)) < 0.01


@pytest.mark.parametrize("shape", [(-1, 1, 2), (1, -1, 2), (-1, 2)])
def test_points_keep_their_shape(shape):
    prev = picture()
    start = points(prev)[:50].reshape(shape)
    got = opencv.calcOpticalFlowPyrLK(prev, prev, start, None)[0]
    assert got.shape == cv2.calcOpticalFlowPyrLK(prev, prev, start, None)[0].shape
    np.testing.assert_allclose(got, start, atol=1e-3)


def test_no_points_give_what_opencv_gives():
    prev = picture()
    none = np.zeros((0, 1, 2), np.float32)
    assert opencv.calcOpticalFlowPyrLK(prev, prev, none, None) == cv2.calcOpticalFlowPyrLK(prev, prev, none, None)


def test_a_pyramid_is_opencvs_and_serves_as_an_image():
    prev = picture()
    for derivatives in (False, True):
        want_level, want = cv2.buildOpticalFlowPyramid(prev, (21, 21), 5, withDerivatives=derivatives)
        level, got = opencv.buildOpticalFlowPyramid(prev, (21, 21), 5, withDerivatives=derivatives)
        assert level == want_level
        assert len(got) == len(want)
        for ours, theirs in zip(got, want, strict=True):
            assert ours.shape == theirs.shape
            assert ours.dtype == theirs.dtype
            inner = np.abs(ours.astype(int) - theirs.astype(int))[1:-1, 1:-1]
            assert inner.max() <= (32 if ours.ndim == 3 else 1)
            assert np.median(inner) == 0
    start = points(prev)
    nxt = opencv.buildOpticalFlowPyramid(moved(prev, 1, 1), (21, 21), 3)[1]
    moved_by_pyramid = opencv.calcOpticalFlowPyrLK(got, nxt, start, None)
    moved_by_image = opencv.calcOpticalFlowPyrLK(prev, moved(prev, 1, 1), start, None)
    np.testing.assert_array_equal(moved_by_pyramid[0], moved_by_image[0])


CORNER_CALLS = {
    "defaults": {"maxCorners": 300, "qualityLevel": 0.01, "minDistance": 8},
    "all": {"maxCorners": 0, "qualityLevel": 0.05, "minDistance": 0},
    "block": {"maxCorners": 200, "qualityLevel": 0.02, "minDistance": 5.5, "blockSize": 7},
    "harris": {"maxCorners": 200, "qualityLevel": 0.01, "minDistance": 5, "useHarrisDetector": True, "k": 0.05},
}


@pytest.mark.parametrize("call", CORNER_CALLS)
@pytest.mark.parametrize("masked", [False, True])
def test_corners_are_opencvs(call, masked):
    frame = picture()
    mask = None
    if masked:
        mask = np.zeros(frame.shape, np.uint8)
        mask[80:300, 100:400] = 255
    want = cv2.goodFeaturesToTrack(frame, mask=mask, **CORNER_CALLS[call])
    got = opencv.goodFeaturesToTrack(frame, mask=mask, **CORNER_CALLS[call])
    assert got.shape[1:] == want.shape[1:]
    assert got.dtype == want.dtype
    ours, theirs = ({tuple(corner) for corner in corners[:, 0].tolist()} for corners in (got, want))
    assert len(ours & theirs) >= 0.97 * max(len(ours), len(theirs))


def test_no_corners_are_none():
    flat = np.full((50, 60), 7, np.uint8)
    assert opencv.goodFeaturesToTrack(flat, 10, 0.1, 1) is None
    assert cv2.goodFeaturesToTrack(flat, 10, 0.1, 1) is None


BAD_CALLS = {
    "points": (
        lambda f: (f, f, np.zeros((3, 3), np.float32), None),
        {},
        ShapeError,
        r"prevPts: got shape \(3, 3\), expected \(N, 1, 2\)",
    ),
    "point type": (lambda f: (f, f, np.zeros((3, 2)), None), {}, DTypeError, "prevPts: got dtype float64"),
    "list": (lambda f: (f, f, [[1, 2]], None), {}, DTypeError, "prevPts: got list, expected a numpy array"),
    "guess": (lambda f: (f, f, np.zeros((3, 2), np.float32), None), {"flags": 4}, ShapeError, "nextPts: got None"),
    "guesses": (
        lambda f: (f, f, np.zeros((3, 2), np.float32), np.zeros((2, 2), np.float32)),
        {"flags": 4},
        ShapeError,
        "nextPts: got 2 points, expected one for each of the 3 points of prevPts",
    ),
    "sizes": (
        lambda f: (f, f[:-1], np.zeros((3, 2), np.float32), None),
        {},
        ShapeError,
        r"nextImg: got \(359, 450\), expected the shape of prevImg",
    ),
    "window": (
        lambda f: (f, f, np.zeros((3, 2), np.float32), None),
        {"winSize": (2, 9)},
        OptionError,
        r"winSize: got \(2, 9\), expected \(width, height\), more than 2",
    ),
    "wide window": (
        lambda f: (f, f, np.zeros((3, 2), np.float32), None),
        {"winSize": (99, 9)},
        OptionError,
        r"winSize: got \(99, 9\), expected 3 to 63",
    ),
    "level": (
        lambda f: (f, f, np.zeros((3, 2), np.float32), None),
        {"maxLevel": -1},
        OptionError,
        "maxLevel: got -1, expected an integer of at least 0",
    ),
}


@pytest.mark.parametrize("call", BAD_CALLS)
def test_what_opencv_refuses_is_refused(call):
    arguments, keywords, error, message = BAD_CALLS[call]
    with pytest.raises(error, match=message):
        opencv.calcOpticalFlowPyrLK(*arguments(picture()), **keywords)


def test_other_misuse_is_refused():
    with pytest.raises(DTypeError, match="img: got dtype float32, expected uint8"):
        opencv.buildOpticalFlowPyramid(picture().astype(np.float32), (21, 21), 3)
    with pytest.raises(OptionError, match="maxLevel: got -2"):
        opencv.buildOpticalFlowPyramid(picture(), (21, 21), -2)
    with pytest.raises(DTypeError, match="mask: got dtype float64, expected uint8"):
        opencv.goodFeaturesToTrack(picture(), 10, 0.1, 1, mask=np.ones((360, 450)))
