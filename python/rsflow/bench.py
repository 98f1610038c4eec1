"""Accuracy and time of rsflow beside OpenCV, on scenes whose motion is known exactly.

All methods of a subject take turns in every round of one run, with the same number of threads, so that what else the
machine does meets them alike; times are medians over the rounds. The scenes are those of `rsflow.synthetic`.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _checks, get_num_threads, set_num_threads
from ._core import __version__, build_info
from .camera.model import Camera
from .errors import FormatError
from .flow import dense_flow
from .shift import estimate_shift
from .synthetic import Lighting, flight_with_object, gain, shifted_pair
from .tracking.points import detect_corners, track_points

__all__ = ["BEGIN", "END", "Bench", "Row", "measure", "with_tables"]

# What stands between these lines of a Markdown file is rewritten by `with_tables`.
BEGIN = "<!-- bench-start -->"
END = "<!-- bench-end -->"

# Displacement of the pairs for points and dense flow, in pixels.
DISPLACEMENT = (7.25, -3.5)
# The longest component of the displacements for `estimate_shift`, in pixels: a sixth of the small window.
LONGEST = 10.0
POINTS = 400
LIGHTS: tuple[tuple[str, Lighting | None], ...] = (("steady light", None), ("gain 0.7, plus 20", gain(0.7, 20)))

Array = NDArray[Any]


@dataclass(frozen=True)
class Row:
    """What one method did on one scene.

    Attributes
    ----------
    subject : str
        "dense flow", "points" or "displacement".
    scene, method : str
    median_px, p95_px : float
        Median and 95th percentile of the length of the error, over what the method answers; NaN if that is nothing.
    answered : float
        Share of the windows, points or pixels, of those that stay in the picture, for which the method gives an answer.
    time_ms : float
        Median time of a call.

    Examples
    --------
    >>> row = Row("points", "made", "rsflow track_points", 0.006, 0.013, 0.96, 2.6)
    >>> row.median_px, row.time_ms
    (0.006, 2.6)
    """

    subject: str
    scene: str
    method: str
    median_px: float
    p95_px: float
    answered: float
    time_ms: float


@dataclass(frozen=True)
class Bench:
    """All rows of a run, and what it ran on.

    Attributes
    ----------
    rows : tuple of Row
    cpu_level : str
        The instructions that rsflow used.
    threads, rounds : int
    versions : dict
        Of rsflow, OpenCV, numpy and Python.

    Examples
    --------
    >>> row = Row("points", "made", "rsflow track_points", 0.006, 0.013, 0.96, 2.6)
    >>> Bench((row,), "avx2", 1, 9, {"rsflow": "0.1.0"}).conditions()
    'CPU level avx2, 1 thread, times are medians of 9 rounds; rsflow 0.1.0.'
    """

    rows: tuple[Row, ...]
    cpu_level: str
    threads: int
    rounds: int
    versions: dict[str, str]

    def conditions(self) -> str:
        """Say in one line what was measured on."""
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        counts = [
            f"{n} {what}{'' if n == 1 else 's'}" for n, what in ((self.threads, "thread"), (self.rounds, "round"))
        ]
        return f"CPU level {self.cpu_level}, {counts[0]}, times are medians of {counts[1]}; {versions}."

    def tables(self) -> str:
        """Write one Markdown table a subject, and the line of `conditions` below."""
        parts = []
        for subject in dict.fromkeys(row.subject for row in self.rows):
            cells = [(f"{subject}: scene", "method", "error: median", "95 %", "answered", "time")]
            last = ""
            for row in (row for row in self.rows if row.subject == subject):
                taken = f"{row.time_ms:.3g} ms" if row.time_ms < 100 else f"{row.time_ms:.0f} ms"
                cells.append((
                    "" if row.scene == last else row.scene, row.method, _pixels(row.median_px), _pixels(row.p95_px),
                    f"{100 * row.answered:.1f} %", taken,
                ))  # fmt: skip
                last = row.scene
            parts.append(_table(cells))
        return "\n\n".join([*parts, self.conditions()])


def _pixels(length: float) -> str:
    return f"{length:.4f} px" if np.isfinite(length) else "-"


def _table(cells: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[j]) for row in cells) for j in range(len(cells[0]))]

    def line(row: Sequence[str]) -> str:
        # The first two columns are words, the others numbers.
        padded = (f"{cell:{'<' if j < 2 else '>'}{widths[j]}}" for j, cell in enumerate(row))
        return f"| {' | '.join(padded)} |"

    rule = "|" + "|".join("-" * (w + 2) if j < 2 else "-" * (w + 1) + ":" for j, w in enumerate(widths)) + "|"
    return "\n".join([line(cells[0]), rule, *map(line, cells[1:])])


@dataclass(frozen=True)
class _Method:
    """A call to time, and how to read the motion from its result; NaN where it says that it has none."""

    name: str
    call: Callable[[Array, Array], Any]
    motion: Callable[[Any], Array]


@dataclass(frozen=True)
class _Scene:
    """Pairs (prev, next, motion); the motion is NaN where it leads out of the picture."""

    name: str
    pairs: tuple[tuple[Array, Array, Array], ...]


def measure(*, threads: int = 1, rounds: int = 9, quick: bool = False) -> Bench:
    """Measure rsflow and OpenCV in turns, on the same scenes with the same number of threads.

    Parameters
    ----------
    threads : int
        For rsflow and for OpenCV.
    rounds : int
        How often each method runs on each pair. One more round, not timed, comes first and gives the errors.
    quick : bool
        A quarter of the pixels and fewer pairs: to see that it works, not to quote.

    Returns
    -------
    Bench

    Raises
    ------
    OptionError
        If `threads` or `rounds` is below 1.

    Examples
    --------
    >>> from rsflow.bench import measure
    >>> found = measure(rounds=1, quick=True)
    >>> sorted({row.subject for row in found.rows})
    ['dense flow', 'displacement', 'points']
    """
    import cv2

    threads = _checks.integer("threads", threads, least=1, most=1024)
    rounds = _checks.integer("rounds", rounds, least=1, most=10_000)
    quick = _checks.flag("quick", quick)
    size = (320, 240) if quick else (640, 480)
    rows: list[Row] = []
    with _threads(threads):
        for scene in (*_shifted(size), _flown(size)):
            rows += _turns("dense flow", scene, _dense_methods(), rounds)
        for scene in _shifted(size):
            prev, _, motion = scene.pairs[0]
            points = detect_corners(prev, max_corners=POINTS)
            x, y = np.rint(points).astype(int).T
            scene = _Scene(scene.name, ((*scene.pairs[0][:2], motion[y, x]),))
            rows += _turns("points", scene, _point_methods(points), rounds)
        for window, pairs in (((60, 60), 8 if quick else 20), (size, 2 if quick else 5)):
            for scene in _displaced(window, pairs):
                rows += _turns("displacement", scene, _shift_methods(window), rounds)
    versions = {
        "rsflow": __version__, "OpenCV": cv2.__version__, "numpy": np.__version__, "Python": platform.python_version(),
    }  # fmt: skip
    return Bench(tuple(rows), str(build_info()["cpu_level"]), threads, rounds, versions)


def with_tables(text: str, bench: Bench | None, *, name: str = "the file") -> str:
    r"""Give the Markdown `text` with the tables of `bench` between the lines `BEGIN` and `END`.

    Parameters
    ----------
    text : str
    bench : Bench or None
        None changes nothing and only checks `text`.
    name : str
        What to call the text in an error.

    Returns
    -------
    str

    Raises
    ------
    FormatError
        If the two lines are not there once each, in this order.

    Examples
    --------
    >>> with_tables(f"{BEGIN}\nold\n{END}\n", None) == f"{BEGIN}\nold\n{END}\n"
    True
    """
    text, name = _checks.text("text", text), _checks.text("name", name)
    if bench is not None:
        _checks.instance("bench", bench, Bench, "a Bench or None")
    lines = [line.strip() for line in text.splitlines()]
    if (lines.count(BEGIN), lines.count(END)) != (1, 1) or lines.index(BEGIN) > lines.index(END):
        raise FormatError(
            f"{name}: {lines.count(BEGIN)} lines {BEGIN!r} and {lines.count(END)} lines {END!r}, "
            "expected one of each, in this order, around the tables"
        )
    if bench is None:
        return text
    kept = text.splitlines(keepends=True)
    begin, end = lines.index(BEGIN), lines.index(END)
    return "".join([*kept[: begin + 1], "\n", bench.tables(), "\n\n", *kept[end:]])


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Have rsflow and OpenCV use `count` threads, and what they used before at the end."""
    import cv2

    before = get_num_threads(), cv2.getNumThreads()
    try:
        set_num_threads(count)
        cv2.setNumThreads(count)
        yield
    finally:
        set_num_threads(before[0])
        cv2.setNumThreads(before[1])


