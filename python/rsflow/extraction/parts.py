"""A part of a long source, measured by itself so that many machines can work on one video.

What a frame's displacement and dense flow need is the frame before: a part begins with it. The velocity goes on from
what was learned of all frames before; it is cheap beside the rest, so `scout` runs ahead for it. What moves is told
from a while of frames that overlap with the part before.
"""

from __future__ import annotations

import json
import zlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._results.folder import Identity, read_json
from ..errors import RsflowError
from ..io.atomic import writing
from .checkpoint import Draft, Saved, Schedule, versions
from .claim import IDENTIFYING, Claim
from .outputs import Outputs
from .pipeline import Pipeline
from .probe import CameraDecision, enough
from .rows import object_rows
from .run import Run
from .stopping import StopRequest
from .trajectory import Trajectory
from .workspace import PARKED

if TYPE_CHECKING:
    from ..capture.stream import Frame, Frames
    from .settings import ExtractSettings

__all__ = ["LEAST_FRAMES", "NOTE", "NoFrameError", "Span", "extract_part", "is_part", "scout", "spans"]

# What tells of a part that is complete, in its folder.
NOTE = "part.json"

# A part of fewer frames could not decide what the first one decides.
LEAST_FRAMES = 16


@dataclass(frozen=True)
class Span:
    """Frames of a part: its number, its first frame, and the first one after it (None: until the source ends)."""

    number: int
    begin: int
    end: int | None


class NoFrameError(RsflowError):
    """The source ends before the part begins."""


def _frames(source: Any, settings: ExtractSettings, start: int | None, stop: int | None, **options: Any) -> Frames:
    from ..capture.opening import frames

    options |= {"roi": settings.roi, "stride": settings.stride}
    options |= {"frame_rate": settings.frame_rate, "times": settings.times}
    return frames(source, start=start, stop=stop, **options)


def spans(source: Any, settings: ExtractSettings, part_frames: int) -> list[Span]:
    """Cut a source into parts of `part_frames` frames, the last one longer; none where it is no longer than two.

    Raises
    ------
    CaptureError
        If the source cannot be opened.
    """
    identity = Identity.of(source, {})
    with _frames(source, settings, settings.start, settings.stop) as stream:
        if stream.live or stream.count is None or identity.source is None:
            return []
        number = stream.count // part_frames
    if number < 2:
        return []
    step, start = part_frames * settings.stride, settings.start or 0
    begins = [start + step * k for k in range(number)]
    ends = [*begins[1:], settings.stop]
    return [Span(k, begin, end) for k, (begin, end) in enumerate(zip(begins, ends, strict=True))]


def scout(source: Any, settings: ExtractSettings, span: Span, folder: Path, after: Path | None) -> None:
    """Find what the part `span` must know of the frames before it, and write it into `folder`.

    Parameters
    ----------
    source, settings
        As for `rsflow.extract`.
    span : Span
        Not the first.
    folder : Path
        Exists.
    after : Path, optional
        What was found for the part before; None for the second one. Without a velocity what was found for the second
        part holds for all.

    Raises
    ------
    NoFrameError
        If the source has no frame there.
    """
    draft = Draft()
    draft.add("versions", versions())
    draft.add("frame", span.begin - settings.stride)
    if after is None:
        decision, style = _decided(source, settings)
        draft.add("decision", (decision.motion, decision.reason))
        draft.add("style", style)
        before = None
    else:
        before = Saved(after)
        for name in ("decision", "style"):
            draft.add(name, before.value(name))
    if settings.height_m is not None:
        ground, trajectory = _travelled(source, settings, span, before)
        draft.add("ground", ground)
        draft.add("trajectory", trajectory)
    draft.write(folder / "checkpoint.npz")


def _decided(source: Any, settings: ExtractSettings) -> tuple[CameraDecision, Any]:
    """Decide from the first frames as a run over the whole source does."""
    held: list[Any] = []
    with _frames(source, settings, settings.start, settings.stop, color=True) as stream:
        pipeline = Pipeline(settings, stream)
        for frame in stream:
            held.append((frame, *pipeline.measure(frame)))
            if enough(held):
                break
    style = pipeline.settle([(shift, flow) for _, shift, flow in held], held[0][0].image.shape[1])
    return pipeline.decision, style


def _travelled(source: Any, settings: ExtractSettings, span: Span, before: Saved | None) -> tuple[Any, Trajectory]:
    """Measure the velocity alone until the part begins."""
    start = settings.start if before is None else before.frame
    last: Frame | None = None
    with _frames(source, settings, start, span.begin) as stream, StopRequest() as stop:
        pipeline = Pipeline(settings, stream, whole=before is None)
        ground, trajectory = pipeline.ground, Trajectory()
        assert ground is not None
        for frame in stream:
            if not ground.is_open:
                ground.open(stream, settings.roi, pipeline.mask)
                if before is not None:
                    ground.go_on(before.value("ground"))
                    trajectory, last = before.value("trajectory"), frame
                    continue
            velocity, _ = ground.update(frame)
            trajectory.add(velocity, frame.index, **ground.attitude)
            last = frame
            if stop.requested:
                raise KeyboardInterrupt
    if last is None or last.index != span.begin - settings.stride:
        raise NoFrameError(f"{stream.source}: got no frame {span.begin - settings.stride}")
    return ground.state(), trajectory


