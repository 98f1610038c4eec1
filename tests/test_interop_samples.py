"""What OpenCV's Python samples do, with `cv2` and with the drop-in in its place: only the module differs.

Each function below takes the steps of one sample (lk_track, lk_homography, dis_opt_flow, opt_flow), drawing included,
on frames of a made scene whose motion is known. Windows are left out: the wheel that tests use has none.
"""

from __future__ import annotations

import itertools
import pickle
import subprocess
import sys
from functools import cache
from types import ModuleType

import cv2
import numpy as np
import pytest

from rsflow import RsflowError, synthetic
from rsflow.interop import opencv

LIBRARIES = {"cv2": cv2, "rsflow": opencv}
WIDTH, HEIGHT = 320, 240
# From one frame to the next, in pixels: a shift, a turn of 0.4 degrees, a zoom of 0.3 % and some perspective.
STEP = np.array([[1.003, -0.007, 2.3], [0.007, 1.003, -1.7], [2e-6, -1e-6, 1.0]])


@cache
def frames(count: int = 8, light: float = 1.0) -> list[np.ndarray]:
    """Colour frames; each is `light` times as bright as the one before."""
    scene = synthetic.Texture.make("ground", seed=5, period=512)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    shown = []
    for index in range(count):
        at = moved(np.stack([x, y], axis=-1).reshape(-1, 2), -index)
        grey = (110 + 40 * scene.sample(at[:, 0], at[:, 1]).reshape(HEIGHT, WIDTH)) * light**index
        shown.append(np.clip(np.dstack([0.9 * grey, grey, 1.05 * grey]) + 0.5, 0, 255).astype(np.uint8))
    return shown


def moved(points: np.ndarray, steps: int) -> np.ndarray:
    """Where the scene's points are so many frames later."""
    matrix = np.linalg.matrix_power(STEP if steps >= 0 else np.linalg.inv(STEP), abs(steps))
    after = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return after[:, :2] / after[:, 2:]


