"""What a live run comes to."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

__all__ = ["Ended", "LiveSummary"]

Ended = Literal["end", "frames", "seconds", "interrupted"]


@dataclass(frozen=True, eq=False)
class LiveSummary:
    """What a live run comes to.

    Attributes
    ----------
    ended : {"end", "frames", "seconds", "interrupted"}
        Why it ended: with its source, after as many frames or seconds as were asked for, or by Ctrl-C or SIGTERM.
    frames : int
        Frames measured.
    not_measured : int
        Frames that the source gave and nobody was ready for.
    not_shown : int
        Pictures that were to be shown and that the viewer or the recording was not ready for; their figures are there.
    gaps : int
        How often the source was away.
    seconds : float
        From the first frame to the end.
    delay_median_s, delay_p95_s, delay_p99_s : float
        Quantiles of how late figures were (to one per cent); NaN of a file.
    files : dict of str to Path
        What was written: ``motion``, ``objects``, ``velocity``, ``recording``.
    notes : tuple of str
        What to know, one sentence each.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> done = rsflow.live.watch(flight)
    >>> done.ended, done.frames, done.to_dict()["delay_median_s"]
    ('end', 3, None)
    """

    ended: Ended
    frames: int
    not_measured: int
    not_shown: int
    gaps: int
    seconds: float
    delay_median_s: float
    delay_p95_s: float
    delay_p99_s: float
    files: dict[str, Path] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def frame_rate_hz(self) -> float:
        """Frames measured per second; NaN where that is not known."""
        return (self.frames - 1) / self.seconds if self.frames > 1 and self.seconds > 0 else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Give it as JSON can say it, what is not known as None.

        Returns
        -------
        dict
        """
        values = dict(vars(self)) | {"frame_rate_hz": self.frame_rate_hz}
        values["files"] = {name: str(path) for name, path in self.files.items()}
        values["notes"] = list(self.notes)
        return {name: None if isinstance(x, float) and not math.isfinite(x) else x for name, x in values.items()}

    def text(self) -> str:
        """Say it in one line."""
        words = f"{self.frames} frames in {self.seconds:.1f} s"
        if math.isfinite(self.frame_rate_hz):
            words += f", {self.frame_rate_hz:.1f} frames/s"
        if math.isfinite(self.delay_median_s):
            words += f", delay {1e3 * self.delay_median_s:.0f} ms (95 % below {1e3 * self.delay_p95_s:.0f} ms)"
        for count, what in ((self.not_measured, "not measured"), (self.not_shown, "not shown")):
            if count:
                words += f", {count} {what}"
        if self.gaps:
            words += f", {self.gaps} gap{'' if self.gaps == 1 else 's'}"
        return words
