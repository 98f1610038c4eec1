"""Every public function, class and method with a table of odd values for each argument: only what is documented comes.

The callables are found by walking the package, so that a new one is called too; one without an entry in
`public_calls.CALLS` fails. What a call may end with stands in `judged`, and for users in
docs/explanation/conventions.md.
"""

from __future__ import annotations

import collections
import enum
import inspect
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import odd_values
import public_calls
import rsflow

# Built-in errors that may come as they are: of files, and of memory.
BUILT_IN = (FileNotFoundError, FileExistsError, IsADirectoryError, NotADirectoryError, PermissionError, MemoryError)

# Where an argument is called something else in the messages: what it is called where the user wrote it first, or which
# picture of a source it is.
ALIASES = {
    "rsflow.calibration.Board.size": ("board",),
    "rsflow.calibrate.images": ("images", ", frame "),
    "rsflow.check_scale.source": ("source", ", frame "),
    "rsflow.extract.source": ("source", ", frame "),
    "rsflow.live.readings.source": ("source", ", frame "),
    "rsflow.live.watch.source": ("source", ", frame "),
}

# Only `rsflow.frames` makes them, which checks the rest.
MADE_BY_US = {"rsflow.Frames": "reader"}

# Taken since OpenCV has them, and not looked at.
NOT_LOOKED_AT = {"pyramid", "pyrBorder", "derivBorder", "tryReuseInputImage", "status", "err", "corners", "flow"}

# A call that works takes seconds: their arguments are tested below, one value that is refused each.
LONG = {
    "rsflow.bench.measure",
    "rsflow.bench.measure_kinds",
    "rsflow.bench.measure_segmentation",
    "rsflow.bench.measure_velocity",
    "rsflow.reproduce.real_motion",
    "rsflow.velocity.plot_velocity",
}

# What these do when they are called is the caller's own; that they are functions is checked all the same.
FUNCTIONS = {
    "displacement", "lighting", "lighting_prev", "exposure_drift", "on_frame", "on_done", "on_view", "progress",
    "on_progress", "at_once",
}  # fmt: skip
# The same, where numbers are taken too, or several functions.
ALSO_FUNCTIONS = {
    *(f"rsflow.synthetic.{name}.{motion}" for name in ("flight", "flight_with_object")
      for motion in ("velocity_m_s", "rate_rad_s")),
    "rsflow.synthetic.flight.ground_effects",
}  # fmt: skip
CALLED = {"hostile", "type", "lambda", "error"}

# Values that are no number, and no whole one; what an annotation of one type alone must refuse.
NO_NUMBERS = ("True", "numpy True", "21", "numpy text", "bytes", "complex", "[1]", "NaT", "lambda", "2 x 3", "masked")
# What says that a value is not known, as instruments do in a loop, and is documented so.
MISSING = {f"rsflow.VelocityEstimator.update.{name}": ("inf", "-inf") for name in ("height_m", "range_m")}

REFUSED = {
    "int": (*NO_NUMBERS, "2.9", "nan", "inf", "numpy float", "0-d float", "10**5000"),
    "float": (*NO_NUMBERS, "inf", "-inf", "10**5000"),
    "bool": ("0", "1", "none", "21", "None", "[]", "numpy int", "lambda"),
}  # fmt: skip

CALLABLES = public_calls.public()


def parameters(name: str) -> list[inspect.Parameter]:
    """Give the parameters that a caller can name."""
    target = CALLABLES[name]
    if inspect.isclass(target) and issubclass(target, enum.Enum):
        return []
    if inspect.isclass(target) and issubclass(target, BaseException) and "__init__" not in vars(target):
        return []
    unnamed = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    given = inspect.signature(target).parameters.values()
    return [
        each
        for each in given
        if each.kind not in unnamed
        and each.name != "self"
        and each.name[0] != "_"
        and each.name not in NOT_LOOKED_AT
        and each.name in MADE_BY_US.get(name, each.name)
    ]


def is_record(target: Any) -> bool:
    """Whether this only holds what rsflow made: its fields are stored as they are."""
    return hasattr(target, "__dataclass_fields__") and not hasattr(target, "__post_init__")


