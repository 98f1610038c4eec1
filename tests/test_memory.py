"""Too little memory, sizes that no memory holds, and panics: an exception each, and the objects go on."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import rsflow

PRELUDE = """
import resource, sys
import numpy as np
import rsflow

rsflow.set_num_threads(2)
large = np.random.default_rng(0).integers(0, 255, (4000, 5000), dtype=np.uint8)
moved = np.roll(large, 3, 1)
small = [frame[:120, :160].copy() for frame in (large, moved)]
flow, tracker = rsflow.DenseFlow(preset="fast"), rsflow.PointTracker(max_corners=0)
# The threads are there before memory lacks: the C library ends a process where a new one finds none for its variables.
rsflow.dense_flow(large[:600, :800], moved[:600, :800], preset="fast")
rsflow.estimate_shift(large[:600, :800], moved[:600, :800])

def streamed(stream, prev, next):
    stream.reset()
    stream.update(prev)
    return stream.update(next)

def limit(room):
    with open("/proc/self/statm") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + room, resource.RLIM_INFINITY))
"""

CALLS = [
    "rsflow.dense_flow(prev, next, preset='accurate')",
    "rsflow.dense_flow(prev, next, mask=np.ones(prev.shape, bool))",
    "rsflow.estimate_shift(prev, next)",
    "rsflow.estimate_shift(prev, next, mask=np.ones(prev.shape, bool))",
    "rsflow.detect_corners(prev, max_corners=0, min_distance=0)",
    "rsflow.track_points(prev, next, np.full((10_000, 2), 60.0))",
    "streamed(flow, prev, next)",
    "streamed(tracker, prev, next)",
]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits memory as Linux does")
@pytest.mark.parametrize("call", CALLS)
def test_too_little_memory_is_an_exception_and_the_object_goes_on(call: str):
    code = PRELUDE + textwrap.dedent(
        f"""
        call = lambda prev, next: {call}
        call(*small)
        for room in (8, 30, 60, 100, 140, 180, 220, 260):
            limit(room << 20)
            try:
                call(large, moved)
            except MemoryError as error:
                assert isinstance(error, (rsflow.RsflowError, np._core._exceptions._ArrayMemoryError)), repr(error)
                print("refused", error)
            limit(1 << 30)
            call(*small)
        print("lives")
        """
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "refused" in done.stdout
    assert done.stdout.endswith("lives\n")


@pytest.mark.parametrize("count", [10**9, 2**63 - 1])
def test_more_corners_than_pixels_are_as_many_as_there_are(count: int):
    frame = np.random.default_rng(1).integers(0, 255, (64, 64), dtype=np.uint8)
    tracker = rsflow.PointTracker(max_corners=count)
    assert 0 < len(tracker.update(frame)) == len(rsflow.PointTracker(max_corners=0).update(frame))
    assert len(rsflow.detect_corners(frame, max_corners=count)) == len(rsflow.detect_corners(frame, max_corners=0))


def test_a_frame_that_takes_no_memory_is_too_large_all_the_same():
    frame = np.broadcast_to(np.uint8(90), (2**20, 2**20))
    for call in (rsflow.dense_flow, rsflow.estimate_shift, lambda a, b: rsflow.track_points(a, b, [[5, 5]])):
        with pytest.raises(rsflow.ShapeError, match=r"1048576.*at most 2147483647 pixels"):
            call(frame, frame)
    for stream in (rsflow.DenseFlow(), rsflow.PointTracker()):
        with pytest.raises(rsflow.ShapeError, match="at most 2147483647 pixels"):
            stream.update(frame)
    with pytest.raises(rsflow.ShapeError, match="at most 2147483647 pixels"):
        rsflow.detect_corners(frame)
    window = rsflow.estimate_shift(frame, frame, roi=(10, 10, 60, 60))
    assert not window.valid


def test_an_unknown_cpu_level_is_an_error_of_every_call():
    code = textwrap.dedent(
        """
        import numpy as np, rsflow
        frame = np.zeros((60, 60), np.uint8)
        for call in (
            lambda: rsflow.dense_flow(frame, frame), lambda: rsflow.estimate_shift(frame, frame),
            lambda: rsflow.track_points(frame, frame, [[9, 9]]), lambda: rsflow.detect_corners(frame),
            lambda: rsflow.PointTracker().update(frame), lambda: rsflow.DenseFlow().update(frame), rsflow.build_info,
        ):
            try:
                call()
            except rsflow.OptionError as error:
                print(error)
        """
    )
    environment = {**os.environ, "RSFLOW_CPU": "avx1024"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    want = 'RSFLOW_CPU: got "avx1024", expected one of "baseline", "neon", "avx2", "avx512", or nothing\n'
    assert done.stdout == 7 * want


def test_frames_that_stand_in_structures_are_read_right():
    """The elements of a field need not stand at multiples of their size, nor at any other fixed place."""
    random = np.random.default_rng(2)
    for dtype in (np.uint8, np.uint16, np.float32):
        prev = (random.random((80, 100)) * 250).astype(dtype)
        nxt = np.roll(prev, (1, 2), (0, 1))
        packed = np.zeros((2, 80, 100), [("flag", "u1"), ("grey", dtype), ("last", "u2")])
        packed["grey"] = prev, nxt
        inside = [packed["grey"][index] for index in (0, 1)]
        shifted = np.zeros(prev.nbytes + 1, np.uint8)[1:].view(dtype).reshape(prev.shape)
        shifted[:] = prev
        want = rsflow.dense_flow(prev, nxt).uv
        assert rsflow.dense_flow(*inside).uv.tobytes() == want.tobytes()
        assert rsflow.dense_flow(shifted, nxt).uv.tobytes() == want.tobytes()
        assert rsflow.detect_corners(inside[0]).tobytes() == rsflow.detect_corners(prev).tobytes()
        assert rsflow.estimate_shift(*inside).dx == rsflow.estimate_shift(prev, nxt).dx
        mask = np.zeros((80, 100), [("a", "u2"), ("here", "?")])
        mask["here"] = prev > 60
        assert rsflow.detect_corners(prev, mask=mask["here"]).tobytes() == (
            rsflow.detect_corners(prev, mask=prev > 60).tobytes()
        )
