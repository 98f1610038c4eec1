"""The whole job on made flights, timed beside one dense flow of OpenCV's DIS a frame, and by its parts."""

from __future__ import annotations

import itertools
import platform
import statistics
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .. import _checks, _core, extraction
from .. import flow as _flow
from .. import shift as _shift
from ..camera.model import Camera
from ..capture.stream import Frames
from ..extraction import outputs as _outputs
from ..extraction import rows as _rows
from ..extraction import run as _run
from ..extraction import views as _views
from ..extraction.trajectory import Trajectory
from ..segmentation.segmenter import MotionSegmenter
from ..synthetic import flight
from ..velocity import VelocityEstimator
from ..video import VideoWriter, sinks
from ._threads import threads as _threads
from .extract_tables import ExtractBench, ExtractRow, PartRow

__all__ = ["measure_extract", "parts"]

SIZES = ((640, 480), (320, 240), (64, 48))
HEIGHT_M = 1.0
# The first frames of a run wait for what is decided from them.
BEGIN = 20


def parts() -> dict[str, tuple[Any, str]]:
    """Give the parts of the job that are worth a line: a name, and the object and attribute that is called for it."""
    return {
        "read": (Frames, "__next__"),
        "displacement": (_shift, "estimate_shift"),
        "dense flow": (_flow.DenseFlow, "update"),
        "what moves": (MotionSegmenter, "update"),
        "velocity": (VelocityEstimator, "update"),
        "statistics of the flow": (_rows, "motion_row"),
        "path": (Trajectory, "add"),
        "tables": (_outputs.Outputs, "add"),
        "pictures drawn": (_views.Views, "_take"),
        "videos encoded": (sinks.AvSink if sinks.av_encoder("h264") else sinks.Cv2Sink, "write"),
        "report": (_run, "close"),
    }


def measure_extract(*, threads: int = 2, frames: int = 150, quick: bool = False) -> ExtractBench:
    """Measure how long `rsflow.extract` takes for a frame of a made flight, with velocity and path, and by its parts.

    Parameters
    ----------
    threads : int
        Of rsflow and of OpenCV.
    frames : int
        Of each clip.
    quick : bool
        40 frames: to see that it works, not to quote.

    Returns
    -------
    ExtractBench

    Raises
    ------
    OptionError
        If a number is below 1, or there are fewer than 40 frames.

    Examples
    --------
    >>> from rsflow.bench.extract_run import measure_extract
    >>> found = measure_extract(quick=True)  # doctest: +SKIP
    """
    import cv2

    threads = _checks.integer("threads", threads, least=1, most=1024)
    frames = _checks.integer("frames", frames, least=2 * BEGIN, most=100_000)
    frames = 2 * BEGIN if _checks.flag("quick", quick) else frames
    rows: list[ExtractRow] = []
    shares: list[PartRow] = []
    with tempfile.TemporaryDirectory(prefix="rsflow-") as folder:
        for size in SIZES:
            clip, camera = _flown(Path(folder), size, frames)
            with _threads(threads):
                rows += [_timed(clip, camera, size, videos) for videos in (False, True)]
            with _threads(1):
                shares += _shares(clip, camera, size, frames)
    versions = {
        "rsflow": _core.__version__, "OpenCV": cv2.__version__, "numpy": np.__version__,
        "Python": platform.python_version(),
    }  # fmt: skip
    level = str(_core.build_info()["cpu_level"])
    return ExtractBench(tuple(rows), tuple(shares), threads, level, frames, versions)


def _flown(folder: Path, size: tuple[int, int], frames: int) -> tuple[Path, Camera]:
    """Write a flight over the ground as a video."""
    width, height = size
    focal = 1.1 * width
    camera = Camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width=width, height=height)
    flown = flight(camera, frames=frames, height_m=HEIGHT_M, velocity_m_s=(0.15, 0.05, 0.0), seed=3)
    clip = folder / f"{width}.mp4"
    with VideoWriter(clip, frame_rate=30) as video:
        for picture in flown.images:
            video.write(picture)
    return clip, camera


def _timed(clip: Path, camera: Camera, size: tuple[int, int], videos: bool) -> ExtractRow:
    before = _dis(clip)
    stamps: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory(prefix="rsflow-") as out:
        extraction.extract(
            clip, out, camera=camera, height_m=HEIGHT_M, videos=videos,
            on_frame=lambda measured: stamps.append((time.perf_counter(), time.process_time())),
        )  # fmt: skip
    after = _dis(clip)
    count = len(stamps) - 1 - BEGIN
    taken, worked = (1000 * (stamps[-1][k] - stamps[BEGIN][k]) / count for k in (0, 1))
    outputs = "tables and videos" if videos else "tables"
    dis_taken, dis_worked = (min(before[k], after[k]) for k in (0, 1))
    return ExtractRow(size, outputs, taken, worked, dis_taken, dis_worked)


def _dis(clip: Path) -> tuple[float, float]:
    """Time DIS on the first frames: milliseconds a pair, the median by the clock and the mean of all processors."""
    import cv2

    from ..capture.opening import frames

    with frames(clip, stop=BEGIN + 1) as stream:
        pictures = [frame.image for frame in stream]
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    taken = []
    worked = time.process_time()
    for prev, image in itertools.pairwise(pictures):
        begin = time.perf_counter()
        dis.calc(prev, image, None)
        taken.append(time.perf_counter() - begin)
    return 1000 * statistics.median(taken), 1000 * (time.process_time() - worked) / len(taken)


def _shares(clip: Path, camera: Camera, size: tuple[int, int], frames: int) -> Iterator[PartRow]:
    spent: dict[str, float] = defaultdict(float)
    with _clocked(parts(), spent), tempfile.TemporaryDirectory(prefix="rsflow-") as out:
        worked = time.process_time()
        extraction.extract(clip, out, camera=camera, height_m=HEIGHT_M)
        worked = time.process_time() - worked
    spent["all else"] = worked - sum(spent.values())
    for part, seconds in spent.items():
        yield PartRow(size, part, 1000 * seconds / frames)


@contextmanager
def _clocked(hooks: dict[str, tuple[Any, str]], spent: dict[str, float]) -> Iterator[None]:
    """Add up the processor time of the calling thread in each part, less that of parts within it, while it lasts."""
    kept = {part: (owner, name, getattr(owner, name)) for part, (owner, name) in hooks.items()}
    within, lock = threading.local(), threading.Lock()

    def clock(part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def called(*args: Any, **options: Any) -> Any:
            outer, within.seconds = getattr(within, "seconds", 0.0), 0.0
            began = time.thread_time()
            try:
                return call(*args, **options)
            finally:
                taken = time.thread_time() - began
                with lock:
                    spent[part] += taken - within.seconds
                within.seconds = outer + taken

        return called

    try:
        for part, (owner, name, call) in kept.items():
            setattr(owner, name, clock(part, call))
        yield
    finally:
        for owner, name, call in kept.values():
            setattr(owner, name, call)