def _turns(subject: str, scene: _Scene, methods: Sequence[_Method], rounds: int) -> list[Row]:
    errors: list[list[Array]] = [[] for _ in methods]
    times: list[list[float]] = [[] for _ in methods]
    for prev, after, motion in scene.pairs:
        known = np.isfinite(motion).all(axis=-1)
        for method, found in zip(methods, errors, strict=True):
            measured = np.asarray(method.motion(method.call(prev, after)), np.float64)
            found.append(np.linalg.norm(measured - motion, axis=-1)[known])
    for _ in range(rounds):
        for prev, after, _ in scene.pairs:
            for method, taken in zip(methods, times, strict=True):
                begin = time.perf_counter()
                method.call(prev, after)
                taken.append(1000.0 * (time.perf_counter() - begin))
    rows = []
    for method, found, taken in zip(methods, errors, times, strict=True):
        every = np.concatenate(found)
        error = every[np.isfinite(every)]
        median, p95 = np.percentile(error, (50, 95)) if error.size else (np.nan, np.nan)
        share = error.size / max(every.size, 1)
        rows.append(Row(subject, scene.name, method.name, float(median), float(p95), share, statistics.median(taken)))
    return rows


def _within(motion: Array) -> Array:
    """Put NaN where `motion` (height, width, 2) leads out of the picture."""
    height, width = motion.shape[:2]
    y, x = np.indices((height, width))
    to_x, to_y = x + motion[..., 0], y + motion[..., 1]
    inside = (to_x >= 0) & (to_x <= width - 1) & (to_y >= 0) & (to_y <= height - 1)
    return np.where(inside[..., None], motion, np.nan)


