"""Dense flow from Python: the contract, the inputs it takes and refuses, and what the result can do."""

from __future__ import annotations

import itertools
import threading

import numpy as np
import pytest
from numpy.typing import NDArray

import rsflow


def scene(u: float = 0.0, v: float = 0.0, shape: tuple[int, int] = (120, 160)) -> NDArray[np.uint8]:
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float64)
    x, y = x - u, y - v
    coarse = 30 * np.sin(0.055 * x + 0.043 * y) + 30 * np.cos(0.048 * y - 0.037 * x)
    fine = (
        18 * np.sin(0.31 * x + 0.12 * y) + 15 * np.cos(0.27 * y - 0.18 * x) + 12 * np.cos(0.61 * x) * np.sin(0.53 * y)
    )
    return np.round(120 + coarse + fine).astype(np.uint8)


def error(field: rsflow.FlowField, u: float, v: float) -> float:
    difference = field.uv[8:-8, 8:-8] - np.float32([u, v])
    return float(np.hypot(difference[..., 0], difference[..., 1]).mean())


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "balanced", "accurate"])
@pytest.mark.parametrize("illumination", ["none", "offset", "gain_offset"])
def test_shift_is_found(preset: str, illumination: str) -> None:
    field = rsflow.dense_flow(scene(), scene(3.4, -2.2), preset=preset, illumination=illumination)  # type: ignore[arg-type]
    assert field.uv.shape == (120, 160, 2)
    assert field.uv.dtype == np.float32
    assert field.valid.dtype == np.bool_
    assert field.valid.shape == field.residual.shape == (120, 160)
    assert error(field, 3.4, -2.2) < 0.08
    assert field.valid.mean() > 0.8
    np.testing.assert_allclose(field.mean(), [3.4, -2.2], atol=0.05)


def test_light_changes_nothing_and_is_reported() -> None:
    bright = np.round(0.8 * scene(1.5, 1.0) + 20).astype(np.uint8)
    field = rsflow.dense_flow(scene(), bright)
    assert error(field, 1.5, 1.0) < 0.08
    assert field.gain.shape == field.offset.shape == (120, 160)
    assert field.gain.dtype == field.offset.dtype == np.float32
    assert abs(float(np.median(field.gain)) - 0.8) < 0.06
    assert abs(float(np.median(field.offset)) - 20) < 8
    steady = rsflow.dense_flow(scene(), scene(), illumination="offset")
    assert (steady.gain == 1).all()
    assert (steady.offset == 0).all()


def test_result_is_an_array_of_displacements() -> None:
    field = rsflow.dense_flow(scene(), scene(1.5, 0.5))
    assert np.asarray(field) is field.uv
    assert np.array(field) is not field.uv
    assert np.asarray(field, np.float64).dtype == np.float64
    np.testing.assert_allclose(field.magnitude, np.hypot(field.uv[..., 0], field.uv[..., 1]))
    np.testing.assert_allclose(field.angle, np.arctan2(field.uv[..., 1], field.uv[..., 0]))


def test_warp_brings_next_to_prev() -> None:
    prev, following = scene(), scene(2.5, -1.5)
    field = rsflow.dense_flow(prev, following)
    warped = field.warp(following)
    assert warped.dtype == np.uint8
    inside = (slice(8, -8), slice(8, -8))
    assert np.abs(warped[inside].astype(float) - prev[inside]).mean() < 1.5
    colour = field.warp(np.dstack([following] * 3))
    assert (colour[..., 1] == warped).all()
    floats = field.warp(following.astype(np.float32))
    assert np.isnan(floats[:, -1]).any()
    assert not np.isnan(floats[inside]).any()
    assert field.warp(following[..., None]).shape == (120, 160, 1)


def test_warp_refuses_what_does_not_fit() -> None:
    field = rsflow.dense_flow(scene(), scene())
    with pytest.raises(rsflow.ShapeError, match=r"frame: got shape \(4, 5\), expected the flow's \(120, 160\)"):
        field.warp(np.zeros((4, 5)))
    with pytest.raises(rsflow.DTypeError, match="frame: got dtype int32, expected uint8"):
        field.warp(np.zeros((120, 160), np.int32))


