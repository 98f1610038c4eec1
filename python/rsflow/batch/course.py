"""The course of one source of a batch: which steps can be done now, and what became of it at the end."""

from __future__ import annotations

import contextlib
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from . import remote
from .assignment import Assignment, Failure, Plan, part_name, seed_name
from .items import BatchItem, BatchStatus

__all__ = ["Course", "Step"]


@dataclass(frozen=True)
class Step:
    """One thing for a worker to do: its name as in `work.end`, the arguments behind the assignment, tries before."""

    what: str
    arguments: tuple[Any, ...] = ()
    tries: int = 0


class Course:
    """The steps of one source, handed out as what they rest on is done.

    A source in one piece is one step. A long one is cut; its parts are measured as soon as what they must know of the
    frames before them is found, in any order; then they are joined.

    Parameters
    ----------
    assignment : Assignment
    retries : int
        How often a step is done again whose worker died.
    """

    def __init__(self, assignment: Assignment, retries: int) -> None:
        self.assignment, self._retries = assignment, retries
        self.item: BatchItem | None = None
        self.running = 0
        self.stopped = False
        self._plan = Plan()
        self._spans: list[Any] = []
        self._done: set[str] = set()
        self._asked: set[str] = set()
        first = "whole" if assignment.part_frames is None else "cut"
        self._steps: deque[Step] = deque([Step(first)])

    @property
    def share(self) -> float:
        """How much of the source is done, from 0 to 1."""
        if self.item is not None:
            return 1.0
        return self._parts_done / (len(self._spans) + 1) if self._spans else 0.0

    @property
    def _parts_done(self) -> int:
        return sum(part_name(span.number) in self._done for span in self._spans)

    def next(self) -> Step | None:
        """Give a step that can be done now, if there is one."""
        if not self._steps or self.item is not None or self.stopped:
            return None
        self.running += 1
        return self._steps.popleft()

    def stop(self) -> None:
        """Begin nothing any more; what runs ends by itself."""
        self.stopped = True
        if not self.running and self.item is None:
            self._end_early("interrupted" if self._done else "not begun: the batch was interrupted")

    def died(self, step: Step, reason: str) -> None:
        """Take in that the worker of a step died."""
        self.running -= 1
        if self.item is not None:
            return
        if self.stopped or step.tries >= self._retries:
            times = f" {step.tries + 1} times" if step.tries else ""
            self._end_early(f"the worker ended{times}: {reason}", died=True)
            return
        again = replace(step, tries=step.tries + 1)
        self._steps.appendleft(replace(again, arguments=(True,)) if step.what == "whole" else again)

    def cancelled(self) -> None:
        """Take in that a step was never begun."""
        self.running -= 1
        self.stop()

    def ended(self, step: Step, result: Any) -> None:
        """Take in what a step gave."""
        self.running -= 1
        if self.item is not None:
            return
        if isinstance(result, Failure) and not result.in_one_piece:
            self._end_early(result.error, interrupted=result.interrupted)
        elif isinstance(result, BatchItem):
            self.item = result
        elif isinstance(result, Failure):
            # What does not fit together is read in one piece.
            self._spans, self._done = [], set()
            self._steps.append(Step("whole"))
        elif isinstance(result, Plan):
            self._planned(result)
        elif step.what in ("part", "look ahead"):
            self._advanced(step, there=bool(result))
        if self.stopped:
            self.stop()

    def _planned(self, plan: Plan) -> None:
        self._plan, self._spans, self._done = plan, list(plan.spans), set(plan.done)
        if not plan.spans:
            self._steps.append(Step("whole", (self.assignment.resume,)))
            return
        self._more()

    def _advanced(self, step: Step, *, there: bool) -> None:
        span = step.arguments[1]
        if not there:
            # The source said that it has more frames than it has.
            self._spans = [one for one in self._spans if one.number < span.number]
        else:
            self._done.add(seed_name(span.number) if step.what == "look ahead" else part_name(span.number))
        self._more()

    def _more(self) -> None:
        """Hand out what rests on what is done now."""
        root = self._plan.root
        if self._parts_done == len(self._spans):
            self._ask("join", Step("join", (root, len(self._spans))))
            return
        handed_on, ahead = self.assignment.overlap is None, self.assignment.options.get("height_m") is not None
        for span in self._spans:
            part = part_name(span.number)
            if handed_on:
                seed = part_name(span.number - 1) if span.number else None
            else:
                # Without a velocity all parts must know the same.
                seed = seed_name(span.number if ahead else 1) if span.number else None
            if part not in self._done and (seed is None or seed in self._done):
                self._ask(part, Step("part", (root, span, seed)))
            if not handed_on and span.number and (ahead or span.number == 1) and self._wanted(span.number):
                before = seed_name(span.number - 1)
                if span.number == 1 or before in self._done:
                    name = seed_name(span.number)
                    self._ask(name, Step("look ahead", (root, span)), first=True)

    def _wanted(self, number: int) -> bool:
        """Whether what a part must know is still to be found, for it or for a later one."""
        later = any(part_name(span.number) not in self._done for span in self._spans if span.number >= number)
        return seed_name(number) not in self._done and later

    def _ask(self, name: str, step: Step, *, first: bool = False) -> None:
        if name in self._asked:
            return
        self._asked.add(name)
        # Parts wait for what runs ahead.
        if first:
            self._steps.appendleft(step)
        else:
            self._steps.append(step)

    def _end_early(self, error: str, *, interrupted: bool = False, died: bool = False) -> None:
        from ..extraction.tables import discard_working

        parts = self._parts_done
        status = BatchStatus.PARTIAL if parts else BatchStatus.FAILED
        if error.startswith("not begun"):
            status = BatchStatus.CANCELLED
        if parts:
            error += f"; {parts} of {len(self._spans)} parts are done, the same command with --resume goes on"
        if not remote.is_remote(self.assignment.folder):
            here = Path(self.assignment.folder)
            if self._plan.root and not parts:
                for folder in (Path(self._plan.root), Path(self._plan.root).parent, here):
                    with contextlib.suppress(OSError):
                        folder.rmdir()
            if died:
                discard_working(here)
        self.item = self.assignment.item(status, error)
