"""Masks of any shape, held to what must be true of all: nothing depends on pixels that do not count."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rsflow
from rsflow import PointStatus, synthetic

SHAPE = (96, 128)
MOTION = (1.7, -0.6)


def scene(dtype: type) -> tuple[np.ndarray, np.ndarray]:
    """A texture that moved by `MOTION`, some of its grey levels cut off at either end."""
    pair = synthetic.shifted_pair(*MOTION, size=(SHAPE[1], SHAPE[0]), seed=3)
    stretched = [np.clip(np.round(2.0 * (p.astype(float) - 118) + 118), 0, 255) for p in (pair.prev, pair.next)]
    return stretched[0].astype(dtype), stretched[1].astype(dtype)


SCENES = {dtype: scene(dtype) for dtype in (np.uint8, np.uint16, np.float32)}


@st.composite
def masks(draw: st.DrawFn) -> np.ndarray:
    """A side, a disc or what is around it, stripes, scattered pixels, letters; or two of these together."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    keep = np.ones(SHAPE, bool)
    for _ in range(draw(st.integers(1, 2))):
        kind = draw(st.sampled_from(["side", "disc", "hole", "stripes", "pixels", "letters"]))
        at_y, at_x = draw(st.integers(0, SHAPE[0])), draw(st.integers(0, SHAPE[1]))
        if kind == "side":
            angle = draw(st.floats(0, 6.3))
            keep &= (x - at_x) * np.cos(angle) + (y - at_y) * np.sin(angle) > 0
        elif kind in ("disc", "hole"):
            inside = np.hypot(x - at_x, y - at_y) < draw(st.integers(1, 70))
            keep &= inside if kind == "disc" else ~inside
        elif kind == "stripes":
            period = draw(st.integers(2, 40))
            keep &= (x + at_y) % period < draw(st.integers(1, period))
        else:
            rng = np.random.default_rng(draw(st.integers(0, 1000)))
            side = 1 if kind == "pixels" else 6
            small = rng.random((SHAPE[0] // side + 1, SHAPE[1] // side + 1)) < draw(st.floats(0.05, 1.0))
            keep &= np.kron(small, np.ones((side, side), bool))[: SHAPE[0], : SHAPE[1]]
    return keep


def covered(frame: np.ndarray, keep: np.ndarray, seed: int) -> np.ndarray:
    """The frame with other values where nothing counts; floats that are no grey level among them."""
    rng = np.random.default_rng(seed)
    cover = rng.integers(0, 256, frame.shape).astype(frame.dtype)
    if seed % 3 == 1:
        cover[:] = 255 if seed % 2 else 0
    if frame.dtype == np.float32:
        odd = np.float32([np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-40, 0.0, 255.0])
        cover = np.where(rng.random(frame.shape) < 0.5, rng.choice(odd, frame.shape), cover)
    return np.where(keep, frame, cover)


def same(one: np.ndarray, other: np.ndarray) -> None:
    assert one.shape == other.shape
    assert one.tobytes() == other.tobytes()


def counting(keep: np.ndarray, points: np.ndarray, window: int) -> np.ndarray:
    """How many pixels of each point's window count, the plain way: outside of the frame none does."""
    half = window // 2
    padded = np.pad(keep, half + 1)
    found = []
    for x, y in np.round(points).astype(int):
        row, column = y + 1, x + 1
        found.append(np.count_nonzero(padded[row : row + window, column : column + window]))
    return np.array(found)


GRID = np.float32([(x, y) for x in range(4, SHAPE[1], 11) for y in range(4, SHAPE[0], 11)])


@settings(max_examples=40, deadline=None)
@given(masks(), masks(), st.sampled_from(list(SCENES)), st.integers(0, 50), st.sampled_from([9, 21]))
def test_points_depend_on_what_counts_alone(
    keep: np.ndarray, keep_next: np.ndarray, dtype: type, seed: int, window: int
) -> None:
    prev, after = SCENES[dtype]
    options = {"mask": keep, "next_mask": keep_next, "window_size": window}
    first, second = (
        rsflow.track_points(covered(prev, keep, s), covered(after, keep_next, s + 7), GRID, **options)
        for s in (seed, seed + 1)
    )
    for name in ("points", "status", "residual", "covariance", "forward_backward", "deformation"):
        same(getattr(first, name), getattr(second, name))


@settings(max_examples=40, deadline=None)
@given(masks(), st.sampled_from(list(SCENES)), st.integers(0, 50), st.sampled_from([9, 15, 21]))
def test_the_status_of_a_point_is_that_of_its_windows_pixels(
    keep: np.ndarray, dtype: type, seed: int, window: int
) -> None:
    prev, after = (covered(frame, keep, seed) for frame in SCENES[dtype])
    tracks = rsflow.track_points(prev, after, GRID, mask=keep, next_mask=keep, window_size=window)
    at = GRID.astype(int)
    own = keep[at[:, 1], at[:, 0]]
    assert (tracks.status[~own] == PointStatus.MASKED).all()
    # A pixel of the filter around the window may be missing as well.
    few = own & (counting(keep, GRID, window + 2) < window * window / 8)
    assert not tracks.valid[few].any()
    told = (PointStatus.LOW_SUPPORT, PointStatus.MASKED, PointStatus.OUT_OF_FRAME)
    assert np.isin(tracks.status[few], told).all()
    # What is called tracked went where the scene went.
    error = np.abs(tracks.displacement - np.float32(MOTION))[tracks.valid]
    over = error / np.sqrt(tracks.covariance[tracks.valid][:, [0, 1], [0, 1]])
    assert (over < 8).mean() > 0.97 if len(over) > 20 else True
    to = np.round(tracks.points[tracks.valid]).astype(int)
    assert keep[to[:, 1], to[:, 0]].all()


@settings(max_examples=40, deadline=None)
@given(masks(), masks(), st.sampled_from(list(SCENES)), st.integers(0, 50), st.sampled_from(["none", "affine"]))
def test_a_shift_depends_on_what_counts_alone(
    keep: np.ndarray, keep_next: np.ndarray, dtype: type, seed: int, deformation: str
) -> None:
    prev, after = SCENES[dtype]
    first, second = (
        rsflow.estimate_shift(
            covered(prev, keep, s), covered(after, keep_next, s + 7), mask=keep, next_mask=keep_next,
            deformation=deformation,
        )
        for s in (seed, seed + 1)
    )  # fmt: skip
    assert first.status == second.status
    same(np.array([first.dx, first.dy, first.gain, first.offset, first.residual]),
         np.array([second.dx, second.dy, second.gain, second.offset, second.residual]))  # fmt: skip
    same(first.joint_covariance, second.joint_covariance)
    same(first.covariance, first.covariance.T.copy())
    if first.valid:
        over = np.abs([first.dx - MOTION[0], first.dy - MOTION[1]]) / np.sqrt(np.diag(first.covariance))
        assert over.max() < 8
    if not keep.any() or not keep_next.any():
        assert not first.valid


@settings(max_examples=40, deadline=None)
@given(masks(), st.sampled_from(list(SCENES)), st.integers(0, 50))
def test_corners_depend_on_what_counts_alone(keep: np.ndarray, dtype: type, seed: int) -> None:
    frame = SCENES[dtype][0]
    first, second = (rsflow.detect_corners(covered(frame, keep, s), mask=keep) for s in (seed, seed + 1))
    same(first, second)
    at = first.astype(int)
    assert keep[at[:, 1], at[:, 0]].all()


@settings(max_examples=15, deadline=None)
@given(st.lists(masks(), min_size=3, max_size=3), st.sampled_from(list(SCENES)), st.integers(0, 50))
def test_a_tracker_depends_on_what_counts_alone(each: list[np.ndarray], dtype: type, seed: int) -> None:
    trackers = [rsflow.PointTracker(max_corners=60) for _ in range(2)]
    for number, keep in enumerate(each):
        frame = SCENES[dtype][number % 2]
        first, second = (
            tracker.update(covered(frame, keep, s + number), mask=keep)
            for tracker, s in zip(trackers, (seed, seed + 1), strict=True)
        )
        for name in ("points", "status", "covariance", "ids", "ages"):
            same(getattr(first, name), getattr(second, name))
        there = np.isin(first.status, (PointStatus.TRACKED, PointStatus.NEW))
        at = np.round(first.points[there]).astype(int)
        assert keep[at[:, 1], at[:, 0]].all()


@settings(max_examples=15, deadline=None)
@given(masks(), masks(), st.sampled_from(list(SCENES)), st.integers(0, 50))
def test_flow_is_not_given_where_nothing_counts(
    keep: np.ndarray, keep_next: np.ndarray, dtype: type, seed: int
) -> None:
    prev, after = SCENES[dtype]
    field = rsflow.dense_flow(
        covered(prev, keep, seed), covered(after, keep_next, seed + 7), preset="fast", mask=keep, next_mask=keep_next
    )
    assert np.isnan(field.uv[~keep]).all()
    assert np.isnan(field.residual[~keep]).all()
    assert not field.valid[~keep].any()
    y, x = np.nonzero(field.valid)
    to = np.round(np.stack([x, y], 1) + field.uv[field.valid]).astype(int)
    assert keep_next[to[:, 1], to[:, 0]].all()


@pytest.mark.parametrize("window", [9, 15, 21, 31])
def test_the_least_support_is_an_eighth_of_the_window(window: int) -> None:
    prev = SCENES[np.uint8][0]
    points = np.float32([(x, 48) for x in range(30, 100, 7)])
    for rows in range(2, window + 1):
        keep = np.zeros(SHAPE, bool)
        keep[48 - rows // 2 : 48 - rows // 2 + rows] = True
        tracks = rsflow.track_points(prev, prev, points, mask=keep, next_mask=keep, window_size=window)
        # A pixel counts where all do that its filters are made of: two rows at each side are lost.
        share = (rows - 4) / window
        if share < 1 / 8:
            # On two rows a coarse level may still lead a point over the mask's edge.
            assert np.isin(tracks.status, (PointStatus.LOW_SUPPORT, PointStatus.MASKED)).all()
            assert (tracks.status == PointStatus.LOW_SUPPORT).any()
        elif share > 0.4:
            assert tracks.valid.mean() > 0.8
            assert (tracks.status != PointStatus.LOW_SUPPORT).all()


@settings(max_examples=40, deadline=None)
@given(
    masks(),
    masks(),
    st.sampled_from(list(SCENES)),
    st.integers(0, 50),
    st.sampled_from(["ultrafast", "fast", "balanced", "accurate"]),
)
def test_dense_flow_depends_on_what_counts_alone(
    keep: np.ndarray, keep_next: np.ndarray, dtype: type, seed: int, preset: rsflow.Preset
) -> None:
    prev, after = SCENES[dtype]
    # The second pair of a stream: its first frame was the second one of another pair, with the other mask.
    stream = rsflow.DenseFlow(preset=preset, mask=keep, next_mask=keep_next)
    stream.update(covered(after, keep & keep_next, seed))
    stream.update(covered(prev, keep, seed))
    streamed = pickle.loads(pickle.dumps(stream)).update(covered(after, keep_next, seed + 7))
    pairs = [
        rsflow.dense_flow(
            covered(prev, keep, s), covered(after, keep_next, s + 7), preset=preset, mask=keep, next_mask=keep_next
        )
        for s in (seed, seed + 1)
    ]
    assert streamed is not None
    for field in (pairs[1], streamed):
        for name in ("uv", "valid", "residual", "gain", "offset"):
            same(getattr(pairs[0], name), getattr(field, name))
    assert np.isnan(field.uv[~keep]).all()
    assert np.isfinite(field.uv[keep]).all()
    error = np.hypot(*(field.uv - np.float32(MOTION)).transpose(2, 0, 1))[field.valid]
    assert (error > 1).mean() < 0.02 if error.size > 500 else True