def true_flow() -> np.ndarray:
    """From each frame to the next."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    at = np.stack([x, y], axis=-1)
    return moved(at.reshape(-1, 2), 1).reshape(at.shape) - at


def lk_track(cv: ModuleType) -> tuple[list[tuple[int, np.ndarray]], np.ndarray]:
    """Tracks of corners, each with the frame that it begins in, and the last picture drawn."""
    search = {
        "winSize": (15, 15),
        "maxLevel": 2,
        "criteria": (cv.TERM_CRITERIA_EPS | cv.TERM_CRITERIA_COUNT, 10, 0.03),
    }
    features = {"maxCorners": 500, "qualityLevel": 0.3, "minDistance": 7, "blockSize": 7}
    tracks: list[tuple[int, list[tuple[float, float]]]] = []
    prev_gray = vis = None
    for index, frame in enumerate(frames()):
        frame_gray = cv.cvtColor(frame, cv.COLOR_BGR2GRAY)
        vis = frame.copy()
        if tracks:
            p0 = np.float32([points[-1] for _, points in tracks]).reshape(-1, 1, 2)
            p1, _st, _err = cv.calcOpticalFlowPyrLK(prev_gray, frame_gray, p0, None, **search)
            p0r, _st, _err = cv.calcOpticalFlowPyrLK(frame_gray, prev_gray, p1, None, **search)
            good = abs(p0 - p0r).reshape(-1, 2).max(-1) < 1
            kept = []
            for (start, points), (x, y), fits in zip(tracks, p1.reshape(-1, 2), good, strict=True):
                if fits:
                    points.append((x, y))
                    kept.append((start, points))
                    cv.circle(vis, (int(x), int(y)), 2, (0, 255, 0), -1)
            tracks = kept
            cv.polylines(vis, [np.int32(points) for _, points in tracks], False, (0, 255, 0))
            cv.putText(vis, f"track count: {len(tracks)}", (20, 20), cv.FONT_HERSHEY_PLAIN, 1.0, (255, 255, 255))
        if index % 5 == 0:
            mask = np.full_like(frame_gray, 255)
            for x, y in [np.int32(points[-1]) for _, points in tracks]:
                cv.circle(mask, (int(x), int(y)), 5, 0, -1)
            p = cv.goodFeaturesToTrack(frame_gray, mask=mask, **features)
            if p is not None:
                tracks += [(index, [(x, y)]) for x, y in np.float32(p).reshape(-1, 2)]
        prev_gray = frame_gray
    return [(start, np.float32(points)) for start, points in tracks], vis


def lk_homography(cv: ModuleType) -> tuple[np.ndarray, int, np.ndarray]:
    """The homography from the first frame to the last, how many points it is of, and the last picture drawn."""
    search = {
        "winSize": (19, 19),
        "maxLevel": 2,
        "criteria": (cv.TERM_CRITERIA_EPS | cv.TERM_CRITERIA_COUNT, 10, 0.03),
    }
    first = frames()[0]
    gray1 = cv.cvtColor(first, cv.COLOR_BGR2GRAY)
    p0 = p1 = cv.goodFeaturesToTrack(gray1, maxCorners=1000, qualityLevel=0.01, minDistance=8, blockSize=19)
    for frame in frames()[1:]:
        frame_gray = cv.cvtColor(frame, cv.COLOR_BGR2GRAY)
        p2, _st, _err = cv.calcOpticalFlowPyrLK(gray1, frame_gray, p1, None, **search)
        back, _st, _err = cv.calcOpticalFlowPyrLK(frame_gray, gray1, p2, None, **search)
        good = abs(p1 - back).reshape(-1, 2).max(-1) < 1.0
        p0, p1, gray1 = p0[good].copy(), p2[good].copy(), frame_gray
        H, status = cv.findHomography(p0, p1, cv.RANSAC, 10.0)
        overlay = cv.warpPerspective(first, H, (WIDTH, HEIGHT))
        vis = cv.addWeighted(frame, 0.5, overlay, 0.5, 0.0)
        for (x0, y0), (x1, y1), fits in zip(np.int32(p0[:, 0]), np.int32(p1[:, 0]), status[:, 0], strict=True):
            if fits:
                cv.line(vis, (int(x0), int(y0)), (int(x1), int(y1)), (0, 128, 0))
            cv.circle(vis, (int(x1), int(y1)), 2, ((0, 0, 255), (0, 255, 0))[fits], -1)
    return H, len(p1), vis


def drawn(cv: ModuleType, gray: np.ndarray, flow: np.ndarray) -> list[np.ndarray]:
    """Flow as lines over the picture, as colours, and the picture warped by it: what both dense samples show."""
    h, w = gray.shape
    y, x = np.mgrid[8:h:16, 8:w:16].reshape(2, -1)
    fx, fy = flow[y, x].T
    lines = np.int32(np.vstack([x, y, x + fx, y + fy]).T.reshape(-1, 2, 2) + 0.5)
    arrows = cv.cvtColor(gray, cv.COLOR_GRAY2BGR)
    cv.polylines(arrows, lines, 0, (0, 255, 0))
    hsv = np.zeros((h, w, 3), np.uint8)
    hsv[..., 0] = (np.arctan2(flow[..., 1], flow[..., 0]) + np.pi) * (180 / np.pi / 2)
    hsv[..., 1] = 255
    hsv[..., 2] = np.minimum(np.hypot(flow[..., 0], flow[..., 1]) * 4, 255)
    return [arrows, cv.cvtColor(hsv, cv.COLOR_HSV2BGR), warp_flow(cv, gray, flow)]


def warp_flow(cv: ModuleType, picture: np.ndarray, flow: np.ndarray) -> np.ndarray:
    h, w = flow.shape[:2]
    back = -flow
    back[:, :, 0] += np.arange(w)
    back[:, :, 1] += np.arange(h)[:, np.newaxis]
    return cv.remap(picture, back, None, cv.INTER_LINEAR)


def dis_opt_flow(cv: ModuleType, *, temporal: bool) -> tuple[list[np.ndarray], list[np.ndarray]]:
    inst = cv.DISOpticalFlow.create(cv.DISOPTICAL_FLOW_PRESET_MEDIUM)
    inst.setUseSpatialPropagation(False)
    flows, flow = [], None
    for before, after in itertools.pairwise(frames()):
        prevgray, gray = (cv.cvtColor(frame, cv.COLOR_BGR2GRAY) for frame in (before, after))
        start = warp_flow(cv, flow, flow) if flow is not None and temporal else None
        flow = inst.calc(prevgray, gray, start)
        flows.append(flow.copy())
        inst.setUseSpatialPropagation(not inst.getUseSpatialPropagation())
    return flows, drawn(cv, gray, flow)


def opt_flow(cv: ModuleType, light: float = 1.0) -> tuple[list[np.ndarray], list[np.ndarray]]:
    flows = []
    for before, after in itertools.pairwise(frames(light=light)):
        prevgray, gray = (cv.cvtColor(frame, cv.COLOR_BGR2GRAY) for frame in (before, after))
        flows.append(cv.calcOpticalFlowFarneback(prevgray, gray, None, 0.5, 3, 15, 3, 5, 1.2, 0))
    return flows, drawn(cv, gray, flows[-1])


def test_lk_track():
    (ours, picture), (theirs, their_picture) = lk_track(opencv), lk_track(cv2)
    assert (picture.shape, picture.dtype) == (their_picture.shape, their_picture.dtype)
    assert len(theirs) > 100
    ends = {(start, *points[0].tolist()): points for start, points in theirs}
    both = [(points, ends[key]) for start, points in ours if (key := (start, *points[0].tolist())) in ends]
    assert len(both) >= 0.97 * max(len(ours), len(theirs))
    apart = np.float32([np.linalg.norm(a[-1] - b[-1]) for a, b in both])
    assert np.median(apart) < 0.02
    assert np.quantile(apart, 0.95) < 0.1
    for tracks in (ours, theirs):
        whole = np.float32([(points[0], points[-1]) for start, points in tracks if start == 0])
        assert len(whole) > 50
        assert np.median(np.linalg.norm(whole[:, 1] - moved(whole[:, 0], 7), axis=1)) < 0.15


def test_lk_homography():
    (ours, count, picture), (theirs, their_count, their_picture) = lk_homography(opencv), lk_homography(cv2)
    assert (picture.shape, picture.dtype) == (their_picture.shape, their_picture.dtype)
    assert count > 100
    assert abs(count - their_count) <= 0.03 * their_count
    corners = np.float32([[30, 30], [290, 30], [290, 210], [30, 210]])
    ours, theirs = (cv2.perspectiveTransform(corners[:, None], found)[:, 0] for found in (ours, theirs))
    assert np.linalg.norm(ours - theirs, axis=1).max() < 0.1
    assert np.linalg.norm(ours - moved(corners, 7), axis=1).max() < 0.2


def errors(flows: list[np.ndarray]) -> np.ndarray:
    """Lengths of the differences from the truth, away from where the scene leaves the frame."""
    assert {(flow.shape, flow.dtype) for flow in flows} == {((HEIGHT, WIDTH, 2), np.dtype(np.float32))}
    return np.linalg.norm(np.stack(flows) - true_flow(), axis=3)[:, 12:-12, 12:-12]


@pytest.mark.parametrize("temporal", [False, True])
def test_dis_opt_flow(temporal):
    (ours, pictures), (theirs, their_pictures) = (dis_opt_flow(cv, temporal=temporal) for cv in (opencv, cv2))
    ours, theirs = errors(ours), errors(theirs)
    assert np.median(ours) < 0.05
    assert np.quantile(ours, 0.95) < 0.15
    assert np.median(ours) < np.median(theirs)
    same_pictures(pictures, their_pictures)


def test_opt_flow():
    (ours, pictures), (theirs, their_pictures) = opt_flow(opencv), opt_flow(cv2)
    ours, theirs = errors(ours), errors(theirs)
    assert np.median(ours) < 0.05
    assert np.quantile(ours, 0.95) < 0.15
    assert np.median(ours) < 1.1 * np.median(theirs)
    same_pictures(pictures, their_pictures)


def test_opt_flow_while_the_light_changes():
    ours, theirs = (np.median(errors(opt_flow(cv, light=0.9)[0])) for cv in (opencv, cv2))
    assert ours < 0.05
    assert ours < 0.5 * theirs


def same_pictures(ours: list[np.ndarray], theirs: list[np.ndarray]) -> None:
    """Both libraries' flows, drawn, differ by a few grey levels."""
    for mine, other in zip(ours, theirs, strict=True):
        assert mine.shape == other.shape
        assert mine.dtype == other.dtype
        inside = (slice(12, -12), slice(12, -12))
        assert np.median(np.abs(mine[inside].astype(int) - other[inside].astype(int))) <= 2


