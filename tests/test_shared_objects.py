"""Streaming objects in several threads, over a fork, as copies and as pickles."""

from __future__ import annotations

import concurrent.futures
import copy
import enum
import os
import pickle
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsflow
from rsflow.objects import ObjectTracker

SIZE = (120, 160)


def scene(index: int, dtype: type = np.uint8) -> np.ndarray:
    """A picture that moves by (2, 1) pixels a frame, with a square that moves by itself."""
    random = np.random.default_rng(3).standard_normal((SIZE[0] + 60, SIZE[1] + 60))
    for axis in (0, 1):
        for _ in range(3):
            random = (np.roll(random, 1, axis) + random + np.roll(random, -1, axis)) / 3
    grey = np.round((random - random.min()) / np.ptp(random) * 200 + 20)
    frame = grey[30 - index : 30 - index + SIZE[0], 40 - 2 * index : 40 - 2 * index + SIZE[1]].copy()
    frame[50:70, 40 + 5 * index : 60 + 5 * index] = grey[:20, :20]
    return frame.astype(dtype)


def numbers(value: Any) -> Any:
    """All that a result says, as bytes and plain values, to compare it bit by bit."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, dict):
        return {name: numbers(part) for name, part in value.items()}
    if hasattr(value, "__getstate__") and hasattr(value, "update"):
        return numbers(value.__getstate__())
    if hasattr(value, "__dict__"):
        return {name: numbers(part) for name, part in vars(value).items()}
    if isinstance(value, (tuple, list)):
        return [numbers(part) for part in value]
    return repr(value)


MASK = np.arange(SIZE[1]) % 50 > np.zeros((SIZE[0], 1))


class Velocity:
    """A velocity estimator with the call of the others."""

    def __init__(self, mask: np.ndarray | None = None) -> None:
        camera = rsflow.Camera(200.0, 200.0, SIZE[1] / 2, SIZE[0] / 2, width=SIZE[1], height=SIZE[0])
        self.estimator = rsflow.VelocityEstimator(camera, height_m=0.2, mask=mask)
        self.t_s = 0.0

    def update(self, frame: np.ndarray) -> rsflow.Velocity:
        self.t_s += 0.1
        return self.estimator.update(frame, self.t_s)


class Filter(Velocity):
    """A filter over the velocities of an estimator."""

    def __init__(self) -> None:
        super().__init__()
        self.kalman = rsflow.VelocityFilter()

    def update(self, frame: np.ndarray) -> Any:
        return self.kalman.update(super().update(frame))


class Objects:
    """An object tracker with the call of the others."""

    def __init__(self) -> None:
        self.tracker = ObjectTracker(min_area=20)

    def update(self, frame: np.ndarray) -> Any:
        return self.tracker.update(frame > 150), self.tracker.labels


MAKERS: dict[str, Callable[[], Any]] = {
    "DenseFlow": lambda: rsflow.DenseFlow(preset="fast"),
    "DenseFlow with a mask": lambda: rsflow.DenseFlow(mask=MASK),
    "PointTracker": lambda: rsflow.PointTracker(max_corners=60, record=True),
    "PointTracker with a mask": lambda: rsflow.PointTracker(max_corners=60, mask=MASK),
    "MotionSegmenter": lambda: rsflow.MotionSegmenter(),
    "MotionSegmenter of a static camera": lambda: rsflow.MotionSegmenter(camera_motion="static"),
    "MotionSegmenter with a mask": lambda: rsflow.MotionSegmenter(mask=MASK),
    "VelocityEstimator": Velocity,
    "VelocityEstimator with a mask": lambda: Velocity(MASK),
    "VelocityFilter": Filter,
    "ObjectTracker": Objects,
}


@pytest.mark.parametrize("way", ["copy", "deepcopy", "pickle"])
@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("before", [0, 1, 3])
def test_a_copy_goes_on_with_the_same_bits(name: str, way: str, before: int):
    make = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda it: pickle.loads(pickle.dumps(it))}[way]
    if way == "copy" and name.split()[0] in ("VelocityEstimator", "VelocityFilter", "ObjectTracker"):
        pytest.skip("a wrapper of this test is no estimator")
    original, straight = MAKERS[name](), MAKERS[name]()
    for index in range(before):
        original.update(scene(index))
        straight.update(scene(index))
    other = make(original)
    for index in range(before, before + 3):
        want = numbers(straight.update(scene(index)))
        # What the one does leaves the other alone.
        assert numbers(other.update(scene(index))) == want
        assert numbers(original.update(scene(index))) == want


@pytest.mark.parametrize("name", MAKERS)
def test_a_pickle_is_the_same_each_time_and_goes_on_in_another_process(name: str, tmp_path: Path):
    stream = MAKERS[name]()
    for index in range(3):
        stream.update(scene(index))
    data = pickle.dumps(stream)
    assert pickle.dumps(stream) == data
    assert numbers(pickle.loads(data)) == numbers(stream)
    (tmp_path / "state").write_bytes(data)
    code = (
        "import pathlib, pickle, sys; sys.path.insert(0, sys.argv[1]); import test_shared_objects as t; "
        "stream = pickle.loads(pathlib.Path(sys.argv[2]).read_bytes()); "
        "pathlib.Path(sys.argv[3]).write_bytes(pickle.dumps(t.numbers(stream.update(t.scene(3)))))"
    )
    arguments = [str(Path(__file__).parent), str(tmp_path / "state"), str(tmp_path / "found")]
    subprocess.run([sys.executable, "-c", code, *arguments], check=True, timeout=120)
    assert pickle.loads((tmp_path / "found").read_bytes()) == numbers(stream.update(scene(3)))


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_state_keeps_every_bit_of_deep_and_broken_frames(dtype: type):
    frames = [scene(index, dtype) * dtype(200) for index in range(3)]
    if dtype is np.float32:
        frames[0][10:20, 10:20] = np.nan
        frames[1][60, 60] = np.inf
    for make in (lambda: rsflow.DenseFlow(preset="fast"), rsflow.PointTracker):
        stream = make()
        for frame in frames[:2]:
            stream.update(frame)
        other = pickle.loads(pickle.dumps(stream))
        assert numbers(other.update(frames[2])) == numbers(stream.update(frames[2]))


@pytest.mark.parametrize("name", ["DenseFlow", "PointTracker"])
def test_a_damaged_state_is_an_error_that_names_the_part(name: str):
    stream = MAKERS[name]()
    stream.update(scene(0))
    stream.update(scene(1))
    core = {"DenseFlow": "_core", "PointTracker": "_tracker"}[name]
    state = stream.__getstate__()
    values = [None, "text", -1, 2**80, np.zeros((3, 3), np.float32), np.zeros(7, np.int16), [], np.full((2, 2), np.nan)]
    for part in state["state"][core]:
        for value in [*values, "gone"]:
            damaged = copy.deepcopy(state)
            damaged["state"][core][part] = value
            if isinstance(value, str) and value == "gone":
                del damaged["state"][core][part]
            other = type(stream).__new__(type(stream))
            try:
                other.__setstate__(damaged)
                other.update(scene(2))
            except rsflow.InternalError:
                pytest.fail(f"{part} = {value!r}")
            except rsflow.RsflowError:
                pass
    other = type(stream).__new__(type(stream))
    for damaged in (None, {}, {"version": 99, "state": {}}, {"version": 1, "state": {}}, {"version": 1, "state": 5}):
        with pytest.raises(rsflow.FormatError, match=f"the state of a {name} is"):
            other.__setstate__(damaged)


@pytest.mark.parametrize("name", MAKERS)
def test_threads_that_share_an_object_wait_for_each_other(name: str):
    """Each call is whole: none fails, and the numbers that the calls give are those of some order of the calls."""
    stream = MAKERS[name]()
    frames = [scene(index) for index in range(4)]
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        results = list(pool.map(lambda index: stream.update(frames[index % 4]), range(32)))
    assert len(results) == 32
    if name == "PointTracker":
        new = [number for tracks in results for number in tracks.ids[tracks.ages == 0]]
        assert len(new) == len(set(new))
    if name.startswith("DenseFlow"):
        assert sum(result is None for result in results) == 1


def test_a_child_forked_while_another_thread_is_in_an_object_works_or_raises_at_once():
    if not hasattr(os, "fork"):
        pytest.skip("this system has no fork")
    code = textwrap.dedent(
        """
        import os, signal, sys, threading, time, warnings
        warnings.simplefilter("ignore")
        sys.path.insert(0, sys.argv[1])
        import test_shared_objects as t
        import numpy as np, rsflow
        large = np.random.default_rng(0).integers(0, 255, (900, 1200), dtype=np.uint8)
        small = [t.scene(index) for index in range(2)]
        counts = {"raised": 0, "worked": 0, "other": 0}
        for make in (lambda: rsflow.DenseFlow(), rsflow.PointTracker, rsflow.MotionSegmenter):
            stream, going = make(), True
            def work():
                while going:
                    stream.update(large)
            thread = threading.Thread(target=work)
            thread.start()
            for delay in (0.05, 0.1, 0.15, 0.2, 0.25):
                time.sleep(delay)
                child = os.fork()
                if child == 0:
                    signal.alarm(60)
                    try:
                        try:
                            stream.update(large)
                            code = 0
                        except rsflow.RsflowError as error:
                            code = 1 if "fork" in str(error) else 2
                        stream.reset()
                        stream.update(small[0])
                        stream.update(small[1])
                        os._exit(code)
                    except BaseException:
                        import traceback
                        traceback.print_exc()
                        os._exit(9)
                code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
                counts[{0: "worked", 1: "raised"}.get(code, "other")] += 1
            going = False
            thread.join()
        print(counts)
        """
    )
    arguments = [sys.executable, "-c", code, str(Path(__file__).parent)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=600, check=True)
    counts = eval(done.stdout)
    assert counts["other"] == 0, done.stderr
    assert counts["raised"] > 0, "no child was forked in the midst of a call"


def test_a_handler_that_calls_the_object_it_interrupts_gets_an_error():
    code = textwrap.dedent(
        """
        import os, signal, threading, time
        import numpy as np, rsflow
        frame = np.random.default_rng(0).integers(0, 255, (2000, 2500), dtype=np.uint8)
        flow = rsflow.DenseFlow(preset="accurate")
        found = []
        def handler(*_):
            try:
                flow.update(frame)
            except rsflow.RsflowError as error:
                found.append(str(error))
        signal.signal(signal.SIGUSR1, handler)
        flow.update(frame)
        threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGUSR1)).start()
        while not found:
            flow.update(frame)
        print(found[0])
        """
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert "of this very thread" in done.stdout


def test_a_waiting_thread_gives_way_to_others():
    """Two threads in one object do not keep a third one, which has its own, from working."""
    stream, going, count = rsflow.DenseFlow(preset="fast"), True, 0

    def work() -> None:
        while going:
            stream.update(scene(0))

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    own, end = rsflow.PointTracker(max_corners=20), time.monotonic() + 1
    while time.monotonic() < end:
        own.update(scene(count % 4))
        count += 1
    going = False
    for thread in threads:
        thread.join()
    assert count > 3


@pytest.mark.parametrize("used", [False, True])
@pytest.mark.parametrize("name", ["MotionSegmenter", "VelocityEstimator", "ObjectTracker"])
def test_a_state_without_an_attribute_or_with_another_thing_for_it_is_damaged(name: str, used: bool):
    flight = rsflow.synthetic.flight(frames=2, height_m=0.2, seed=1)
    segmenter, tracker = rsflow.MotionSegmenter(), ObjectTracker()
    estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    for index, image in enumerate(flight.images if used else ()):
        tracker.update(segmenter.update(image).moving)
        estimator.update(image, index / 30)
    thing: Any = {"MotionSegmenter": segmenter, "VelocityEstimator": estimator, "ObjectTracker": tracker}[name]
    state = thing.__getstate__()
    other = type(thing).__new__(type(thing))
    other.__setstate__(copy.deepcopy(state))
    for part in state["state"]:
        lacking, wrong = copy.deepcopy(state), copy.deepcopy(state)
        del lacking["state"][part]
        wrong["state"][part] = b"x"
        for damaged in (lacking, wrong):
            with pytest.raises(rsflow.FormatError, match=f"the state of a {name} is damaged: .*{part}"):
                other.__setstate__(damaged)
