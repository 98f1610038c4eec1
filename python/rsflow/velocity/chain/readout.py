"""How long a camera takes from its first row to its last one, as far as the pictures show it."""

from __future__ import annotations

from typing import Any

# A readout is believed where it differs from what was told by this many deviations, and by this many seconds.
_SURE = 6.0
_LEAST_S = 1e-3
# No camera takes longer than its frames are apart.
_MOST = 1.0
# Of one frame no more is known than so many of its own deviations: others disturb it alike.
_TRUSTED = 4.0


class Readout:
    """Learns a readout from what rows say against each other; a steady way over level ground tells nothing of it.

    Parameters
    ----------
    told_s : float or None
        What the camera takes; None where nobody says.
    """

    def __init__(self, told_s: float | None) -> None:
        self._told = told_s
        self._weight = 0.0
        self._sum = 0.0

    @property
    def applied_s(self) -> float:
        """With which frames are measured: what was told, or what was seen where nobody says."""
        if self._told is not None:
            return self._told
        return self._seen() if self._is_sure(0.0) else 0.0

    @property
    def doubt(self) -> str:
        """What is to be said of it; empty where nothing is."""
        if not self._is_sure(self._told or 0.0):
            return ""
        seen = f"a readout of {1e3 * self._seen():.1f} ms from the first row to the last"
        if self._told is None:
            return f"the pictures show {seen}: a rolling shutter"
        return f"the pictures show {seen}, not {1e3 * self._told:.3g} ms"

    def learn(self, score: float, information: float, dt_s: float) -> None:
        """Take what a pair of frames says beyond the applied readout, in intervals, and how surely."""
        if not information > 0 or abs(score) > _MOST * information:
            return
        information /= _TRUSTED**2
        at = self.applied_s + score / (_TRUSTED**2 * information) * dt_s
        self._weight += information / dt_s**2
        self._sum += information / dt_s**2 * at

    def _seen(self) -> float:
        return self._sum / self._weight if self._weight > 0 else 0.0

    def _is_sure(self, of: float) -> bool:
        off = abs(self._seen() - of)
        return self._weight > 0 and off > max(_LEAST_S, _SURE * self._weight**-0.5)

    def state(self) -> dict[str, Any]:
        """Everything that is known, to be kept."""
        return {"weight": self._weight, "sum": self._sum}

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        self._weight, self._sum = kept["weight"], kept["sum"]