# --- Names, and what the samples do not do ---------------------------------------------------------------------------


def test_other_names_are_opencvs():
    for name in ("cvtColor", "circle", "TERM_CRITERIA_EPS", "VideoCapture", "FarnebackOpticalFlow_create", "error"):
        assert getattr(opencv, name) is getattr(cv2, name)
    assert opencv.__version__ == cv2.__version__
    assert set(dir(opencv)) >= {name for name in dir(cv2) if not name.startswith("_")} | set(opencv.__all__)
    assert [name for name in dir(opencv) if not hasattr(opencv, name)] == []
    with pytest.raises(AttributeError, match=r"rsflow\.interop\.opencv.*no attribute 'calcOpticalFlow', and neither"):
        opencv.calcOpticalFlow  # noqa: B018


def test_constants_are_those_of_opencv():
    numbers = [name for name in opencv.__all__ if isinstance(getattr(opencv, name), int)]
    assert len(numbers) == 6
    assert {name: getattr(opencv, name) for name in numbers} == {name: getattr(cv2, name) for name in numbers}


def test_opencv_is_imported_when_a_name_of_it_is_used():
    code = (
        "import sys\nfrom rsflow.interop import opencv\nassert 'cv2' not in sys.modules\n"
        "opencv.TERM_CRITERIA_EPS\nassert 'cv2' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("preset", ["ULTRAFAST", "FAST", "MEDIUM"])
def test_dis_has_the_settings_of_opencv(preset):
    ours, theirs = (cv.DISOpticalFlow.create(getattr(cv, f"DISOPTICAL_FLOW_PRESET_{preset}")) for cv in (opencv, cv2))
    assert isinstance(ours, opencv.DISOpticalFlow)
    assert {name for name in dir(theirs) if not name.startswith("_")} <= set(dir(ours))
    names = [name[3:] for name in dir(theirs) if name.startswith("set")]
    assert len(names) == 12
    for name in names:
        value = getattr(theirs, f"get{name}")()
        assert getattr(ours, f"get{name}")() == value
        other = not value if isinstance(value, bool) else value + 1
        getattr(ours, f"set{name}")(other)
        # OpenCV keeps float32.
        assert getattr(ours, f"get{name}")() == pytest.approx(other, rel=1e-6)
    again = pickle.loads(pickle.dumps(ours))
    assert [getattr(again, f"get{name}")() for name in names] == [getattr(ours, f"get{name}")() for name in names]
    with pytest.raises(AttributeError, match="setNothing"):
        ours.setNothing(1)


def test_one_setting_of_dis_changes_the_flow_and_the_others_none():
    before, after = (frame[..., 1].copy() for frame in frames(light=0.8)[:2])
    want = opencv.DISOpticalFlow_create().calc(before, after, None)
    dis = opencv.DISOpticalFlow_create()
    dis.setFinestScale(0)
    dis.setPatchSize(12)
    dis.setVariationalRefinementIterations(1)
    np.testing.assert_array_equal(dis.calc(before, after, None), want)
    dis.setUseMeanNormalization(False)
    np.testing.assert_array_equal(
        dis.calc(before, after, None), opencv.DenseFlow(preset="fast", illumination="none").calc(before, after)
    )
    assert (dis.calc(before, after, None) != want).any()


FARNEBACK = (0.5, 3, 15, 3, 5, 1.2)


def test_farneback_takes_a_first_guess_and_writes_into_the_array():
    before, after = (frame[..., 1].copy() for frame in frames()[:2])
    for flags in (cv2.OPTFLOW_USE_INITIAL_FLOW, cv2.OPTFLOW_FARNEBACK_GAUSSIAN | cv2.OPTFLOW_USE_INITIAL_FLOW):
        for cv in LIBRARIES.values():
            flow = np.full((HEIGHT, WIDTH, 2), (2.0, -2.0), np.float32)
            assert cv.calcOpticalFlowFarneback(before, after, flow, *FARNEBACK, flags) is flow
            assert np.median(errors([flow])) < 0.05
    # A pattern that repeats every 16 pixels: only the guess tells by how many periods it moved.
    x, y = np.meshgrid(np.arange(160), np.arange(120))
    pattern = (120 + 50 * np.sin(2 * np.pi * x / 16) + 50 * np.sin(2 * np.pi * y / 16)).astype(np.uint8)
    start = np.full((120, 160, 2), (16.0, 0.0), np.float32)
    flow = opencv.calcOpticalFlowFarneback(pattern, pattern, start, *FARNEBACK, cv2.OPTFLOW_USE_INITIAL_FLOW)
    assert np.median(flow[30:-30, 40:-40], axis=(0, 1)).round(1).tolist() == [16.0, 0.0]


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"pyr_scale": 1.0}, "pyr_scale: got 1.0, expected a positive number below 1"),
        ({"levels": -1}, "levels: got -1"),
        ({"winsize": 0}, "winsize: got 0"),
        ({"poly_sigma": "wide"}, 'poly_sigma: got "wide"'),
        ({"flags": 4}, "flow: got None, expected a first guess"),
        ({"flags": 4, "flow": np.zeros((3, 4, 2), np.float32)}, r"flow: got shape \(3, 4, 2\)"),
        ({"next": np.zeros((10, 10), np.uint8)}, r"next: got \(10, 10\), expected the shape of prev"),
    ],
)
def test_farneback_refuses_what_does_not_fit(bad, message):
    frame = frames()[0][..., 1].copy()
    names = ("pyr_scale", "levels", "winsize", "iterations", "poly_n", "poly_sigma")
    call = {"prev": frame, "next": frame, "flow": None, "flags": 0} | dict(zip(names, FARNEBACK, strict=True)) | bad
    with pytest.raises(RsflowError, match=message):
        opencv.calcOpticalFlowFarneback(**call)


