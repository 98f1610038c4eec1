"""What things did over a sequence: how many, how fast, from where to where, along which paths."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import _checks, _display
from ...plotting import drawing, labels
from ..object_table import TrackedObject
from .lines import CountingLine, place

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    F64 = NDArray[np.float64]

__all__ = ["ObjectStatistics"]

# Speeds fall into so many bins, which become twice as wide where a speed lies beyond them; at first this wide.
_BINS, _FIRST_WIDTH = 64, 0.5
# The heat map has a cell for each square of so many pixels.
_CELL = 8
# All paths together have at most so many points; then each keeps every second one.
_MOST_POINTS = 200_000
# Counts of so many frames at most; then every second one is kept.
_MOST_COUNTS = 65_536


@dataclasses.dataclass
class _Path:
    first: tuple[int, float, float]
    last: tuple[int, float, float]
    frames: int
    points: list[tuple[int, float, float]]
    stride: int


class ObjectStatistics:
    """Gather what things did, frame after frame, in bounded memory.

    Parameters
    ----------
    lines : sequence of CountingLine
        Lines that are counted across; see there.
    scale_m_per_px : float, optional
        Metres on the ground for each pixel, for speeds in metres per second.

    Attributes
    ----------
    frames : int
        How many frames were given.
    lines : tuple of CountingLine

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.objects import CountingLine, ObjectStatistics, ObjectTracker
    >>> tracker, statistics = ObjectTracker(), ObjectStatistics(lines=[CountingLine(40, 60, 40, 0)])
    >>> for frame in range(10):
    ...     mask = np.zeros((60, 100), bool)
    ...     mask[20:40, 10 + 6 * frame : 20 + 6 * frame] = True
    ...     statistics.update(frame, tracker.update(mask, t_s=frame / 10), size=(100, 60))
    >>> found = statistics.to_dict()
    >>> found["things"], found["lines"][0]["to_right"], found["paths"]["1"]["entry_px"]
    (1, 1, [14.5, 29.5])
    >>> statistics.heat_map.shape, int(statistics.heat_map.max()), statistics.picture().shape
    ((8, 13), 3, (60, 100, 3))
    """

    def __init__(self, *, lines: Iterable[CountingLine] = (), scale_m_per_px: float | None = None) -> None:
        given = tuple(_checks.iterable("lines", lines, "CountingLines"))
        self.lines = tuple(_checks.instance("lines", line, CountingLine, "CountingLines") for line in given)
        self.scale_m_per_px = _checks.number_or_none("scale_m_per_px", scale_m_per_px, above=0, of="metres")
        self.frames = 0
        self._size = (0, 0)
        self._paths: dict[int, _Path] = {}
        self._points = 0
        self._counts: list[tuple[int, int]] = []
        self._count_stride = 1
        self._speeds: NDArray[np.int64] = np.zeros(_BINS, np.int64)
        self._width = _FIRST_WIDTH
        self._per_second = False
        self._heat: NDArray[np.int64] = np.zeros((0, 0), np.int64)

    def __repr__(self) -> str:
        return f"ObjectStatistics: {len(self._paths)} things in {self.frames} frames"

    def update(
        self,
        frame: int,
        objects: Iterable[TrackedObject],
        hidden: Iterable[TrackedObject] = (),
        *,
        size: tuple[int, int] | None = None,
    ) -> None:
        """Take the things of the next frame.

        Parameters
        ----------
        frame : int
            Its number in the source.
        objects : iterable of TrackedObject
            What is seen in it.
        hidden : iterable of TrackedObject
            What is predicted: it may cross a line, and counts for nothing else.
        size : (width, height), optional
            Of the frame, for the heat map and the picture; it is the same for all. By default as large as the boxes
            have been.
        """
        frame = _checks.integer("frame", frame)
        things = [
            _checks.instance("objects", thing, TrackedObject, "TrackedObjects")
            for thing in _checks.iterable("objects", objects, "TrackedObjects")
        ]
        self._grow(things, size)
        if self.frames % self._count_stride == 0:
            self._counts.append((frame, len(things)))
            if len(self._counts) > _MOST_COUNTS:
                self._counts, self._count_stride = self._counts[::2], 2 * self._count_stride
        self.frames += 1
        for thing in things:
            self._follow(frame, thing)
            self._add_speed(thing)
            left, top, width, height = thing.box
            rows = slice(max(top, 0) // _CELL, max(top + height - 1, 0) // _CELL + 1)
            self._heat[rows, max(left, 0) // _CELL : max(left + width - 1, 0) // _CELL + 1] += 1
        every = [*things, *_checks.iterable("hidden", hidden, "TrackedObjects")]
        for line in self.lines:
            line.update(every)

    def _grow(self, things: list[TrackedObject], size: tuple[int, int] | None) -> None:
        width, height = self._size if size is None else _checks.size("size", size)
        if size is None:
            width = max([width, *(thing.box[0] + thing.box[2] for thing in things)])
            height = max([height, *(thing.box[1] + thing.box[3] for thing in things)])
        self._size = width, height
        rows, columns = -(-height // _CELL), -(-width // _CELL)
        if self._heat.shape[0] < rows or self._heat.shape[1] < columns:
            heat = np.zeros((max(rows, self._heat.shape[0]), max(columns, self._heat.shape[1])), np.int64)
            heat[: self._heat.shape[0], : self._heat.shape[1]] = self._heat
            self._heat = heat

    def _follow(self, frame: int, thing: TrackedObject) -> None:
        x, y = place(thing)
        point = frame, x, y
        path = self._paths.get(thing.id)
        if path is None:
            path = self._paths[thing.id] = _Path(point, point, 0, [], 1)
        if path.frames % path.stride == 0:
            path.points.append(point)
            self._points += 1
        path.frames += 1
        path.last = point
        if self._points > _MOST_POINTS:
            self._points = 0
            for other in self._paths.values():
                other.points, other.stride = other.points[::2], 2 * other.stride
                self._points += len(other.points)

    def _add_speed(self, thing: TrackedObject) -> None:
        speed = thing.speed_px_s
        if math.isfinite(speed):
            self._per_second = True
        elif self._per_second:
            return
        else:
            speed = math.hypot(thing.vx_px_per_frame, thing.vy_px_per_frame)
        if not math.isfinite(speed):
            return
        while speed >= _BINS * self._width:
            self._speeds = np.concatenate([self._speeds.reshape(-1, 2).sum(axis=1), np.zeros(_BINS // 2, np.int64)])
            self._width *= 2
        self._speeds[int(speed / self._width)] += 1

    @property
    def heat_map(self) -> NDArray[np.int64]:
        """In how many frames a thing's box was at each square of 8 x 8 pixels, an array over rows and columns."""
        return self._heat.copy()

    @property
    def speed_histogram(self) -> tuple[NDArray[np.int64], F64]:
        """In how many frames things had each speed, and the 65 edges of the bins.

        In pixels per second, in metres per second with a scale; in pixels per frame where frames have no times.
        """
        return self._speeds.copy(), np.arange(_BINS + 1, dtype=np.float64) * (self._width * self._scale()[0])

    def _scale(self) -> tuple[float, str]:
        if not self._per_second:
            return 1.0, "px_per_frame"
        return (1.0, "px_s") if self.scale_m_per_px is None else (self.scale_m_per_px, "m_s")

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many things each frame showed, (n, 2): its number and the count; of a long sequence some frames."""
        return np.array(self._counts, np.int64).reshape(-1, 2)

    @property
    def paths(self) -> dict[int, F64]:
        """The path of each thing by its number, (n, 3): frame, x and y over the ground; of long ones some points."""
        found = {}
        for number, path in self._paths.items():
            points = path.points if path.points and path.points[-1] == path.last else [*path.points, path.last]
            found[number] = np.array(points, np.float64)
        return found

    def to_dict(self) -> dict[str, Any]:
        """Give everything as plain numbers, for JSON.

        Returns
        -------
        dict of str
            ``frames``, ``things``, ``count_median``, ``count_max``, ``speed_unit``, ``speed_median``,
            ``speed_edges`` with ``speed_counts``, ``lines``, and ``paths`` by number: ``first_frame``, ``last_frame``,
            ``frames``, ``entry_px`` and ``exit_px``, where it was seen first and last.
        """
        counts = self.counts[:, 1]
        speeds, edges = self.speed_histogram
        last = int(np.flatnonzero(speeds).max(initial=0)) + 1
        return {
            "frames": self.frames,
            "things": len(self._paths),
            "count_median": float(np.median(counts)) if len(counts) else 0.0,
            "count_max": int(counts.max(initial=0)),
            "speed_unit": self._scale()[1],
            "speed_median": self._median_speed(),
            "speed_edges": edges[: last + 1].tolist(),
            "speed_counts": speeds[:last].tolist(),
            "lines": [line.to_dict() for line in self.lines],
            "paths": {
                str(number): {
                    "first_frame": path.first[0],
                    "last_frame": path.last[0],
                    "frames": path.frames,
                    "entry_px": list(path.first[1:]),
                    "exit_px": list(path.last[1:]),
                }
                for number, path in self._paths.items()
            },
        }

    def _median_speed(self) -> float | None:
        """Median of the speeds, to within its bin, None without any."""
        total = int(self._speeds.sum())
        if not total:
            return None
        below = np.cumsum(self._speeds)
        at = int(np.searchsorted(below, total / 2))
        share = (total / 2 - (below[at] - self._speeds[at])) / self._speeds[at]
        return float((at + share) * self._width * self._scale()[0])

    def picture(self, background: NDArray[Any] | None = None) -> NDArray[np.uint8]:
        """Draw the paths and the lines with their counts over where things have been.

        A path goes from a ring to a disc, with the thing's number where there is room for it.

        Parameters
        ----------
        background : ndarray, optional
            What to draw on, of the frames' size: the scene without things, say. By default the heat map in grey.

        Returns
        -------
        ndarray of uint8, (height, width, 3)
            Blue, green, red.

        Raises
        ------
        ShapeError, DTypeError
            If the background is no picture.
        """
        width, height = self._size
        if background is not None:
            out = _display.displayed(_checks.picture("background", background))
        else:
            most = max(float(self._heat.max(initial=0)), 1.0)
            grey = np.sqrt(self._heat / most) * 160
            large = np.repeat(np.repeat(grey.astype(np.uint8), _CELL, axis=0), _CELL, axis=1)[:height, :width]
            out = np.repeat(large[..., None], 3, axis=2)
        out = np.ascontiguousarray(out)
        ends, names, colors = [], [], []
        for number, path in self.paths.items():
            if len(path) > 1:
                color = drawing.distinct_color(number)
                drawing.rimmed(out, drawing.Strokes([path[:, 1:]], color))
                drawing.disc(out, path[0, 1:], 3, color)
                drawing.disc(out, path[0, 1:], 2, (255, 255, 255))
                drawing.disc(out, path[-1, 1:], 3, color)
                x, y = (round(float(place)) for place in path[-1, 1:])
                ends.append((x - 4, y - 4, x + 4, y + 4))
                names.append(str(number))
                colors.append(color)
        labels.draw_labels(out, ends, names, colors)
        for line in self.lines:
            x0, y0, x1, y1 = line.ends
            drawing.polylines(out, [np.array([[x0, y0], [x1, y1]])], (255, 255, 255), 2)
            told = f"{line.to_right} > < {line.to_left}"
            drawing.put_text(out, told, (int((x0 + x1) / 2) + 4, int((y0 + y1) / 2)), color=(255, 255, 255))
        return out
