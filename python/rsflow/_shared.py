"""Objects with a state that several threads share: one call at a time, and copies and pickles that go on alike."""

from __future__ import annotations

import copy
import functools
import os
import threading
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Concatenate, ParamSpec, Self, TypeVar, cast

from .errors import FormatError, RsflowError

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")
_Owner = TypeVar("_Owner", bound="Shared")

_LOCK = "_shared_lock"


class _Lock:
    """A lock of one process; `calls` are those that hold it, one within the other."""

    def __init__(self) -> None:
        self.process = os.getpid()
        self.calls = 0
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()
        self.calls += 1

    def __exit__(self, *_: object) -> None:
        self.calls -= 1
        self._lock.release()


# Held while an object gets its lock. A child of a fork has one of its own: a thread that stayed in the parent may hold
# the other.
_making = threading.Lock()


def _renew() -> None:
    global _making
    _making = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)


def alone(
    method: Callable[Concatenate[_Owner, _Arguments], _Result],
) -> Callable[Concatenate[_Owner, _Arguments], _Result]:
    """Let a method of a `Shared` object wait until no other thread is in one."""

    @functools.wraps(method)
    def waits(self: _Owner, *args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        with self._lock():
            return method(self, *args, **kwargs)

    return cast("Callable[Concatenate[_Owner, _Arguments], _Result]", waits)


def anew(method: Callable[[_Owner], None]) -> Callable[[_Owner], None]:
    """Let a method that forgets everything wait likewise, but for a thread that a fork has left behind."""

    @functools.wraps(method)
    def waits(self: _Owner) -> None:
        with self._lock(lost=False):
            method(self)

    return waits


class Shared:
    """Base of objects with a state; its attributes are what is copied and pickled.

    A class counts its `_state_version` up where an older state would be misread, and names in `_state_types` the
    attributes that no state may lack, with their types: a damaged one is told when it is loaded.
    """

    _state_version = 1
    _state_types: ClassVar[Mapping[str, tuple[type, ...]]] = {}

    def _lock(self, *, lost: bool = True) -> _Lock:
        """Give the lock of this object; an error if a fork has `lost` the thread that holds it."""
        lock = self.__dict__.get(_LOCK)
        if lock is None or lock.process != os.getpid():
            with _making:
                lock = self.__dict__.get(_LOCK)
                if lock is not None and lock.process != os.getpid() and lock.calls and lost:
                    raise RsflowError(
                        "this object was in a call when the process was forked, and that call does not end here: "
                        "make a new one, or reset() this one, which then begins anew"
                    )
                if lock is None or lock.process != os.getpid():
                    lock = self.__dict__[_LOCK] = _Lock()
        assert isinstance(lock, _Lock)
        return lock

    def __getstate__(self) -> dict[str, Any]:
        with self._lock():
            state = {name: value for name, value in self.__dict__.items() if name != _LOCK}
            return {"version": self._state_version, "state": self._packed(state)}

    def __setstate__(self, state: object) -> None:
        name = type(self).__name__
        if not isinstance(state, dict) or not isinstance(state.get("state"), dict):
            raise FormatError(f"the state of a {name} is damaged: got {type(state).__name__}")
        if state.get("version") != self._state_version:
            raise FormatError(
                f"the state of a {name} is of version {state.get('version')}, expected {self._state_version}"
            )
        try:
            attributes = self._unpacked(state["state"])
            for part, types in self._state_types.items():
                if part not in attributes:
                    raise FormatError(f"the state of a {name} is damaged: it lacks {part!r}")
                if not isinstance(attributes[part], types):
                    raise FormatError(
                        f"the state of a {name} is damaged: {part!r} is of type {type(attributes[part]).__name__}"
                    )
            self.__dict__.update(attributes)
        except RsflowError:
            raise
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise FormatError(f"the state of a {name} is damaged: {error}") from error

    def __copy__(self) -> Self:
        """Give a copy that goes on by itself: no two objects share what a state holds."""
        return copy.deepcopy(self)

    def _packed(self, state: dict[str, Any]) -> dict[str, Any]:
        """Give the attributes as what pickles."""
        return state

    def _unpacked(self, state: dict[str, Any]) -> dict[str, Any]:
        """Give the attributes from what `_packed` gave."""
        return state