@pytest.mark.parametrize("overshoot", [0.0, 0.2])
def test_float_pictures_of_0_to_1_are_tracked(overshoot):
    before, after = (frame[..., 1].copy() for frame in frames()[:2])
    start = cv2.goodFeaturesToTrack(before, 200, 0.01, 7)
    want, want_status, want_err = cv2.calcOpticalFlowPyrLK(before, after, start, None)
    # Filters leave values a little outside of 0 to 1.
    units = [np.float32(frame) / np.float32(255) * np.float32(1 + overshoot) for frame in (before, after)]
    np.testing.assert_array_equal(opencv.goodFeaturesToTrack(units[0], 200, 0.01, 7).shape, start.shape)
    got, status, err = opencv.calcOpticalFlowPyrLK(*units, start, None)
    assert status.mean() > 0.95
    assert (status == want_status).mean() >= 0.99
    both = (status & want_status)[:, 0] == 1
    assert np.quantile(np.linalg.norm((got - want)[both, 0], axis=1), 0.9) < 0.03
    assert np.median(err[both]) == pytest.approx((1 + overshoot) * np.median(want_err[both]), rel=0.05, abs=0.02)
    # Of 0 to 255 they go where those of uint8 go.
    whole = opencv.calcOpticalFlowPyrLK(np.float32(before), np.float32(after), start, None)
    for ours, theirs in zip(whole, opencv.calcOpticalFlowPyrLK(before, after, start, None), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_flat_float_picture_stays_without_texture():
    flat = np.full((60, 80), 0.5, np.float32)
    flat += 1e-4 * np.random.default_rng(3).standard_normal(flat.shape).astype(np.float32)
    status = opencv.calcOpticalFlowPyrLK(flat, flat, np.float32([[[40, 30]]]), None)[1]
    grey = np.full((60, 80), 128, np.uint8)
    assert status[0, 0] == cv2.calcOpticalFlowPyrLK(grey, grey, np.float32([[[40, 30]]]), None)[1][0, 0] == 0
