"""One check of each kind of argument: what it takes, what it refuses, and in which words."""

from __future__ import annotations

import warnings
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow import _checks, _core
from rsflow._checks import knobs

NO_NUMBER = {
    "None": None,
    "True": True,
    "numpy's True": np.True_,
    "an array of True": np.array(True),
    "text": "21",
    "numpy's text": np.str_("21"),
    "bytes": b"21",
    "a buffer": memoryview(b"2"),
    "complex": 1 + 0j,
    "numpy's complex": np.complex64(1),
    "a time": np.datetime64(1, "s"),
    "a duration": np.timedelta64(1),
    "an array": np.array([3]),
    "a masked number": np.ma.masked,
    "a list": [3],
    "an object": object(),
    "a type": int,
}


@pytest.mark.parametrize("case", NO_NUMBER)
def test_what_is_no_number_is_refused_as_number_and_as_integer(case: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for check in (_checks.number, _checks.integer):
            with pytest.raises(rsflow.OptionError, match=r"^knob: got .*, expected an? (finite number|integer)"):
                check("knob", NO_NUMBER[case])


@pytest.mark.parametrize(
    "value", [3, 3.0, np.int8(3), np.float16(3), np.array(3), np.array(3.0), Fraction(3), Decimal(3)]
)
def test_real_numbers_of_any_type_are_taken(value: object) -> None:
    assert _checks.number("knob", value) == 3.0
    assert type(_checks.number("knob", value)) is float


@pytest.mark.parametrize("value", [3, np.uint64(3), np.array(3), np.int8(3)])
def test_whole_numbers_of_any_type_are_taken(value: object) -> None:
    assert _checks.integer("knob", value) == 3
    assert type(_checks.integer("knob", value)) is int


@pytest.mark.parametrize(
    ("value", "bounds", "says"),
    [
        (float("nan"), {}, "got NaN, expected a finite number"),
        (float("-inf"), {"least": 0.0}, "got -inf, expected a finite number of at least 0"),
        (10**400, {}, "got an integer of 1329 bits, expected a finite number"),
        (0, {"above": 0.0, "of": "pixels"}, "got 0, expected a positive number of pixels"),
        (2, {"least": 0.0, "most": 1.0}, "got 2, expected a finite number from 0 to 1"),
        (1, {"below": 1.0}, "got 1, expected a finite number below 1"),
        (1e300, {"most": _checks.FLOAT32_MAX}, "got 1e+300, expected a finite number up to 3.4e+38"),
    ],
)
def test_numbers_outside_of_their_bounds(value: float, bounds: dict[str, float], says: str) -> None:
    with pytest.raises(rsflow.OptionError) as caught:
        _checks.number("knob", value, **bounds)
    assert str(caught.value) == f"knob: {says}"


@pytest.mark.parametrize(
    ("value", "bounds", "says"),
    [
        (2.9, {}, "got 2.9, expected an integer"),
        (2.0, {"least": 1}, "got 2.0, expected an integer of at least 1"),
        (0, {"least": 1, "most": 9}, "got 0, expected an integer from 1 to 9"),
        (10**30, {}, "got 1000000000000000000000000000000, expected an integer that fits into 64 bits"),
        (10, {"most": 9, "of": "levels"}, "got 10, expected an integer of levels of at most 9"),
    ],
)
def test_integers_outside_of_their_bounds(value: object, bounds: dict[str, int], says: str) -> None:
    with pytest.raises(rsflow.OptionError) as caught:
        _checks.integer("knob", value, **bounds)
    assert str(caught.value) == f"knob: {says}"


@pytest.mark.parametrize("value", [0, 1, "True", None, np.int8(1), np.array([True])])
def test_a_flag_is_true_or_false(value: object) -> None:
    with pytest.raises(rsflow.OptionError, match=r"^knob: got .*, expected True or False$"):
        _checks.flag("knob", value)
    assert _checks.flag("knob", np.array(True)) is True


@pytest.mark.parametrize(
    "value", ["1234", 7, (1, 2, 3), (1, 2, 3, 4.0), {1, 2, 3, 4}, (1, 2, 3, True), iter((1, 2, 3, 4))]
)
def test_a_region_is_four_integers(value: object) -> None:
    with pytest.raises(rsflow.OptionError, match=r"^roi: got .*, expected \(x, y, width, height\), four integers"):
        _checks.region("roi", value)
    assert _checks.region("roi", np.array([1, 2, 3, 4])) == (1, 2, 3, 4)


@pytest.mark.parametrize(
    ("value", "error"),
    [
        (None, rsflow.DTypeError),
        (b"a", rsflow.DTypeError),
        (3, rsflow.DTypeError),
        ("", rsflow.OptionError),
        ("a\0b", rsflow.OptionError),
    ],
)
def test_what_is_no_path(value: object, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"^path: got .*, expected a path"):
        _checks.path("path", value)
    assert _checks.path("path", Path("a")) == Path("a")


class Hostile:
    """An object whose own methods fail in each way that a check might call them."""

    def _fail(self, *_: object) -> object:
        raise ZeroDivisionError

    __repr__ = __str__ = __float__ = __index__ = __len__ = __iter__ = __array__ = __fspath__ = __bool__ = __eq__ = _fail  # type: ignore[assignment]
    __hash__ = None  # type: ignore[assignment]


def test_no_object_makes_a_check_fail_with_an_error_of_its_own() -> None:
    endless: list[object] = []
    endless.append(endless)
    for value in (Hostile(), [Hostile()], endless, "\ud800" * 1000, "\n", 10**10000, np.zeros(3, [("a", "i4")])):
        for check in (
            _checks.number, _checks.integer, _checks.flag, _checks.region, _checks.points, _checks.frame, _checks.mask,
            _checks.picture, lambda name, value: _checks.choice(name, value, ("a", "b")),
            lambda name, value: _checks.vector(name, value, 3, "three numbers"),
        ):  # fmt: skip
            with pytest.raises(rsflow.RsflowError) as caught:
                check("knob", value)
            assert str(caught.value).startswith("knob: got ")
            assert len(str(caught.value)) < 700
            assert "\n" not in str(caught.value)


BAD_FRAMES = [
    [[1, 2], [3, 4]], None, np.zeros((4, 5, 3), np.uint8), np.zeros((4,), np.uint8), np.zeros((2, 3, 4, 5), np.uint8),
    np.zeros((4, 5)), np.zeros((4, 5), bool), np.zeros((4, 5), object), np.zeros((4, 5), "U1"), np.zeros((4, 5), ">u2"),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(BAD_FRAMES)))
