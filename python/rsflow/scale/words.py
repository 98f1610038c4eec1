"""What is wrong, in words: how a clip and what it was held against differ."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .estimate import Estimate, in_unit

__all__ = ["axes_words", "bias_words", "delay_words", "focal_words", "mounting_words", "readout_words"]

# Below these a difference does not matter, even where it is certain.
_FOCAL, _DELAY_S, _READOUT_S, _ANGLE_RAD, _BIAS_RAD_S = 0.003, 0.001, 0.001, math.radians(0.3), 0.003
# Deviations from which a difference is told.
_SURE = 3.0


def differs(figure: Estimate, stated: float, least: float) -> bool:
    """Whether a figure is surely another than was stated, by so much that it matters."""
    away = abs(figure.value - stated)
    return figure.known and away > max(_SURE * figure.std, least) and stated not in figure


def focal_words(ratio: Estimate, focal_px: Estimate, stated_px: float, *, or_else: str = "") -> list[str]:
    """Say how the focal length that was stated is wrong."""
    if not differs(ratio, 1.0, _FOCAL):
        return []
    percent = 100 * (1 / ratio.value - 1)
    kind, slow = ("long", "low") if percent > 0 else ("short", "high")
    return [
        f"the focal length is {_number(abs(percent))} % too {kind}: {stated_px:.5g} px stated, {focal_px} measured"
        f" (velocities come out too {slow}){or_else}"
    ]


def delay_words(delay: Estimate, what: str) -> list[str]:
    """Say how late the log is."""
    if not differs(delay, 0.0, _DELAY_S):
        return []
    ms = in_unit(delay, 1e3, "ms")
    if delay.value > 0:
        return [f"the {what} lags by {ms.value:.3g} ms ({ms}): take that off its times"]
    return [f"the {what} leads by {-ms.value:.3g} ms ({ms}): add that to its times"]


def readout_words(readout: Estimate, stated_s: float) -> list[str]:
    """Say that the rows are read over a time that was not stated."""
    if not differs(readout, stated_s, _READOUT_S):
        return []
    order = "" if readout.value > 0 else ", from the last row to the first"
    ms = in_unit(readout, 1e3, "ms")
    return [f"the rows of a picture are read over {ms}{order}, not over {1e3 * stated_s:g} ms: a rolling shutter"]


def mounting_words(mounting: Sequence[Estimate], what: str) -> list[str]:
    """Say how the log's axes, put in order, are turned from the camera's."""
    names = ("x axis", "y axis", "z axis (yaw)")
    degrees = [(name, in_unit(angle, 180 / math.pi, "deg")) for name, angle in zip(names, mounting, strict=True)]
    return [
        f"the {what} is turned by {angle} about the camera's {name} from how it was said to be mounted"
        for (name, angle), rad in zip(degrees, mounting, strict=True)
        if differs(rad, 0.0, _ANGLE_RAD)
    ]


def bias_words(bias: Sequence[Estimate]) -> list[str]:
    """Say where a gyro shows a turn that there is not."""
    told = [f"{axis} {b.value:+.4f}" for axis, b in zip("xyz", bias, strict=True) if differs(b, 0.0, _BIAS_RAD_S)]
    return [f"the gyro has a bias: {', '.join(told)} rad/s"] if told else []


def axes_words(axes: Sequence[str]) -> list[str]:
    """Say which axes are swapped, and which have the wrong sign.

    Examples
    --------
    >>> axes_words(("+y", "+x", "+z")), axes_words(("+x", "-y", "?")), axes_words(("+x", "+y", "+z"))
    (['x and y are swapped'], ['the sign of y is wrong'], [])
    >>> axes_words(("+y", "-x", "+z"))
    ['x and y are swapped, and the sign of x is wrong: x is +y of the log, y is -x of the log']
    """
    names = "xyz"
    moved = [k for k in range(3) if axes[k] != "?" and axes[k][1] != names[k]]
    flipped = [axes[k][1] for k in range(3) if axes[k][0] == "-"]
    signs = ""
    if flipped:
        signs = f"the sign of {flipped[0]} is wrong" if len(flipped) == 1 else f"the signs of {_and(flipped)} are wrong"
    if not moved:
        return [signs] if signs else []
    pairs = {frozenset((names[k], axes[k][1])) for k in moved}
    swapped = f"{_and(sorted(next(iter(pairs))))} are swapped" if len(pairs) == 1 else "the axes are in another order"
    if not signs and len(pairs) == 1:
        return [swapped]
    full = ", ".join(f"{names[k]} is {axes[k]} of the log" for k in range(3) if k in moved or axes[k][0] == "-")
    return [f"{swapped}{f', and {signs}' if signs else ''}: {full}"]


def _and(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} and {words[-1]}" if len(words) > 1 else words[0]


def _number(value: float) -> str:
    """Give three digits, and no more than one decimal from 10 on."""
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2g}"
