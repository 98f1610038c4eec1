"""Threads, fork, process pools and Ctrl-C: every way in which applications run the estimators."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

import rsflow


def pair(size: tuple[int, int] = (240, 320)) -> tuple[np.ndarray, np.ndarray]:
    """Two frames that move by (3, -2); smooth enough for every estimator."""
    random = np.random.default_rng(5).standard_normal((size[0] + 40, size[1] + 40))
    for axis in (0, 1):
        for _ in range(3):
            random = (np.roll(random, 1, axis) + random + np.roll(random, -1, axis)) / 3
    scene = np.round((random - random.min()) / np.ptp(random) * 200 + 20).astype(np.uint8)
    height, width = size
    return scene[20 : 20 + height, 20 : 20 + width], scene[22 : 22 + height, 17 : 17 + width]


def measure(_: int = 0) -> tuple[float, float, bytes]:
    """All three estimators on one pair: what any worker must find, bit by bit."""
    prev, nxt = pair()
    shift = rsflow.estimate_shift(prev, nxt)
    field = rsflow.dense_flow(prev, nxt, preset="fast")
    tracks = rsflow.track_points(prev, nxt, rsflow.detect_corners(prev, max_corners=50))
    return shift.dx, shift.dy, field.uv.tobytes() + tracks.points.tobytes()


def test_the_measurement_itself_is_right():
    dx, dy, _ = measure()
    assert (dx, dy) == pytest.approx((3, -2), abs=0.02)


def test_many_threads_at_once_give_the_same_bits():
    want = measure()
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        assert all(found == want for found in pool.map(measure, range(24)))


def test_the_number_of_threads_changes_no_bit():
    before, want = rsflow.get_num_threads(), measure()
    try:
        for threads in (1, 2, 7):
            rsflow.set_num_threads(threads)
            assert measure() == want
    finally:
        rsflow.set_num_threads(before)


@pytest.mark.parametrize("level", ["baseline", "avx2", "avx512"])
def test_the_cpu_level_changes_no_bit(level: str):
    code = (
        "import hashlib, sys; sys.path.insert(0, sys.argv[1]); import test_concurrency as t; "
        "dx, dy, rest = t.measure(); print(dx.hex(), dy.hex(), hashlib.sha256(rest).hexdigest())"
    )
    here = str(Path(__file__).parent)
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code, here],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "RSFLOW_CPU": name},
        ).stdout
        for name in ("", level)
    }
    assert len(outputs) == 1


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_a_process_pool_gives_the_same_bits(method: str):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system has no {method}")
    want = measure()  # The parent's thread pool runs before the children are made.
    context = multiprocessing.get_context(method)
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as pool:
        assert all(found == want for found in pool.map(measure, range(4), timeout=120))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_works_and_so_does_its_parent():
    want = measure()
    child = os.fork()
    if child == 0:
        os._exit(0 if measure() == want else 1)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            break
        time.sleep(0.01)
    else:
        os.kill(child, signal.SIGKILL)
        pytest.fail("the forked child hangs")
    assert os.waitstatus_to_exitcode(status) == 0
    assert measure() == want


@pytest.mark.parametrize(
    "call",
    [
        "rsflow.dense_flow(frame, other, preset='accurate')",
        "rsflow.estimate_shift(frame, other)",
        "rsflow.track_points(frame, other, points)",
        "rsflow.detect_corners(frame, max_corners=100000, min_distance=2)",
    ],
)
@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_is_honoured_within_0_2_s(call: str, threads: int):
    """The child repeats one long call and prints how long after each signal it got the exception."""
    code = textwrap.dedent(
        f"""
        import os, signal, threading, time
        import numpy as np
        import rsflow
        rsflow.set_num_threads({threads})
        frame = np.random.default_rng(0).integers(0, 255, (2000, 3000), dtype=np.uint8)
        other = np.roll(frame, (3, 5), (0, 1))
        y, x = np.mgrid[20:1980:6, 20:2980:6]
        points = np.stack([x.ravel(), y.ravel()], 1).astype(np.float32)
        sent = []
        def interrupt():
            time.sleep(0.3)
            sent.append(time.perf_counter())
            os.kill(os.getpid(), signal.SIGINT)
        for _ in range(3):
            threading.Thread(target=interrupt).start()
            try:
                while True:
                    {call}
            except KeyboardInterrupt:
                print(time.perf_counter() - sent[-1])
        """
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    latencies = [float(line) for line in done.stdout.split()]
    assert min(latencies) < 0.2, latencies