def test_a_frame_is_refused_in_the_words_of_the_core(number: int) -> None:
    with pytest.raises(rsflow.RsflowError) as here:
        _checks.frame("frame", BAD_FRAMES[number])
    with pytest.raises(rsflow.RsflowError) as there:
        _core.detect_corners(BAD_FRAMES[number], None, 1, 0.1, 1.0, 3, None)
    assert (type(here.value), str(here.value)) == (type(there.value), str(there.value))


@pytest.mark.parametrize("bad", [[[True]], np.ones((4, 5)), np.ones((4, 5, 1), bool), np.ones((5, 4), bool)])
def test_a_mask_is_refused_in_the_words_of_the_core(bad: object) -> None:
    frame = np.zeros((4, 5), np.uint8)
    with pytest.raises(rsflow.RsflowError) as here:
        _checks.mask("mask", bad, frame.shape)
    with pytest.raises(rsflow.RsflowError) as there:
        _core.detect_corners(frame, bad, 1, 0.1, 1.0, 3, None)
    assert (type(here.value), str(here.value)) == (type(there.value), str(there.value))


@pytest.mark.parametrize(
    ("check", "core"),
    [
        (lambda word: knobs.preset(word), lambda word: _core.DenseFlow(word, "none", None, False)),
        (lambda word: knobs.illumination(word), lambda word: _core.DenseFlow("fast", word, None, False)),
    ],
)
def test_a_word_is_refused_in_the_words_of_the_core(check, core) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(rsflow.OptionError) as here:
        check("best")
    with pytest.raises(rsflow.OptionError) as there:
        core("best")
    assert str(here.value) == str(there.value)


def test_a_masked_array_is_no_frame() -> None:
    frame = np.ma.masked_array(np.zeros((40, 50), np.uint8), mask=False)
    with pytest.raises(rsflow.DTypeError, match="prev: got a masked array"):
        rsflow.estimate_shift(frame, frame)
    with pytest.raises(rsflow.DTypeError, match="points: got masked array"):
        rsflow.track_points(frame.data, frame.data, np.ma.masked_array([[1.0, 2.0]]))


ESTIMATORS = {
    "shift": lambda frame, **knobs: rsflow.estimate_shift(frame, frame, **knobs),
    "dense": lambda frame, **knobs: rsflow.dense_flow(frame, frame, **knobs),
    "dense stream": lambda frame, **knobs: rsflow.DenseFlow(**knobs),
    "points": lambda frame, **knobs: rsflow.track_points(frame, frame, [], **knobs),
    "point stream": lambda frame, **knobs: rsflow.PointTracker(**knobs),
    "segments": lambda frame, **knobs: rsflow.MotionSegmenter(**knobs),
    "extraction": lambda frame, **knobs: rsflow.extract([frame], "out", **knobs),
    "live": lambda frame, **knobs: rsflow.live.readings([frame], **knobs),
}


@pytest.mark.parametrize("knob", ["max_displacement", "illumination"])
@pytest.mark.parametrize(
    "value", [0, -1, float("nan"), float("inf"), "21", True, b"1", 1e300, 1e-60, [3], "best", "None", None]
)
def test_a_knob_fails_the_same_in_every_estimator(
    knob: str, value: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if knob == "max_displacement" and value is None:
        return
    said = set()
    for name, call in ESTIMATORS.items():
        with pytest.raises(rsflow.OptionError, match=f"^{knob}: got .*, expected ") as caught:
            call(np.zeros((40, 50), np.uint8), **{knob: value})
        said.add(str(caught.value))
        assert len(said) == 1, (name, said)
    assert list(tmp_path.iterdir()) == []
