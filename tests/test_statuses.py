"""Statuses: a number or word to compute and compare with, a name in print, a sentence for each."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest

import rsflow
from rsflow import _core
from rsflow._results.status import Status, WordStatus
from rsflow.batch import BatchStatus

NUMBERS = (rsflow.ShiftStatus, rsflow.PointStatus, rsflow.GridStatus, rsflow.VelocityStatus, rsflow.FilterStatus)
WORDS = (rsflow.SegmentationStatus, BatchStatus)
VALID = ("VALID", "TRACKED", "MEASURED", "OK", "DONE")


@pytest.mark.parametrize(
    ("status", "told"),
    [
        (rsflow.ShiftStatus, _core.shift_statuses),
        (rsflow.PointStatus, _core.point_statuses),
        (rsflow.GridStatus, _core.grid_statuses),
    ],
)
def test_statuses_are_those_of_lk_core(status, told):
    assert [(member.word, int(member)) for member in status] == told()


def test_the_statuses_of_velocity_keep_their_values():
    """Of no Rust: files and callers hold them."""
    names = "OK FIRST_FRAME TIME_NOT_INCREASING NO_TEXTURE SCENE_CUT TOO_FEW_POINTS INCONSISTENT NO_HEIGHT NO_GROUND "
    names += "REPEATED_FRAME TWO_MOTIONS AMBIGUOUS"
    assert [member.name for member in rsflow.VelocityStatus] == names.split()
    assert [int(member) for member in rsflow.VelocityStatus] == list(range(12))


@pytest.mark.parametrize("status", NUMBERS)
def test_a_numbered_status_prints_its_name_and_counts_as_its_number(status):
    assert issubclass(status, Status)
    for number, member in enumerate(status):
        name = member.name
        assert (str(member), f"{member}", f"{member:>20}", f"{member!s}") == (name, name, f"{name:>20}", name)
        assert repr(member) == f"<{status.__name__}.{name}: {number}>"
        assert (f"{member:d}", f"{member:03d}", member + 1, member == number) == (
            f"{number}",
            f"{number:03d}",
            number + 1,
            True,
        )
        assert status(number) is member
        assert status[name] is member
        assert json.dumps(member) == str(number)
    values = np.array(list(status))
    assert values.dtype.kind == "i"
    assert values.tolist() == list(range(len(status)))


@pytest.mark.parametrize("status", WORDS)
def test_a_status_of_words_is_equal_to_its_word_and_prints_it(status):
    assert issubclass(status, WordStatus)
    for member in status:
        assert (member == member.name.lower(), member.word, str(member)) == (True, member.value, member.value)
        assert f"{member:>20}" == f"{member.value:>20}"
        assert json.dumps(member) == f'"{member.value}"'
        assert status(member.value) is member


@pytest.mark.parametrize("status", [*NUMBERS, *WORDS])
def test_each_member_says_what_it_is(status):
    told = [member.__doc__ for member in status]
    assert len(set(told)) == len(status)
    assert all(len(text) > 4 and text.endswith(".") and text != status.__doc__ for text in told)
    assert all(member.explanation and not member.explanation.endswith(".") for member in status)
    assert [member.name for member in status if member.valid] == [next(iter(status)).name]
    assert next(iter(status)).name in VALID
    for member in status:
        assert pickle.loads(pickle.dumps(member)) is member
        assert copy.deepcopy(member) is member


def test_results_hold_statuses():
    pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
    shift = rsflow.estimate_shift(pair.prev, pair.next)
    assert shift.status is rsflow.ShiftStatus.VALID
    assert shift.status.valid
    tracks = rsflow.track_points(pair.prev, pair.next, [(48, 32), (500, 10)])
    assert [str(rsflow.PointStatus(number)) for number in tracks.status] == ["TRACKED", "OUT_OF_FRAME"]
    assert rsflow.MotionSegmenter().update(pair.prev).status is rsflow.SegmentationStatus.FIRST_FRAME
