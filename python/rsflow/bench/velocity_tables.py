"""What a run over velocities found, and the Markdown tables made of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._display import fields
from ._markdown import markdown

__all__ = ["VELOCITY_MARKS", "ConditionRow", "LatencyRow", "VelocityBench"]

# What stands between these lines of a Markdown file is rewritten by `with_tables`.
VELOCITY_MARKS = ("<!-- velocity-conditions-start -->", "<!-- velocity-conditions-end -->")


@dataclass(frozen=True)
class ConditionRow:
    """How exact velocities were under one condition, and how far their deviations can be believed.

    Attributes
    ----------
    condition : str
    frames : int
        Intervals between frames, of all flights.
    rms_percent, bias_percent : float
        Of the error of (vx, vy) in percent of the median speed: root mean square of its length, and mean of its part
        along the true velocity. NaN where no velocity was measured.
    valid : float
        Share of the intervals for which there is a velocity.
    false : float
        Share of the intervals for which there is one that is off by more than five deviations and by more than 2 %.
    within_1, within_2 : float
        Share of the components vx and vy within one and two standard deviations: 0.68 and 0.95 where these are exact.

    Examples
    --------
    >>> row = ConditionRow("level flight", 39, 0.03, -0.01, 1.0, 0.0, 0.69, 0.95)
    >>> row.valid, row.false
    (1.0, 0.0)
    """

    condition: str
    frames: int
    rms_percent: float
    bias_percent: float
    valid: float
    false: float
    within_1: float
    within_2: float


@dataclass(frozen=True)
class LatencyRow:
    """How long a step from frame to velocity takes.

    Attributes
    ----------
    size : (int, int)
        Width and height of the frames.
    method : str
        Whose step.
    stage : str
        Which one; "frame to velocity" is all of them.
    time_ms : float
        Median.
    rms_percent : float
        Of the velocities, for "frame to velocity"; else NaN.

    Examples
    --------
    >>> LatencyRow((64, 64), "rsflow", "frame to velocity", 0.4, 0.7).time_ms
    0.4
    """

    size: tuple[int, int]
    method: str
    stage: str
    time_ms: float
    rms_percent: float


@dataclass(frozen=True, eq=False)
class VelocityBench:
    """All rows of a run over velocities, and what it ran on.

    Attributes
    ----------
    conditions : tuple of ConditionRow
    latencies : tuple of LatencyRow
    cpu_level : str
        The instructions that rsflow used.
    flights : int
        How many flights, of different ground and heading, each condition has.
    versions : dict
        Of rsflow, OpenCV, numpy and Python.

    Examples
    --------
    >>> row = ConditionRow("level flight", 39, 0.03, -0.01, 1.0, 0.0, 0.69, 0.95)
    >>> print(VelocityBench((row,), (), "avx2", 1, {"rsflow": "0.1.0"}).tables().splitlines()[2])
    | level flight | 0.030 % | -0.010 % |  100 % |   0.0 % |     69 % |     95 % |
    """

    conditions: tuple[ConditionRow, ...]
    latencies: tuple[LatencyRow, ...]
    cpu_level: str
    flights: int
    versions: dict[str, str]

    __repr__ = fields

    def tables(self) -> str:
        """Write a Markdown table of the conditions, one of the latencies, and a line on what they were measured on."""
        parts = []
        if self.conditions:
            cells = [("condition", "rms", "bias", "valid", "false", "within 1", "within 2")]
            cells += [
                (
                    row.condition, _percent(row.rms_percent, 3), _percent(row.bias_percent, 3),
                    _percent(100 * row.valid, 0), _percent(100 * row.false, 1),
                    _percent(100 * row.within_1, 0), _percent(100 * row.within_2, 0),
                )
                for row in self.conditions
            ]  # fmt: skip
            parts.append(markdown(cells, words=1))
        if self.latencies:
            timed = [("frames", "method", "stage", "time", "frames/s", "rms")]
            last: tuple[object, ...] = ()
            for line in self.latencies:
                size, method = f"{line.size[0]} x {line.size[1]}", line.method
                shown = ("" if last[:1] == (size,) else size, "" if last == (size, method) else method)
                last = (size, method)
                whole = np.isfinite(line.rms_percent)
                rate = f"{1000 / line.time_ms:.0f}" if whole else ""
                rms = _percent(line.rms_percent, 3) if whole else ""
                timed.append((*shown, line.stage, f"{line.time_ms:.3g} ms", rate, rms))
            parts.append(markdown(timed, words=3))
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        flights = f"{self.flights} flight{'' if self.flights == 1 else 's'} a condition"
        return "\n\n".join([*parts, f"CPU level {self.cpu_level}, 1 thread, {flights}, times are medians; {versions}."])


def _percent(value: float, digits: int) -> str:
    return f"{value:.{digits}f} %" if np.isfinite(value) else "-"
