"""Joining the parts of a video, one after the other: their packets as they are, where PyAV is there."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from ..io.atomic import Working
from ..io.native_names import native_name
from . import sinks

__all__ = ["Part", "join"]


@dataclass(frozen=True)
class Part:
    """One piece of a video: its file, its number of pictures, and where its first one stands in ticks of the clock."""

    path: Path
    frames: int
    tick: int


def join(parts: Sequence[Part], target: Path, *, codec: str, library: str, frame_rate: float) -> None:
    """Write the parts as one video; `library` and `codec` are those that the parts were written with.

    Raises
    ------
    OSError
        If it cannot be written, or a part cannot be read; nothing is left under the final name then.
    """
    file = Working(target)
    try:
        if library == "av":
            _remuxed(parts, file.path)
        else:
            _encoded_again(parts, file.path, codec, Fraction(frame_rate).limit_denominator(1001))
        file.keep()
    except BaseException:
        file.discard()
        raise


def _remuxed(parts: Sequence[Part], target: Path) -> None:
    """Copy the packets with their times moved on."""
    import av

    times = [_times(part) for part in parts]
    delay = max(_delay(*pair) for pair in times)
    shown = np.sort(np.concatenate([pts for pts, _ in times]))
    # Decoding times are the times of showing, `delay` pictures earlier: before the first one at its own distance.
    step = int(shown[1] - shown[0]) if len(shown) > 1 else sinks.CLOCK // 25
    decoded = np.concatenate([shown[0] - step * np.arange(delay, 0, -1), shown])[: len(shown)]
    written = 0
    options = {"movflags": "+faststart"} if target.suffix.lower() == ".mp4" else {}
    with contextlib.ExitStack() as stack:
        name = stack.enter_context(native_name(target))
        out: Any = stack.enter_context(av.open(name, "w", options=options))
        stream: Any = None
        for part in parts:
            with native_name(part.path) as part_name, av.open(part_name) as box:
                source: Any = box.streams.video[0]
                if stream is None:
                    stream = out.add_stream_from_template(source)
                    stream.time_base = Fraction(1, sinks.CLOCK)
                for packet in box.demux(source):
                    if packet.pts is None:
                        continue
                    pts = _tick(packet.pts, packet.time_base) + part.tick
                    packet.time_base = Fraction(1, sinks.CLOCK)
                    packet.pts, packet.dts = pts, int(decoded[written])
                    packet.stream = stream
                    out.mux(packet)
                    written += 1


def _tick(time: int, base: Fraction) -> int:
    return round(time * base * sinks.CLOCK)


def _times(part: Part) -> tuple[Any, Any]:
    """Give the times of the packets of a part, in their order in the file, and the places of each in time."""
    import av

    with native_name(part.path) as part_name, av.open(part_name) as box:
        source = box.streams.video[0]
        found = [_tick(p.pts, p.time_base) + part.tick for p in box.demux(source) if p.pts is not None and p.time_base]
    pts = np.array(found, np.int64)
    if len(pts) != part.frames:
        raise OSError(f"{part.path}: has {len(pts)} pictures, expected {part.frames}")
    return pts, np.argsort(np.argsort(pts))


def _delay(_: Any, place: Any) -> int:
    """By how many pictures decoding must be ahead, so that none is decoded after it is shown."""
    return int(max(0, (np.arange(len(place)) - place).max(initial=0)))


def _encoded_again(parts: Sequence[Part], target: Path, codec: str, rate: Fraction) -> None:
    """Decode and encode, for libraries that cannot copy packets."""
    from ..io.opencv_files import open_capture

    sink: sinks.Cv2Sink | None = None
    try:
        for part in parts:
            video = open_capture(str(part.path))
            try:
                for _ in range(part.frames):
                    done, picture = video.read()
                    if not done:
                        raise OSError(f"{part.path}: has fewer pictures than the {part.frames} that were written")
                    if sink is None:
                        sink = sinks.Cv2Sink(target, codec, rate, picture.shape[1], picture.shape[0])
                    sink.write(picture, 0)
            finally:
                video.release()
        assert sink is not None
        sink.close()
    except BaseException:
        if sink is not None:
            sink.abandon()
        raise
