"""One pass over the frames of a source: each is measured, separated and written, until the end, Ctrl-C or a failure."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._beside import share_threads, soon_handed_over
from ..capture.too_few import too_few
from ..errors import RsflowError
from .finish import Ending, close
from .pipeline import Pipeline
from .probe import enough
from .progress import Progress
from .result import Extraction, ExtractionInterrupted, PartialExtractionError
from .stopping import StopRequest
from .worker import BackgroundWorker

if TYPE_CHECKING:
    from .checkpoint import Saved
    from .outputs import Outputs
    from .pipeline import Measured
    from .settings import ExtractSettings

__all__ = ["Run", "reason_of", "trouble_of"]

# Frames that wait to be measured, and to be separated after that: what is read is kept where a run is stopped.
_AHEAD, _MEASURED = 1, 2


class Run:
    """One pass over a source, until its end, Ctrl-C, or a failure."""

    def __init__(
        self,
        stream: Any,
        settings: ExtractSettings,
        outputs: Outputs,
        on_frame: Callable[[Measured], None] | None,
        saved: Saved | None = None,
        *,
        whole: bool = True,
    ) -> None:
        self.stream, self.settings, self.outputs, self.on_frame = stream, settings, outputs, on_frame
        self.pipeline = Pipeline(settings, stream, whole=whole and saved is None)
        self.held: list[tuple[Any, Any, Any]] = []
        self.settled = saved is not None
        self.last: int | None = None
        # A run that is gone on with had its first pair before.
        self.taken = 0 if saved is None else 2
        self.begin = time.monotonic()
        if saved is not None:
            self._go_on(saved)
        self.second: BackgroundWorker[tuple[Any, Any, Any]] = BackgroundWorker(
            self._process, name="rsflow-separate", depth=_MEASURED, begin=share_threads
        )
        self.first: BackgroundWorker[Any] = BackgroundWorker(
            self._measure, name="rsflow-measure", depth=_AHEAD, begin=share_threads
        )

    def _go_on(self, saved: Saved) -> None:
        """Be as after the frame of a checkpoint, which is the first that the stream gives."""
        frame = next(self.stream, None)
        if frame is None or frame.index != saved.frame:
            raise ValueError(f"the source has no frame {saved.frame} any more")
        self.pipeline.go_on(saved, frame)
        self.outputs.go_on(saved, frame)
        self.last = frame.index

    def run(self, progress: bool) -> Extraction:
        """Take all frames; raise what ended the run early, after keeping what is finished."""
        with StopRequest() as stop, soon_handed_over():
            interrupted, failure = False, None
            try:
                with Progress(self.stream.count, label=Path(self.stream.source).name, enabled=progress) as bar:
                    for frame in self.stream:
                        self.take(frame)
                        bar.advance()
                        if stop.requested:
                            break
            except KeyboardInterrupt:
                interrupted = True
            except Exception as error:
                failure = error
            interrupted = interrupted or stop.requested
            failure = trouble_of(self.first.close) or failure
            interrupted = interrupted and failure is None
            # What the probe decides from fewer frames than it wants is not what the whole run would decide.
            whole = self.settled
            failure = self._drained() or failure
            alone = self.taken < 2 and failure is None and not interrupted
            if self.last is None or alone:
                # Nothing to keep: the folder stays as it was.
                raise failure or (KeyboardInterrupt() if interrupted else too_few(self.stream, self.taken))
            if failure is None and not interrupted:
                failure = self.pipeline.without_log()
            if interrupted and whole and failure is None:
                failure = self._last_checkpoint()
            return self._ended(interrupted, failure, time.monotonic() - self.begin)

    def take(self, frame: Any) -> None:
        """Have one frame measured: the next ones are read meanwhile."""
        self.taken += 1
        self.first.put(frame)

    def _measure(self, frame: Any) -> None:
        """Measure one frame; the first ones wait until the probe is decided."""
        shift, flow = self.pipeline.measure(frame)
        if self.settled:
            self.second.put((frame, shift, flow))
            return
        self.held.append((frame, shift, flow))
        if enough(self.held):
            self.settle()

    def settle(self) -> None:
        """Decide what the probe is for and process the frames that waited."""
        self.settled = True
        held, self.held = self.held, []
        if held:
            width = held[0][0].image.shape[1]
            self.outputs.begin(self.pipeline.settle([(shift, flow) for _, shift, flow in held], width))
        for item in held:
            self.second.put(item)

    def _process(self, item: tuple[Any, Any, Any]) -> None:
        """Separate, measure the velocity, and hand over to the files: beside the measuring of the next frame."""
        frame, shift, flow = item
        measured = self.pipeline.finish(frame, shift, flow)
        self.outputs.add(measured, self.pipeline.attitude)
        self.last = frame.index
        if self.on_frame is not None:
            self.on_frame(measured)
        if self.outputs.schedule.due():
            self.outputs.checkpoint(frame.index, self.pipeline.state(), time.monotonic() - self.begin)

    def end_of_part(self) -> None:
        """Keep what has been taken for the run that goes on with it; raises what went wrong on the way."""
        failure = trouble_of(self.first.close)
        failure = self._drained() or failure
        assert self.outputs.views is not None or failure is not None
        failure = failure or self._last_checkpoint(must=True)
        if failure is not None:
            raise failure

    def _drained(self) -> Exception | None:
        """Process what waits, also where the run was too short for the probe; give the error that ended it."""
        settled = None if self.settled else trouble_of(self.settle)
        return trouble_of(self.second.close) or settled

    def _last_checkpoint(self, *, must: bool = False) -> Exception | None:
        """Let the rest be measured later as if nothing had happened; give the error that stands in the way."""
        assert self.last is not None
        try:
            assert self.outputs.views is not None
            trouble = self.outputs.views.drained()
            if trouble is None:
                seconds = time.monotonic() - self.begin
                self.outputs.checkpoint(self.last, self.pipeline.state(), seconds, drained=True, must=must)
        except Exception as error:
            return error
        return trouble

    def _ended(self, interrupted: bool, failure: BaseException | None, seconds: float) -> Extraction:
        """Complete the files and give or raise the result."""
        live_end = interrupted and self.stream.live
        reason = ""
        if failure is not None:
            reason = reason_of(failure)
        elif interrupted and not live_end:
            reason = f"interrupted after frame {self.last}"
        seconds += self.outputs.seconds_before
        extraction, trouble = close(self.outputs, self.pipeline, Ending(reason, self.last, seconds))
        failure = failure or trouble
        if failure is not None:
            raise PartialExtractionError(f"{reason_of(failure)}; {_kept(extraction)}", extraction) from failure
        if reason:
            raise ExtractionInterrupted(
                f"{reason}; {_kept(extraction)}; {_going_on(extraction, self.outputs.resumable)}", extraction
            )
        return extraction


def trouble_of(end: Callable[[], None]) -> Exception | None:
    """Call `end`; give the error that it raised."""
    try:
        end()
    except Exception as error:
        return error
    return None


def reason_of(error: BaseException) -> str:
    """Give the message of an expected error; the type too where it is not one of those."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}" if error.filename is None else f"{error.filename}: {error.strerror}"
    if isinstance(error, RsflowError):
        return " ".join(str(error).split())
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _kept(extraction: Extraction) -> str:
    if not extraction.files:
        return f"nothing could be kept in {extraction.folder}"
    kept = "1 frame is kept" if extraction.frames == 1 else f"{extraction.frames} frames are kept"
    return f"{kept} as *.partial.* in {extraction.folder}"


def _going_on(extraction: Extraction, resumable: bool) -> str:
    if resumable:
        return "the same command with --resume goes on"
    return f"go on into another folder with --start {extraction.summary['next_start']}"