def judged(name: str, argument: str, error: BaseException) -> str:
    """Say what is wrong with an error, or nothing."""
    text = str(error)
    if isinstance(error, rsflow.RsflowError):
        if isinstance(error, (rsflow.OptionError, rsflow.ShapeError, rsflow.DTypeError)):
            called = ALIASES.get(f"{name}.{argument}", (argument,))
            if not any(word in text for word in called):
                return f"does not name {called[0]}"
            if ": got " not in text and "cannot write" not in text:
                return "does not say what it got"
            if "\n" in text:
                return "has more lines than one"
        return "is too long" if len(text) > 8000 else ""
    if isinstance(error, BUILT_IN):
        return ""
    if isinstance(error, OSError) and error.errno:
        # The system's own word on a name: too long, say.
        return ""
    return "is not documented"


def outcome(call: Callable[[], Any]) -> BaseException | None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            call()
        except Exception as error:
            return error
    return None


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    public_calls.make_files(tmp_path)
    threads = rsflow.get_num_threads()
    with public_calls.OPENED:
        yield tmp_path
    rsflow.set_num_threads(threads)


def test_every_public_callable_has_arguments_to_be_called_with() -> None:
    missing, gone = set(CALLABLES) - set(public_calls.CALLS), set(public_calls.CALLS) - set(CALLABLES)
    assert not missing, f"no entry in public_calls.CALLS for {sorted(missing)}: add the arguments of a call that works"
    assert not gone, f"public_calls.CALLS has entries for what is not there: {sorted(gone)}"


@pytest.mark.parametrize("name", sorted(set(CALLABLES) - LONG))
def test_odd_values_end_in_a_result_or_in_a_documented_error(name: str, folder: Path) -> None:
    calls, wrong = 0, []
    for parameter in parameters(name):
        for odd, make in odd_values.VALUES.items():
            functions = parameter.name in FUNCTIONS or f"{name}.{parameter.name}" in ALSO_FUNCTIONS
            if functions and odd.strip("[]") in CALLED:
                continue
            function, arguments = public_calls.CALLS[name](folder)
            value = make(folder)
            calls += 1
            error = outcome(lambda: function(**{**arguments, parameter.name: value}))  # noqa: B023
            fault = "" if error is None else judged(name, parameter.name, error)
            if fault:
                wrong.append(f"{parameter.name}={odd}: {type(error).__name__} {fault}: {str(error)[:200]}")
            annotation = str(parameter.annotation).removesuffix(" | None")
            refused = odd in REFUSED.get(annotation, ()) and not (odd == "None" and annotation != parameter.annotation)
            missing = odd in MISSING.get(f"{name}.{parameter.name}", ())
            if error is None and refused and not missing and not is_record(CALLABLES[name]):
                wrong.append(f"{parameter.name}={odd}: taken for {annotation}")
    print(f"{calls} calls")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", sorted(LONG))
def test_what_takes_long_refuses_at_once(name: str, folder: Path) -> None:
    for parameter in parameters(name):
        for odd in ("words", "object", "nan frame"):
            function, arguments = public_calls.CALLS[name](folder)
            error = outcome(lambda: function(**{**arguments, parameter.name: odd_values.VALUES[odd](folder)}))  # noqa: B023
            assert error is not None
            assert not judged(name, parameter.name, error), f"{parameter.name}={odd}: {error!r}"


@pytest.mark.parametrize("name", sorted(CALLABLES))
def test_a_missing_or_unknown_argument_is_named(name: str, folder: Path) -> None:
    if not parameters(name):
        return
    function, arguments = public_calls.CALLS[name](folder)
    with pytest.raises((TypeError, rsflow.OptionError), match="no_such_argument"):
        function(**arguments, no_such_argument=1)
    for parameter in parameters(name):
        if parameter.default is inspect.Parameter.empty:
            with pytest.raises(TypeError, match=parameter.name):
                function(**{key: value for key, value in arguments.items() if key != parameter.name})


def test_the_calls_above_are_five_thousand_at_least() -> None:
    counts = collections.Counter({name: len(parameters(name)) for name in CALLABLES if name not in LONG})
    assert counts.total() * len(odd_values.VALUES) >= 5_000
