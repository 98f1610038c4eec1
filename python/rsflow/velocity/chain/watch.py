"""What a sequence shows over time: frames that were sent twice, and times that do not fit a steady flow."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

# What noise leaves between frames is remembered over so many of them.
_FRAMES = 30
# A picture that stands still and differs from the one before by less than this part of what noise usually leaves, was
# sent twice.
_QUIET = 0.75
# It does so where the motion before made it expected to move by this many pixels, and where it moved less than this.
_EXPECTED_PX = 1.0
# So often in a row a picture that stands still all at once is taken for one that was sent again.
_STOPS = 4
_STILL_PX = 0.25
# Times are off where velocities scatter this many times more than displacements and than they should.
_UNSTEADY = 2.5
_LEAST_CHANGES = 1
# A camera that changes its velocity faster than this, in m/s^2, and by more than so many deviations, does not: the time
# between two frames is wrong.
_JUMP_M_S2 = 40.0
_JUMP_STD = 10.0


class Watch:
    """Remembers what is usual."""

    def __init__(self) -> None:
        self._residuals: list[float] = []
        self._stops = 0
        self._velocity: F64 | None = None
        self._jumps = 0
        self._steps: list[tuple[float, float, float, float]] = []

    def is_repeated(self, residual: float, moved: F64, expected: F64 | None) -> bool:
        """Say whether a picture is the one before it again, encoded anew perhaps.

        Parameters
        ----------
        residual : float
            Root mean square of grey levels that the motion leaves.
        moved : (2,)
            Median displacement in pixels.
        expected : (2,), optional
            What the motion before made expected.
        """
        if expected is None or not np.isfinite(moved).all():
            return False
        way = math.hypot(*moved)
        jumped = way < _STILL_PX and math.hypot(*expected) > max(_EXPECTED_PX, 10.0 * way)
        # A camera that really stops says so again and again.
        self._stops = self._stops + 1 if jumped else 0
        if not jumped:
            return False
        usual = _median(np.array(self._residuals)) if self._residuals else 0.0
        return bool(residual < _QUIET * usual or self._stops <= _STOPS)

    def add(self, residual: float, speed: float, std: float, way: float, dt_s: float) -> None:
        """Take a frame: speed and its deviation in heights a second, way in heights."""
        if np.isfinite(residual):
            self._residuals = [*self._residuals, residual][-_FRAMES:]
        self._steps = [*self._steps, (speed, std, way, dt_s)][-_FRAMES:]

    def jump(self, velocity: F64, std: F64, dt_s: float) -> F64 | None:
        """Give by how much a velocity (3,) jumps from the one before, (3,); None where it may be so.

        One that stays is taken for true the second time.
        """
        before = self._velocity
        change = None if before is None else velocity - before
        most = max(_JUMP_M_S2 * dt_s, _JUMP_STD * float(np.linalg.norm(std)))
        if change is None or float(np.linalg.norm(change)) < most or self._jumps >= 2:
            self._velocity, self._jumps = velocity, 0
            return None
        self._jumps += 1
        return change

    def dt_std_s(self) -> float:
        """Deviation of the time between frames that a steady flow shows, in seconds; 0 where it shows none.

        Velocities that jump to and fro where the displacements themselves do not are those of times that are off: what
        is late once makes one interval too long and the next one too short.
        """
        steps = self._steps
        if len(steps) < _LEAST_CHANGES + 2:
            return 0.0
        times = [step[3] for step in steps]
        if max(times) - min(times) < 1e-9:
            return 0.0
        speed, std, way, dt = np.array(steps).T
        if not (speed > 0).all():
            return 0.0

        def scatter(values: F64) -> float:
            bend = values[1:-1] - 0.5 * (values[:-2] + values[2:])
            return _median(np.abs(bend)) / 0.6745

        usual = _median(dt)
        of_speed = scatter(speed) / _median(speed)
        of_way = scatter(way) / _median(way)
        noise = 1.2247 * _median(std / speed)
        if of_speed < _UNSTEADY * max(of_way, noise):
            return 0.0
        # The errors of neighbouring intervals are opposite by half: the bend has 2.5 times their variance.
        return float(of_speed / np.sqrt(2.5) * usual)

    def state(self) -> dict[str, Any]:
        """Everything that is known, to be kept."""
        return {
            "residuals": self._residuals,
            "steps": self._steps,
            "stops": self._stops,
            "velocity": self._velocity,
            "jumps": self._jumps,
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        self._residuals, self._steps, self._stops = kept["residuals"], kept["steps"], kept["stops"]
        self._velocity, self._jumps = kept["velocity"], kept["jumps"]


def _median(values: F64) -> float:
    """Give the middle of a few values: numpy's own takes ten times as long."""
    ordered = sorted(values.tolist())
    half = len(ordered) // 2
    return float(ordered[half] if len(ordered) % 2 else 0.5 * (ordered[half - 1] + ordered[half]))
