"""What is said where nothing is left of a source to measure: the same for every command."""

from __future__ import annotations

from ..errors import CaptureError
from .stream import Frames

__all__ = ["expect_range", "nothing_to_measure", "too_few"]


def expect_range(stream: Frames) -> None:
    """Raise `nothing_to_measure` where start and stop leave no frame, whatever the source holds."""
    if stream._stop is not None and stream._stop <= stream._start:
        raise nothing_to_measure(stream)


def nothing_to_measure(stream: Frames) -> CaptureError:
    """Give the error for a source of which no frame was taken, after it was read to its end."""
    return CaptureError(f"{_has(stream)}, and none is left by {_limits(stream)}: nothing to measure")


def too_few(stream: Frames, taken: int) -> CaptureError:
    """Give the error for a source of which only one frame was taken, where a motion needs two; or none."""
    if taken == 0:
        return nothing_to_measure(stream)
    if (stream._start, stream._stop, stream._stride) == (0, None, 1):
        return CaptureError(f"{_has(stream)}, expected at least two: a motion is from one to the next")
    return CaptureError(
        f"{_has(stream)}, and {taken} is left by {_limits(stream)}, expected at least two: a motion is from one to the "
        "next"
    )


def _limits(stream: Frames) -> str:
    limits = [f"start={stream._start}"] + ([] if stream._stop is None else [f"stop={stream._stop}"])
    limits += [f"stride={stream._stride}"] if stream._stride != 1 else []
    return ", ".join(limits)


def _has(stream: Frames) -> str:
    """Say how many frames the source has, or what is known of that."""
    read, promised = stream._position, stream._reader.count
    if read == 0 or (stream._stop is not None and read >= stream._stop):
        # Not read to its end.
        if promised is None:
            return f"of {stream.source} " + (f"the first {read} frames were read" if read else "nothing was read")
        read = promised
    return f"{stream.source} has {read} frame{'' if read == 1 else 's'}"
