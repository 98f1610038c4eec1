"""Heights over a stretch without any: carried on by the vertical velocity that the pictures show."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

# A height that is off from what the pictures carried on by this many deviations, and by this part of it, is told.
_TOLD = 5.0
_TOLD_PART = 0.03


@dataclass(frozen=True)
class Height:
    """A height over the plane and its deviation, in metres, at a time; `given_s` is when it was last measured."""

    height_m: float
    std_m: float
    t_s: float
    given_s: float


class HeightKeeper:
    """The height at each frame: as given, or carried on for a while.

    Parameters
    ----------
    longest_s : float
        For how long a height is carried on.
    """

    def __init__(self, longest_s: float) -> None:
        self._longest_s = longest_s
        self._last: Height | None = None

    def at_first(self, given: float, std: float, t_s: float) -> None:
        """Take the height at a frame whose motion is not known."""
        if np.isfinite(given) and given > 0:
            self._last = Height(given, std, t_s, t_s)

    def at(self, given: float, std: float, t_s: float, rise: float, rise_std: float) -> tuple[Height | None, str]:
        """Give the height at the second frame of an interval.

        Parameters
        ----------
        given : float
            As it was measured; NaN where it was not.
        std : float
            Its deviation.
        t_s : float
        rise, rise_std : float
            How far the camera went down, in heights at this frame, and its deviation.

        Returns
        -------
        height : Height or None
            None where none is known.
        doubt : str
            What is odd about a height that was given; empty where nothing is.
        """
        carried = self._carried(t_s, rise, rise_std)
        if np.isfinite(given) and given > 0:
            now = Height(given, std, t_s, t_s)
            doubt = ""
            if carried is not None and self._last is not None:
                off = abs(given - carried.height_m)
                spread = float(np.hypot(np.hypot(carried.std_m, std), self._last.std_m))
                if off > max(_TOLD * spread, _TOLD_PART * given):
                    doubt = "the heights contradict the vertical velocity that the pictures show"
                    now = replace(now, std_m=float(np.hypot(std, off)))
            self._last = now
            return now, doubt
        if carried is None or t_s - carried.given_s > self._longest_s:
            return None, ""
        self._last = carried
        return carried, "" if carried.given_s == t_s else "the height is carried on by the pictures alone"

    def _carried(self, t_s: float, rise: float, rise_std: float) -> Height | None:
        last = self._last
        share = 1.0 + rise
        if last is None or not np.isfinite(share) or share <= 0.1:
            return None
        height = last.height_m / share
        return Height(height, float(np.hypot(last.std_m / share, height * rise_std / share)), t_s, last.given_s)

    def state(self) -> dict[str, Any]:
        """Everything that is known, to be kept."""
        return {"last": None if self._last is None else astuple(self._last)}

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        self._last = None if kept["last"] is None else Height(*kept["last"])