def extract_part(
    source: Any, settings: ExtractSettings, span: Span, folder: Path, *, seed: Path | None, overlap: int | None
) -> None:
    """Measure the frames of one part; `folder` then holds a run that waits to be gone on with, and a note.

    Parameters
    ----------
    source, settings
        As for `rsflow.extract`.
    span : Span
    folder : Path
        Exists, and is empty.
    seed : Path, optional
        What `scout` found for this part; None for the first. Without an overlap the folder of the part before.
    overlap : int, optional
        Frames before the part from which what moves is told; None to go on with all that the part before knew.

    Raises
    ------
    NoFrameError
        If the source ends before.
    KeyboardInterrupt
        At Ctrl-C or SIGTERM.
    """
    first = settings.start
    if seed is not None:
        first = max(settings.start or 0, span.begin - (overlap or 1) * settings.stride)
    tail = _Tail(overlap or 1)
    failures: list[str] = []
    with _frames(source, settings, first, span.end, color=True) as stream:
        claim = Claim(folder, source, settings, overwrite=True)
        with Outputs(folder, stream, settings, claim) as outputs:
            outputs.schedule = Schedule(never=True)
            run = Run(stream, settings, outputs, None, whole=seed is None)
            joint = _Joint()
            if seed is not None and overlap is None:
                _handed_on(run, Saved(seed / PARKED), span, joint)
            elif seed is not None:
                _warmed_up(run, Saved(seed), span, joint)
            with StopRequest() as stop:
                for frame in _until_failure(stream, failures):
                    tail.add(frame)
                    run.take(frame)
                    if stop.requested:
                        break
                if stop.requested:
                    raise KeyboardInterrupt
            if not tail.frames:
                raise NoFrameError(f"{stream.source}: got no frame {span.begin}")
            run.end_of_part()
            note = {
                "number": span.number,
                "begin": span.begin,
                "end": span.end,
                "overlap": overlap,
                "frames": tail.frames,
                "last": run.last,
                "lost": stream.lost,
                "handed": seed is not None and overlap is None,
                "failure": " ".join(failures),
                "versions": versions(),
                "identity": claim.identity.as_dict(),
                "pictures": tail.sums,
                "pictures_before": joint.sums,
                "objects_before": joint.objects,
                "to_first": joint.to_first,
                "to_first_end": run.pipeline.to_first(),
            }
    with writing(folder / NOTE) as partial:
        partial.write_text(json.dumps(note), encoding="utf-8")


def is_part(folder: Path, source: Any, settings: ExtractSettings, span: Span, overlap: int | None) -> bool:
    """Whether `folder` holds this very part, complete, of this source and version."""
    note = read_json(folder / NOTE)
    identity = Identity.of(source, settings.flat(), files=IDENTIFYING)
    same = (note.get("begin"), note.get("end"), note.get("overlap")) == (span.begin, span.end, overlap)
    return same and note.get("versions") == versions() and not identity.difference(note.get("identity"))


def _until_failure(stream: Frames, failures: list[str]) -> Iterator[Frame]:
    """Give frames until the source fails: the run that goes on with the last part meets that failure again."""
    try:
        yield from stream
    except (RsflowError, OSError) as error:
        failures.append(str(error))


class _Joint:
    """What is known of the frames before a part."""

    def __init__(self) -> None:
        self.sums: dict[str, int] = {}
        self.objects: list[dict[str, Any]] = []
        self.to_first: list[list[float]] | None = None


class _Tail:
    """Check sums of the last pictures of a part."""

    def __init__(self, count: int) -> None:
        self.frames = 0
        self._last: deque[tuple[int, int]] = deque(maxlen=max(count, 1))

    def add(self, frame: Frame) -> None:
        self.frames += 1
        self._last.append((frame.index, _sum(frame)))

    @property
    def sums(self) -> dict[str, int]:
        return {str(index): value for index, value in self._last}


def _sum(frame: Frame) -> int:
    return zlib.crc32(np.ascontiguousarray(frame.image).view(np.uint8).data)


def _handed_on(run: Run, saved: Saved, span: Span, joint: _Joint) -> None:
    """Be as at the end of the part before."""
    frame = next(run.stream, None)
    if frame is None or frame.index != saved.frame:
        raise NoFrameError(f"{run.stream.source}: got no frame {saved.frame}")
    run.pipeline.go_on(saved, frame)
    run.outputs.begin(saved.value("style"))
    assert run.outputs.views is not None
    run.outputs.views.go_on(saved.value("views"), frame)
    run.outputs.trajectory = saved.value("trajectory")
    joint.sums[str(frame.index)] = _sum(frame)
    run.settled, run.taken = True, 2


def _warmed_up(run: Run, seed: Saved, span: Span, joint: _Joint) -> None:
    """Take the frames before a part; nothing of them is written."""
    pipeline, outputs = run.pipeline, run.outputs
    pipeline.begin(CameraDecision(*seed.value("decision")))
    outputs.begin(seed.value("style"))
    assert outputs.views is not None
    last: Frame | None = None
    for frame in run.stream:
        _, flow = pipeline.measure(frame)
        seen = pipeline.learn(frame, flow)
        outputs.views.learn(frame, seen)
        joint.sums[str(frame.index)] = _sum(frame)
        joint.objects += object_rows(frame, seen)
        last = frame
        if frame.index >= span.begin - run.settings.stride:
            break
    if last is None or last.index != span.begin - run.settings.stride:
        raise NoFrameError(f"{run.stream.source}: got no frame {span.begin - run.settings.stride}")
    joint.to_first = pipeline.to_first()
    if pipeline.ground is not None:
        pipeline.ground.go_on(seed.value("ground"))
        outputs.trajectory = seed.value("trajectory")
    run.settled, run.taken = True, 2
