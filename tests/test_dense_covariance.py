"""How far dense flow may be off: as often as it says, on photographs by kind of motion, light and noise."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import rsflow
from test_dense_kinds import KINDS, SIZE, pair, photograph, steady, turned

PHOTOGRAPHS = ("camera", "coffee", "astronaut", "gravel")


def inside_of(kind: str, preset: rsflow.Preset) -> tuple[float, float]:
    """Share of the valid pixels, both axes alike, that are within one deviation and within two."""
    matrix, light, noise, _ = KINDS[kind]
    shares = []
    for name in PHOTOGRAPHS:
        prev, after, truth, inside = pair(photograph(name), matrix, light, noise)
        field = rsflow.dense_flow(prev, after, preset=preset, covariance=True)
        assert field.covariance is not None
        where = field.valid & inside
        deviation = np.sqrt(field.covariance[where][:, [0, 1], [0, 1]])
        over = np.abs((field.uv - truth)[where]) / deviation
        shares.append(((over < 1).mean(), (over < 2).mean()))
    one, two = np.mean(shares, axis=0)
    return float(one), float(two)


@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_within_their_deviations_as_often_as_they_should(kind: str) -> None:
    one, two = inside_of(kind, "balanced")
    # A whole picture that moves by the same part of a pixel is off by the same everywhere: it has the fewest.
    assert 0.5 < one < 0.83, one
    assert 0.82 < two < 0.99, two


@pytest.mark.parametrize("preset", ["fast", "accurate"])
@pytest.mark.parametrize("kind", ["shift of 12 pixels", "turn", "noise", "blur"])
def test_other_presets_say_it_too(kind: str, preset: rsflow.Preset) -> None:
    one, two = inside_of(kind, preset)
    assert 0.52 < one < 0.85, one
    assert 0.84 < two < 0.995, two


def test_it_is_given_where_asked_for_and_infinite_where_nothing_is_valid() -> None:
    prev, after, _, _ = pair(photograph("coffee"), turned(1, 1, 2, 1), steady, 1)
    assert rsflow.dense_flow(prev, after).covariance is None
    mask = np.ones(SIZE, np.bool_)
    mask[50:90, 60:200] = False
    plain = rsflow.dense_flow(prev, after, mask=mask)
    field = rsflow.dense_flow(prev, after, mask=mask, covariance=True)
    assert np.array_equal(plain.uv, field.uv, equal_nan=True)
    assert np.array_equal(plain.valid, field.valid)
    assert field.covariance is not None
    assert field.covariance.shape == (*SIZE, 2, 2)
    assert field.covariance.dtype == np.float32
    assert np.isnan(field.covariance[~mask]).all()
    diagonal = field.covariance[..., [0, 1], [0, 1]]
    assert np.isinf(diagonal[mask & ~field.valid]).all()
    own = field.covariance[field.valid]
    assert np.array_equal(own[:, 0, 1], own[:, 1, 0])
    assert (np.linalg.eigvalsh(own.astype(float)) > 0).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (2, 2), (3, 5), (17, 9), (33, 64)])
def test_frames_of_any_size_have_one(size: tuple[int, int]) -> None:
    frame = np.random.default_rng(1).integers(0, 256, size).astype(np.uint8)
    field = rsflow.dense_flow(frame, frame, covariance=True)
    assert field.covariance is not None
    assert field.covariance.shape == (*size, 2, 2)
    assert np.isfinite(field.covariance[field.valid]).all()


def test_streams_and_threads_give_the_same_one() -> None:
    prev, after, _, _ = pair(photograph("camera"), turned(1, 1, 2, 1), steady, 1)
    fields = []
    threads = rsflow.get_num_threads()
    try:
        for count in (1, 3):
            rsflow.set_num_threads(count)
            fields.append(rsflow.dense_flow(prev, after, covariance=True))
    finally:
        rsflow.set_num_threads(threads)
    stream = rsflow.DenseFlow(covariance=True)
    stream.update(prev)
    fields.append(pickle.loads(pickle.dumps(stream)).update(after))
    for field in fields:
        assert field is not None
        assert field.covariance is not None
        assert field.covariance.tobytes() == fields[0].covariance.tobytes()


def test_an_odd_flag_is_refused() -> None:
    with pytest.raises(rsflow.OptionError, match="covariance"):
        rsflow.DenseFlow(covariance="yes")


@pytest.mark.parametrize("size", [(7, 7), (12, 12), (16, 16), (17, 17), (30, 40), (12, 300)])
def test_frames_too_small_to_tell_are_not_surer(size: tuple[int, int]) -> None:
    prev, after, truth, _ = pair(photograph("gravel"), turned(0, 1, 1.3, -0.7), steady, 2)
    over = []
    for k in range(30):
        top, left = 20 + 10 * k, 20 + (0 if size[1] > 200 else 12 * k)
        rows, columns = slice(top, top + size[0]), slice(left, left + size[1])
        field = rsflow.dense_flow(prev[rows, columns], after[rows, columns], covariance=True)
        assert field.covariance is not None
        deviation = np.sqrt(field.covariance[field.valid][:, [0, 1], [0, 1]])
        over.append((np.abs(field.uv - truth[rows, columns])[field.valid] / deviation).ravel())
    all_over = np.concatenate(over)
    assert (all_over < 2).mean() > 0.7, (all_over < 2).mean()
    assert (all_over > 5).mean() < 0.1, (all_over > 5).mean()


def test_bands_and_stripes_that_count_have_one() -> None:
    prev, after, truth, _ = pair(photograph("camera"), turned(0, 1, 1.3, -0.7), steady, 1)
    masks = np.zeros((3, *SIZE), np.bool_)
    masks[0, 100:140] = True
    masks[1] = True
    masks[1, :, ::24] = False
    masks[2, 100:180, 120:200] = True
    for mask in masks:
        field = rsflow.dense_flow(prev, after, mask=mask, covariance=True)
        assert field.covariance is not None
        assert field.valid.sum() > 1000
        deviation = np.sqrt(field.covariance[field.valid][:, [0, 1], [0, 1]])
        assert np.isfinite(deviation).all()
        # A patch that stands alone is surer than it should be.
        assert (np.abs(field.uv - truth)[field.valid] < 2 * deviation).mean() > 0.65
