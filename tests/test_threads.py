"""The number of threads: what it may be, and that those of a former number end."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

import rsflow
from rsflow._beside import soon_handed_over


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("number", [-1, 1025, 10**6, 2**62])
def test_a_number_out_of_range_is_an_error_that_says_the_limit(number: int):
    before = rsflow.get_num_threads()
    with pytest.raises(
        rsflow.OptionError, match=rf"threads: got {number}, expected 1 to 1024, or 0 for one for each CPU"
    ):
        rsflow.set_num_threads(number)
    assert rsflow.get_num_threads() == before


COUNTED = """
import os, threading, time, warnings
import numpy as np, rsflow
warnings.simplefilter("ignore")
others = len(os.listdir("/proc/self/task")) - 1  # Such as those of numpy's linear algebra.
frame = np.random.default_rng(0).integers(0, 255, (200, 300), dtype=np.uint8)
want = rsflow.dense_flow(frame, frame, preset="fast").uv.tobytes()

def measure():
    assert rsflow.dense_flow(frame, frame, preset="fast").uv.tobytes() == want

def count(most):
    "Threads of this process, once they are `most` or a while has passed."
    end = time.monotonic() + 5
    while (threads := len(os.listdir("/proc/self/task")) - others) > most and time.monotonic() < end:
        time.sleep(0.01)
    return threads
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts threads as Linux does")
def test_threads_of_former_numbers_end():
    told = run(
        COUNTED
        + """
for threads in range(1, 33):
    rsflow.set_num_threads(threads)
    measure()
rsflow.set_num_threads(3)
measure()
print(count(1 + 3))
rsflow.set_num_threads(1)
print(count(1))
"""
    )
    assert told.split() == ["4", "1"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts threads as Linux does")
def test_threads_end_too_where_many_threads_call_and_in_a_child():
    told = run(
        COUNTED
        + """
def work(first):
    for threads in range(first, first + 6):
        rsflow.set_num_threads(threads)
        measure()
workers = [threading.Thread(target=work, args=(first,)) for first in range(2, 10)]
for worker in workers:
    worker.start()
for worker in workers:
    worker.join()
rsflow.set_num_threads(2)
measure()
print(count(1 + 2), flush=True)
child = os.fork()
if child == 0:
    others = 0
    for threads in (4, 3, 2):
        rsflow.set_num_threads(threads)
        measure()
    print(count(1 + 2), flush=True)
    os._exit(0)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
measure()
print(count(1 + 2))
"""
    )
    # A fork may end threads of others, such as those of numpy's linear algebra.
    assert all(int(count) <= 3 for count in told.split())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="threads are counted as Linux lists them")
def test_stages_keep_to_their_threads_where_there_are_no_more_and_results_do_not_depend_on_it():
    code = """
    import os, threading
    import numpy as np, rsflow
    from rsflow._beside import share_threads
    frame = np.random.default_rng(0).integers(0, 255, (400, 600), dtype=np.uint8)
    got = set()

    def measure(begin):
        begin()
        before = len(os.listdir("/proc/self/task"))
        got.add(rsflow.dense_flow(frame, frame, preset="fast").uv.tobytes())
        print(len(os.listdir("/proc/self/task")) - before)

    for number, begin in ((2, share_threads), (2, lambda: None), (3, share_threads)):
        rsflow.set_num_threads(number)
        thread = threading.Thread(target=measure, args=(begin,))
        thread.start()
        thread.join()
    assert len(got) == 1
    """
    kept, all_of_them, more = map(int, run(code).split())
    assert kept == 0
    assert all_of_them > 0
    assert more > 0


def test_python_hands_over_soon_until_the_last_run_has_ended():
    before = sys.getswitchinterval()
    with soon_handed_over():
        first = sys.getswitchinterval()
        with soon_handed_over():
            assert sys.getswitchinterval() == first < before
        assert sys.getswitchinterval() == first
    assert sys.getswitchinterval() == before
    with pytest.raises(ZeroDivisionError), soon_handed_over():
        _ = 1 / 0
    assert sys.getswitchinterval() == before