def test_mean_without_a_valid_pixel_is_nan() -> None:
    field = rsflow.dense_flow(np.zeros((40, 50), np.uint8), np.zeros((40, 50), np.uint8))
    assert not field.valid.any()
    assert np.isnan(field.mean()).all()


def test_save_and_read(tmp_path) -> None:
    field = rsflow.dense_flow(scene(), scene(1.5, 0.5))
    field.save(tmp_path / "flow.npy")
    again = rsflow.read_flow(tmp_path / "flow.npy")
    np.testing.assert_array_equal(again[field.valid], field.uv[field.valid])
    assert np.isnan(again[~field.valid]).all()


def test_plot_draws_the_field() -> None:
    field = rsflow.dense_flow(scene(), scene(1.5, 0.5))
    picture = field.plot(scene())
    assert np.asarray(picture).ndim == 3


def test_a_sequence_gives_what_pairs_give() -> None:
    frames = [scene(1.2 * k, -0.4 * k) for k in range(4)]
    flow = rsflow.DenseFlow(preset="fast")
    assert flow.update(frames[0]) is None
    for before, frame in itertools.pairwise(frames):
        field = flow.update(frame)
        assert field is not None
        pair = rsflow.dense_flow(before, frame, preset="fast")
        np.testing.assert_array_equal(field.uv, pair.uv)
        np.testing.assert_array_equal(field.valid, pair.valid)
    flow.reset()
    assert flow.update(frames[0]) is None


def test_a_frame_of_another_size_is_refused_and_the_next_is_a_first_one() -> None:
    flow = rsflow.DenseFlow(preset="fast")
    flow.update(scene())
    with pytest.raises(
        rsflow.ShapeError, match=r"frame: got \(60, 160\), expected the shape of the frames before, \(120, 160\)"
    ):
        flow.update(scene()[:60])
    assert flow.update(scene()[:60]) is None


def test_threads_change_nothing() -> None:
    prev, following = scene(), scene(3.4, -2.2)
    before = rsflow.get_num_threads()
    try:
        fields = []
        for threads in (1, 2, 7):
            rsflow.set_num_threads(threads)
            fields.append(rsflow.dense_flow(prev, following))
    finally:
        rsflow.set_num_threads(before)
    for field in fields[1:]:
        np.testing.assert_array_equal(field.uv, fields[0].uv)
        np.testing.assert_array_equal(field.residual, fields[0].residual)


def test_one_object_serves_many_threads() -> None:
    want = rsflow.dense_flow(scene(), scene(1.5, 0.5), preset="fast").uv
    results: list[NDArray[np.float32]] = []

    def work() -> None:
        results.append(rsflow.dense_flow(scene(), scene(1.5, 0.5), preset="fast").uv)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 4
    assert all((result == want).all() for result in results)


def test_initial_and_mask() -> None:
    prev, following = scene(), scene(25, -18)
    start = np.broadcast_to(np.float64([24, -17]), (120, 160, 2))
    field = rsflow.dense_flow(prev, following, initial=start)
    assert np.abs(field.uv[70, 60] - [25, -18]).max() < 0.1
    again = rsflow.dense_flow(prev, following, initial=field)
    assert np.abs(again.uv[70, 60] - [25, -18]).max() < 0.1
    mask = np.zeros((120, 160), np.bool_)
    mask[20:100, 20:140] = True
    field = rsflow.dense_flow(prev, scene(1.5, 0.5), mask=mask)
    assert np.isnan(field.uv[~mask]).all()
    assert not field.valid[~mask].any()
    assert np.abs(field.uv[60, 80] - [1.5, 0.5]).max() < 0.1