def _shifted(size: tuple[int, int]) -> Iterator[_Scene]:
    width, height = size
    for light, lighting in LIGHTS:
        pair = shifted_pair(*DISPLACEMENT, size=size, lighting=lighting, seed=1)
        motion = _within(np.broadcast_to(np.array(DISPLACEMENT), (height, width, 2)))
        yield _Scene(f"{width} x {height}, {light}", ((pair.prev, pair.next, motion),))


def _flown(size: tuple[int, int]) -> _Scene:
    """Fly over ground on which something crosses the camera's way, about 6 pixels a frame each."""
    width, height = size
    camera = Camera(width, width, (width - 1) / 2, (height - 1) / 2, width=width, height=height)
    # Focal length = width: the ground seen is 0.2 m wide, and 6 px are 0.2 * 6 / width metres in 1/30 s.
    speed = 0.2 * 6.0 / width * 30.0
    flight = flight_with_object(camera, frames=2, velocity_m_s=(speed, 0.3 * speed, 0.0), seed=1)
    prev, after = (frame.image for frame in flight)
    return _Scene(f"{width} x {height}, flight with an object", ((prev, after, _within(flight.flow(1))),))


def _displaced(size: tuple[int, int], count: int) -> Iterator[_Scene]:
    displacements = np.random.default_rng(1).uniform(-LONGEST, LONGEST, (count, 2))
    for light, lighting in LIGHTS:
        pairs = [shifted_pair(dx, dy, size=size, lighting=lighting, seed=k) for k, (dx, dy) in enumerate(displacements)]
        yield _Scene(
            f"{size[0]} x {size[1]}, {light}", tuple((p.prev, p.next, np.array([[p.dx, p.dy]])) for p in pairs)
        )


def _dense_methods() -> list[_Method]:
    import cv2

    # Every pixel counts, whether `valid` or not: OpenCV has no such mask, and the same pixels must be compared.
    methods = [
        _Method(f"rsflow dense_flow, {preset}", partial(dense_flow, preset=preset), np.asarray)
        for preset in ("fast", "balanced", "accurate")
    ]
    for preset in ("ultrafast", "fast", "medium"):
        number = getattr(cv2, f"DISOPTICAL_FLOW_PRESET_{preset.upper()}", None)
        number = getattr(cv2, f"DISOpticalFlow_PRESET_{preset.upper()}", number)
        if number is not None and hasattr(cv2, "DISOpticalFlow_create"):
            # Made once: it keeps its memory from call to call.
            dis: Any = cv2.DISOpticalFlow_create(number)
            methods.append(_Method(f"OpenCV DIS, {preset}", partial(_dis, dis), np.asarray))
    if hasattr(cv2, "calcOpticalFlowFarneback"):
        methods.append(_Method("OpenCV Farneback", _farneback, np.asarray))
    return methods


def _dis(dis: Any, prev: Array, after: Array) -> Any:
    return dis.calc(prev, after, None)


def _farneback(prev: Array, after: Array) -> Any:
    import cv2

    # The settings of OpenCV's own sample: pyramid of halves, 3 levels, window 15, 3 iterations, polynomials of 5.
    empty: Any = None
    return cv2.calcOpticalFlowFarneback(prev, after, empty, 0.5, 3, 15, 3, 5, 1.2, 0)


def _point_methods(points: Array) -> list[_Method]:
    import cv2

    def ours(tracks: Any) -> Array:
        return np.where(tracks.valid[:, None], tracks.points - points, np.nan)

    def track(prev: Array, after: Array) -> Any:
        return track_points(prev, after, points)

    def lean(prev: Array, after: Array) -> Any:
        return track_points(prev, after, points, max_forward_backward=None, illumination="none")

    def opencv(prev: Array, after: Array) -> Any:
        empty: Any = None
        return cv2.calcOpticalFlowPyrLK(prev, after, points, empty)

    def theirs(found: Any) -> Array:
        return np.where(found[1].reshape(-1, 1) == 1, found[0] - points, np.nan)

    return [
        _Method("rsflow track_points", track, ours),
        _Method("rsflow track_points, steady light, no check back", lean, ours),
        _Method("OpenCV calcOpticalFlowPyrLK", opencv, theirs),
    ]


def _shift_methods(size: tuple[int, int]) -> list[_Method]:
    import cv2

    hann = cv2.createHanningWindow(size, cv2.CV_32F)

    def opencv(prev: Array, after: Array) -> Any:
        # It takes floats alone, so that the conversion is part of its time.
        return cv2.phaseCorrelate(prev.astype(np.float32), after.astype(np.float32), hann)

    return [
        _Method("rsflow estimate_shift", estimate_shift, lambda shift: np.array([[shift.dx, shift.dy]])),
        _Method("OpenCV phaseCorrelate, Hann window", opencv, lambda found: np.array([found[0]])),
    ]
