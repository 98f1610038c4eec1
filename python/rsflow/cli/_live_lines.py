"""What ``rsflow live`` prints: a line a frame, or on a terminal one line that is written anew."""

from __future__ import annotations

import math
import shutil
import sys
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rsflow.live import LiveFrame, LiveReading

__all__ = ["Lines", "Status"]

# Columns that are left out where the terminal is too narrow, the first one first; the status stays.
_LEAST_NEEDED = ("t_s", "std_px", "vz_m_s", "frame", "dy_px", "dx_px")
# So much of the status is wanted beside the columns.
_STATUS = 12


class Lines:
    """A header and a line for each reading, as wide as the terminal at most.

    Parameters
    ----------
    with_velocity : bool
    width : int, optional
        Of the terminal; None where the output goes elsewhere.
    """

    def __init__(self, with_velocity: bool, width: int | None = None) -> None:
        names = ["frame", "t_s", "dx_px", "dy_px", "std_px"]
        names += ["vx_m_s", "vy_m_s", "vz_m_s"] if with_velocity else []
        widths = {"frame": 7, "t_s": 10, "std_px": 8}
        self._width = width
        for name in _LEAST_NEEDED:
            if width is None or sum(widths.get(one, 9) + 1 for one in names) + _STATUS <= width:
                break
            if name in names and (with_velocity or name not in ("dx_px", "dy_px")):
                names.remove(name)
        self._columns = [(name, widths.get(name, 9)) for name in names]

    def header(self) -> str:
        """Give the names of the columns."""
        return self._fitted(" ".join(f"{name:>{width}}" for name, width in self._columns) + "  status")

    def line(self, reading: LiveReading) -> str:
        """Give the line of a reading."""
        std = math.hypot(reading.dx_std_px, reading.dy_std_px) / math.sqrt(2.0)
        cells = []
        for name, width in self._columns:
            value = std if name == "std_px" else getattr(reading, name)
            places = {"frame": "", "t_s": ".3f", "dx_px": ".3f", "dy_px": ".3f"}.get(name, ".4f")
            cells.append(f"{value:>{width}{places}}")
        status = reading.status
        if reading.velocity_status not in (None, "ok"):
            status += f", velocity {reading.velocity_status}"
        return self._fitted(f"{' '.join(cells)}  {status}")

    def _fitted(self, text: str) -> str:
        return text if self._width is None else text[: self._width]


class Status:
    """One line on a terminal that says how it goes, written anew a few times a second.

    Parameters
    ----------
    stream : text stream, optional
        The terminal; standard error by default.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._length = 0
        self.frame: LiveFrame | None = None

    def show(self, waited_s: float, source: str) -> None:
        """Write the line; `waited_s` ago the last frame came."""
        width = shutil.get_terminal_size().columns - 1
        if waited_s > 1.0:
            self._write(f"{source}: no frame for {waited_s:.0f} s, trying again", width)
        elif self.frame is not None:
            self._write(self.text(self.frame, width), width)

    @staticmethod
    def text(frame: LiveFrame, width: int) -> str:
        """Give as much of how it goes as fits, the most important first."""
        told = frame.reading
        parts = [f"frame {frame.measured.frame.index}"]
        if told is not None and told.vx_m_s is not None and told.vy_m_s is not None:
            known = told.velocity_status == "ok"
            parts.append(
                f"v {told.vx_m_s:+.3g} {told.vy_m_s:+.3g} m/s" if known else f"no velocity: {told.velocity_status}"
            )
        elif told is not None:
            parts.append(f"{told.dx_px:+.2f} {told.dy_px:+.2f} px" if told.status == "ok" else told.status)
        things = sum(row["area_px"] > 0 for row in frame.measured.objects)
        parts.append(f"{things} thing{'' if things == 1 else 's'}")
        if math.isfinite(frame.frame_rate_hz):
            parts.append(f"{frame.frame_rate_hz:.0f}/s")
        if math.isfinite(frame.delay_s):
            parts.append(f"{1e3 * frame.delay_s:.0f} ms")
        if frame.not_measured:
            parts.append(f"{frame.not_measured} not measured")
        text = parts[0]
        for part in parts[1:]:
            if len(text) + 2 + len(part) <= width:
                text += f"  {part}"
        return text

    def _write(self, text: str, width: int) -> None:
        text = text[:width]
        self._stream.write("\r" + text.ljust(min(self._length, width)))
        self._stream.flush()
        self._length = len(text)

    def end(self) -> None:
        """Leave the line."""
        if self._length:
            self._stream.write("\n")
            self._stream.flush()
            self._length = 0
