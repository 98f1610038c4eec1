"""Accuracy, honesty and time of rsflow and its rivals by kind of scene, all in turns in one run."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._core import __version__, build_info
from ..tracking import detect_corners
from ._threads import threads as threads_of
from .kinds_methods import REFERENCE, SUBJECTS, Answer, Method, methods_of, missing
from .kinds_scenes import Kind, Scene, Shape, kinds
from .kinds_tables import KindRow, KindsBench, SizeRow

__all__ = ["measure_kinds"]

Array = NDArray[Any]

# Sure: said to hold. Wrong: off by more than so many pixels, and by more than so many of the deviations that it states.
WRONG_PX, WRONG_DEVIATIONS = 0.5, 5.0
POINTS = 300
# What takes so many times as long as rsflow's own is called once a scene, and not again for its time.
PATIENCE = 20.0
# Scenes of a kind on which times are taken.
TIMED = 3
# A size is left out where a call would take longer than this, by the one before it.
LONGEST_S = 1.0
# What windows of 64 pixels need.
GRID_ROWS = 200
SIZES = ((64, 48), (160, 120), (320, 240), (640, 480), (1280, 720), (1920, 1080))


def measure_kinds(
    *,
    only: Sequence[str] | None = None,
    rounds: int = 3,
    threads: int = 1,
    quick: bool = False,
    progress: Callable[[str], object] | None = None,
) -> KindsBench:
    """Measure dense flow, points, displacement and grids by kind of motion, light, content, noise and overlays.

    Beside `rsflow.dense_flow` (four presets) OpenCV's DIS and Farneback, scikit-image's TV-L1 and ILK; beside
    `rsflow.track_points` OpenCV's calcOpticalFlowPyrLK, alone and with a check back; beside `rsflow.estimate_shift`
    OpenCV's phaseCorrelate and scikit-image's phase_cross_correlation; beside `rsflow.displacement_grid` OpenPIV.
    What is not installed is left out. The scenes are those of `rsflow.synthetic`, two of 320 x 240 pixels of each kind,
    twenty of 160 x 120 for a displacement.

    Parameters
    ----------
    only : sequence of str, optional
        Subjects, groups or kinds whose name begins with one of these, and no times by size; by default all.
    rounds : int
        How often each method is timed on each of up to three scenes of a kind; what takes twenty times as long as
        rsflow's own is timed once.
    threads : int
        For rsflow and for OpenCV. Times of one thread are the processor's, which other work hardly touches; those of
        several are by the clock.
    quick : bool
        Fewer and smaller scenes, without TV-L1 and ILK: to see that it works, not to quote.
    progress : callable, optional
        Called with what is measured next.

    Returns
    -------
    KindsBench

    Raises
    ------
    OptionError
        If a number is below 1, or nothing is called as in `only`.

    Examples
    --------
    >>> from rsflow.bench import measure_kinds
    >>> found = measure_kinds(only=["shift of 3"], rounds=1, quick=True)
    >>> row = next(row for row in found.rows if row.method == "rsflow estimate_shift")
    >>> row.kind, row.median_px < 0.05, row.wrong
    ('shift of 3 px', True, 0.0)
    """
    rounds = _checks.integer("rounds", rounds, least=1, most=10_000)
    threads = _checks.integer("threads", threads, least=1, most=1024)
    quick = _checks.flag("quick", quick)
    told = (lambda name: None) if progress is None else _checks.function("progress", progress, 1)
    every, wanted = kinds(), _chosen(only)
    clock = time.process_time if threads == 1 else time.perf_counter
    made = {subject: methods_of(subject, quick=quick) for subject in SUBJECTS}
    rows: list[KindRow] = []
    sizes: list[SizeRow] = []
    with threads_of(threads):
        for kind in every:
            subjects = [subject for subject in SUBJECTS if (kind.name, subject) in wanted]
            if subjects:
                told(f"{kind.group}: {kind.name}")
                rows += _rows(kind, {subject: made[subject] for subject in subjects}, rounds, quick, clock)
        for subject in SUBJECTS if only is None else ():
            told(f"times by size: {subject}")
            sizes += _by_size(subject, made[subject], rounds, SIZES[:2] if quick else SIZES, clock)
    # By subject, then in the order of the kinds.
    rows.sort(key=lambda row: SUBJECTS.index(row.subject))
    return KindsBench(
        tuple(rows), tuple(sizes), _cpu(), str(build_info()["cpu_level"]), threads, rounds, _versions(), missing()
    )


def _chosen(only: Sequence[str] | None) -> set[tuple[str, str]]:
    """Give the (kind, subject) that are measured."""
    pairs = [(kind, subject) for kind in kinds() for subject in kind.subjects]
    if only is None:
        return {(kind.name, subject) for kind, subject in pairs}
    if isinstance(only, str):
        raise _checks.refused("only", only, "a sequence of names, or of their beginnings")
    begins = [_checks.text("only", name) for name in _checks.iterable("only", only, "names of kinds")]
    chosen: set[tuple[str, str]] = set()
    for begin in begins:
        found = {
            (kind.name, subject) for kind, subject in pairs
            if any(name.startswith(begin) for name in (kind.name, kind.group, subject))
        }  # fmt: skip
        if not found:
            names = dict.fromkeys([*SUBJECTS, *(kind.group for kind, _ in pairs), *(kind.name for kind, _ in pairs)])
            raise _checks.refused("only", begin, f"the beginning of one of: {'; '.join(names)}")
        chosen |= found
    return chosen


def _rows(
    kind: Kind, methods: dict[str, list[Method]], rounds: int, quick: bool, clock: Callable[[], float]
) -> list[KindRow]:
    """Measure one kind for some subjects, over scenes that those which look at pictures share."""
    size, count = ((160, 120), 1) if quick else ((320, 240), 2)
    windows = ((96, 72) if quick else (160, 120), 3 if quick else 20)
    rows: list[KindRow] = []
    pictures = [kind.make(Shape(size, seed + 1)) for seed in range(count)] if set(methods) - {"displacement"} else []
    for subject, each in methods.items():
        scenes = pictures
        if subject == "displacement":
            scenes = [kind.make(Shape(windows[0], seed + 1, turned=False)) for seed in range(windows[1])]
        found: dict[str, list[_Seen]] = {method.name: [] for method in each}
        times: dict[str, list[float]] = {method.name: [] for method in each}
        for number, scene in enumerate(scenes):
            points = _points(scene) if subject == "points" else np.zeros((0, 2), np.float32)
            if subject == "points" and not len(points):
                continue
            first: dict[str, float] = {}
            for method in each:
                begin = clock()
                answer = method.answer((method.told or method.call)(scene, points), scene, points)
                first[method.name] = clock() - begin
                found[method.name].append(_Seen.of(answer, scene, whole=subject == "displacement"))
            if number < TIMED:
                once = {name for name, taken in first.items() if taken > PATIENCE * first[REFERENCE[subject]]}
                for name in once:
                    times[name].append(first[name])
                _turns([method for method in each if method.name not in once], scene, points, rounds, times, clock)
        reference = float(np.median(times[REFERENCE[subject]])) if times[REFERENCE[subject]] else np.nan
        for method in each:
            taken = float(np.median(times[method.name])) if times[method.name] else np.nan
            rows.append(_row(subject, kind, method.name, found[method.name], 1000.0 * taken, taken / reference))
    return rows


def _turns(
    methods: Sequence[Method],
    scene: Scene,
    points: Array,
    rounds: int,
    times: dict[str, list[float]],
    clock: Callable[[], float],
) -> None:
    for _ in range(rounds):
        for method in methods:
            begin = clock()
            method.call(scene, points)
            times[method.name].append(clock() - begin)


def _points(scene: Scene) -> Array:
    """Give corners, at whole pixels: there the truth is known exactly."""
    corners = np.unique(np.rint(detect_corners(scene.prev, max_corners=POINTS, mask=scene.mask)), axis=0)
    x, y = corners.astype(np.intp).T
    known = ~np.isnan(scene.flow[y, x]).any(axis=1)
    return np.asarray(corners[known], np.float32)


class _Seen:
    """Errors of the answers of one scene, beside what was said of them."""

    def __init__(self, error: Array, valid: Array, wrong: Array, counts: Array, within: Array) -> None:
        # Of every place with a truth: length of the error, said to hold, sure and wrong, stays in the picture;
        # of those that hold and stay: whether each component is within two deviations.
        self.error, self.valid, self.wrong, self.counts, self.within = error, valid, wrong, counts, within

    @classmethod
    def of(cls, answer: Answer, scene: Scene, *, whole: bool) -> _Seen:
        places = answer.places
        truth = _truth(scene, answer)
        x, y = np.rint(places).astype(np.intp).T
        height, width = scene.prev.shape
        x, y = x.clip(0, width - 1), y.clip(0, height - 1)
        known = ~np.isnan(truth).any(axis=1)
        if not whole:
            known &= ~np.isnan(scene.flow[y, x]).any(axis=1)
        # The middle of a window stays a window's middle, wherever it goes.
        stays = np.asarray(np.isfinite(truth).all(axis=1))
        if not whole:
            stays &= scene.seen[y, x]
        with np.errstate(invalid="ignore"):
            off = answer.motion - truth
            error = np.where(np.isfinite(answer.motion).all(axis=1), np.hypot(off[:, 0], off[:, 1]), np.inf)
        limit = np.full(len(error), WRONG_PX)
        if answer.deviation is not None:
            limit = np.maximum(limit, WRONG_DEVIATIONS * answer.deviation)
        wrong = answer.valid & (error > limit)
        within = np.zeros((0, 2), np.bool_)
        if answer.std is not None:
            within = np.abs(off)[known & stays & answer.valid] <= 2.0 * answer.std[known & stays & answer.valid]
        return cls(error[known], answer.valid[known], wrong[known], stays[known], within)


def _truth(scene: Scene, answer: Answer) -> Array:
    places = answer.places
    if scene.truth is None:
        x, y = np.rint(places).astype(np.intp).T
        return np.asarray(scene.flow[y, x])
    if not answer.halfway:
        return scene.truth(places[:, 0], places[:, 1])
    # Of what is there half of the way on: where it began, by a fixed point.
    began = places
    for _ in range(30):
        moved = scene.truth(began[:, 0], began[:, 1])
        began = places - 0.5 * np.where(np.isfinite(moved), moved, 0.0)
    return scene.truth(began[:, 0], began[:, 1])


def _row(subject: str, kind: Kind, method: str, found: list[_Seen], time_ms: float, times: float) -> KindRow:
    joined = {
        name: np.concatenate([getattr(seen, name) for seen in found]) if found else np.zeros(0, np.bool_)
        for name in ("error", "valid", "wrong", "counts", "within")
    }
    error, valid, counts, within = (joined[name] for name in ("error", "valid", "counts", "within"))
    # Of dense flow every pixel counts, said to hold or not: most rivals do not say, and the same pixels are compared.
    asked = counts if subject == "dense flow" else counts & valid
    lengths = error[asked & np.isfinite(error)]
    median, p95 = np.percentile(lengths, (50, 95)) if lengths.size else (np.nan, np.nan)
    # Where nothing is to be found, every answer counts.
    shown = counts if counts.any() else np.ones_like(counts)
    return KindRow(
        subject=subject,
        group=kind.group,
        kind=kind.name,
        method=method,
        median_px=float(median),
        p95_px=float(p95),
        answered=float(valid[shown].mean()) if shown.size else 0.0,
        wrong=float(joined["wrong"].mean()) if error.size else 0.0,
        within_2=float(within.mean()) if within.size else np.nan,
        time_ms=time_ms,
        times=times,
    )


def _by_size(
    subject: str,
    methods: Sequence[Method],
    rounds: int,
    sizes: Sequence[tuple[int, int]],
    clock: Callable[[], float],
) -> list[SizeRow]:
    """Time every method on pictures of each size, smaller ones first."""
    steady = next(kind for kind in kinds() if kind.name == "steady")
    rows: list[SizeRow] = []
    expected = {method.name: 0.0 for method in methods}
    pixels = 1
    for size in sizes:
        scene = steady.make(Shape(size, 1, turned=subject != "displacement"))
        points = _points(scene)
        grown = size[0] * size[1] / pixels
        able = [
            m
            for m in methods
            if expected[m.name] * grown < LONGEST_S and not (subject == "grid" and size[1] < GRID_ROWS)
        ]
        times: dict[str, list[float]] = {method.name: [] for method in able}
        _turns(able, scene, points, 1 + rounds, times, clock)
        # The first call is a warm-up.
        medians = {name: float(np.median(taken[1:])) for name, taken in times.items()}
        reference = medians.get(REFERENCE[subject], np.nan)
        rows += [SizeRow(subject, size, name, 1000.0 * taken, taken / reference) for name, taken in medians.items()]
        expected |= medians
        pixels = size[0] * size[1]
    return rows


def _cpu() -> str:
    """Name the processor, as far as the system does."""
    listed = Path("/proc/cpuinfo")
    if listed.is_file():
        for line in listed.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _versions() -> dict[str, str]:
    import cv2

    found = {"rsflow": __version__, "OpenCV": cv2.__version__}
    for package, name in (("scikit-image", "scikit-image"), ("openpiv", "OpenPIV")):
        try:
            found[name] = version(package)
        except PackageNotFoundError:
            continue
    return found | {"numpy": np.__version__, "Python": platform.python_version()}