def test_what_moves_to_where_the_next_mask_is_false_is_not_valid() -> None:
    prev, following = scene(), scene(5.0, 0.0)
    counts = np.ones((120, 160), np.bool_)
    counts[40:80, 60:100] = False
    following = np.where(counts, following, 200).astype(following.dtype)
    field = rsflow.dense_flow(prev, following, next_mask=counts)
    assert np.abs(field.uv[60, 40] - [5, 0]).max() < 0.1
    assert field.valid[60, 40]
    # Where the mask is False the frame before shows what goes there from 5 pixels to the left.
    assert not field.valid[42:78, 57:93].any()
    assert not np.isnan(field.uv).any()
    stream = rsflow.DenseFlow(next_mask=counts)
    stream.update(prev)
    again = stream.update(following)
    np.testing.assert_array_equal(again.valid, field.valid)
    np.testing.assert_array_equal(again.uv, field.uv)
    everywhere = rsflow.dense_flow(prev, following, next_mask=np.ones_like(counts))
    np.testing.assert_array_equal(everywhere.valid, rsflow.dense_flow(prev, following).valid)


def test_small_and_empty_frames_are_answered() -> None:
    for shape in [(0, 0), (0, 5), (1, 1), (1, 30), (2, 2), (9, 300)]:
        field = rsflow.dense_flow(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))
        assert field.uv.shape == (*shape, 2)
        assert not field.valid.any()
        assert field.gain.shape == shape


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"preset": "slow"}, rsflow.OptionError, 'preset: got "slow", expected "ultrafast", "fast"'),
        ({"preset": 1}, rsflow.OptionError, 'preset: got 1, expected "ultrafast"'),
        ({"illumination": "gamma"}, rsflow.OptionError, 'illumination: got "gamma"'),
        ({"max_displacement": -1}, rsflow.OptionError, "max_displacement: got -1, expected a positive number"),
        ({"max_displacement": "far"}, rsflow.OptionError, 'max_displacement: got "far", expected a positive number'),
        ({"mask": np.ones((120, 160))}, rsflow.DTypeError, "mask: got dtype float64"),
        ({"mask": np.ones((3, 4), bool)}, rsflow.ShapeError, r"mask: got shape \(3, 4\)"),
        ({"next_mask": np.ones((120, 160))}, rsflow.DTypeError, "next_mask: got dtype float64"),
        ({"next_mask": np.ones((3, 4), bool)}, rsflow.ShapeError, r"next_mask: got shape \(3, 4\)"),
        ({"initial": np.zeros((120, 160))}, rsflow.ShapeError, r"initial: got shape \(120, 160\)"),
        (
            {"initial": np.zeros((12, 16, 2))},
            rsflow.ShapeError,
            r"initial: got \(12, 16, 2\), expected \(120, 160, 2\)",
        ),
        ({"initial": np.zeros((120, 160, 2), complex)}, rsflow.DTypeError, "initial: got dtype complex128"),
        ({"next": np.zeros((3, 4), np.uint8)}, rsflow.ShapeError, r"next: got \(3, 4\), expected the shape of prev"),
        ({"next": np.zeros((120, 160), np.uint16)}, rsflow.DTypeError, "next: got dtype uint16, expected that of prev"),
        ({"prev": np.zeros((120, 160, 3), np.uint8)}, rsflow.ShapeError, "prev: got colour"),
        ({"prev": np.zeros((120, 160))}, rsflow.DTypeError, "prev: got dtype float64"),
        ({"prev": [[1, 2], [3, 4]]}, rsflow.DTypeError, "prev: got list, expected a numpy array"),
    ],
)
def test_misuse_is_refused(arguments: dict, error: type[Exception], message: str) -> None:
    arguments = {"prev": scene(), "next": scene(), **arguments}
    with pytest.raises(error, match=message):
        rsflow.dense_flow(arguments.pop("prev"), arguments.pop("next"), **arguments)


def test_memory_of_large_pairs_is_kept_from_the_second_in_a_row_on() -> None:
    small, large = 640 * 480, 3840 * 2160

    def core(pixels: int) -> object:
        return rsflow.flow.dense._kept_core(("fast", "gain_offset", None, False), pixels)

    assert core(small) is core(small)
    kept = core(small)
    lone = core(large)
    assert core(small) is kept
    first, second, third = core(large), core(large), core(large)
    assert lone is not first
    assert first is not second
    assert second is third
    assert core(large + 1) is not third
    assert core(large) is not third
