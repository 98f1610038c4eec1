"""Velocities filtered over time, as a table beside those that were measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .tables import CsvTable

if TYPE_CHECKING:
    from ..velocity import Velocity

__all__ = ["Filtered"]


class Filtered:
    """Rows of ``filtered.csv``; none where there is nothing to filter by.

    Parameters
    ----------
    walk_m_s2 : float or None
        `VelocityFilter`'s ``acceleration_walk_m_s2``.
    constant_height : bool
        Whether all frames have one height, wrong alike, rather than each a height of its own.
    """

    def __init__(self, walk_m_s2: float | None, *, constant_height: bool) -> None:
        from ..velocity import VelocityFilter

        causes = ("focal length", "principal point", "gyro", "attitude")
        common = ("height", *causes) if constant_height else causes
        self._filter = None if walk_m_s2 is None else VelocityFilter(acceleration_walk_m_s2=walk_m_s2, common=common)
        self._rows: list[dict[str, Any]] = []

    def add(self, velocity: Velocity, frame: int, known: dict[str, Any]) -> None:
        """Take the velocity of the next frame, with what it was computed with."""
        if self._filter is not None:
            # The velocity's own rate has what was learned of the gyro taken off.
            rate = None if np.isfinite(velocity.rate_rad_s).all() else known["rate_rad_s"]
            now = self._filter.update(velocity, rate_rad_s=rate, down=known["down"])
            self._rows.append({"frame": frame, **now.to_dict()})

    def write(self, path: Path) -> bool:
        """Write the table, where there is one."""
        if self._rows:
            with CsvTable(path, tuple(self._rows[0])) as table:
                for row in self._rows:
                    table.append(row)
        return bool(self._rows)
