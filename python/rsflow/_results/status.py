"""The one base of every status: what became of a frame, a point, a window or a job, and why."""

from __future__ import annotations

import enum
from typing import Self

__all__ = ["Status", "WordStatus"]

# Formats of a number: f"{status:d}" stays the value.
_NUMERIC = "bcdeEfFgGnoxX%"


class _Described(enum.Enum):
    """What every status has; the first member of each is the one that says that the result holds."""

    @property
    def valid(self) -> bool:
        """Whether the result holds: the first member alone says so."""
        return self is next(iter(type(self)))

    @property
    def explanation(self) -> str:
        """The status in a sentence without a full stop, as it stands in a message after a colon."""
        first = " ".join((self.__doc__ or "").split()).split(". ")[0].rstrip(".")
        return first[:1].lower() + first[1:]


class Status(_Described, enum.IntEnum):
    """A status that is a number in arrays and a name in print; each member is ``value, "what it says"``.

    Examples
    --------
    >>> class Weather(Status):
    ...     DRY = 0, "No rain."
    ...     WET = 1, "Rain. Take a coat."
    >>> print(Weather.WET, f"{Weather.WET}", f"{Weather.WET:d}", Weather.WET + 1)
    WET WET 1 2
    >>> Weather.WET
    <Weather.WET: 1>
    >>> Weather.DRY.valid, Weather.WET.valid, Weather(1).explanation, Weather.WET.__doc__
    (True, False, 'rain', 'Rain. Take a coat.')
    """

    def __new__(cls, value: int, says: str = "") -> Self:
        self = int.__new__(cls, value)
        self._value_ = value
        self.__doc__ = says
        return self

    @property
    def word(self) -> str:
        """The name in lower case, as tables have it."""
        return self.name.lower()

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        return format(int(self), spec) if spec and spec[-1] in _NUMERIC else format(self.name, spec)


class WordStatus(_Described, enum.StrEnum):
    """A status that is a word, in files and in comparisons; each member is ``word, "what it says"``.

    Examples
    --------
    >>> class Job(WordStatus):
    ...     DONE = "done", "Done."
    ...     FAILED = "failed", "Nothing is kept."
    >>> print(Job.FAILED, Job.FAILED == "failed", Job("done").valid, Job.FAILED.explanation)
    failed True True nothing is kept
    """

    def __new__(cls, value: str, says: str = "") -> Self:
        self = str.__new__(cls, value)
        self._value_ = value
        self.__doc__ = says
        return self

    @property
    def word(self) -> str:
        """The status itself, as tables have it."""
        return str(self.value)
