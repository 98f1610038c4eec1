"""What every kind of source gives to `rsflow.frames`: one picture after the other, with time and number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias

from numpy.typing import NDArray

__all__ = ["Raw", "Reader", "Timestamps"]

Timestamps: TypeAlias = Literal["file", "given", "rate", "clock", "none"]


@dataclass(frozen=True, slots=True)
class Raw:
    """What a reader gives: the picture as the source has it (None where it was skipped), its time and number.

    `gaps` is how often a live source was away before it.
    """

    image: NDArray[Any] | None
    t_s: float
    index: int
    name: str = ""
    gaps: int = 0


class Reader(Protocol):
    """One kind of source. `read` gives the next frame, or None at the end, or raises `CaptureError`.

    `exact` says whether `count` is counted rather than a container's estimate.
    """

    source: str
    size: tuple[int, int] | None
    frame_rate: float | None
    count: int | None
    timestamps: Timestamps
    live: bool
    exact: bool

    @property
    def lost(self) -> int:
        """Pictures that the source has and the decoder could not give, of those read so far."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Peculiarities that were mended."""

    def read(self, wanted: bool) -> Raw | None:
        """Give the next frame; its picture may be None where it is not wanted."""

    def close(self) -> None:
        """Release the source; harmless when repeated."""
