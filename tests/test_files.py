"""Writing beside and renaming: many writers of one path, planted links, links and devices as targets, dead writers."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow.io import atomic, processes
from rsflow.io.atomic import Working, remove_leftovers, working_name, writing

posix = pytest.mark.skipif(os.name != "posix", reason="as POSIX has it")

WRITERS = {
    "flow": lambda path, n: rsflow.write_flow(path.with_suffix(".npy"), np.full((8, 8, 2), n, np.float32)),
    "camera": lambda path, n: rsflow.Camera(300 + n, 300, 8, 8, width=17, height=17).save(path.with_suffix(".json")),
    "picture": lambda path, n: rsflow.flow_to_color(np.full((8, 8, 2), n, np.float32), path=path.with_suffix(".png")),
    "text": lambda path, n: _write(path.with_suffix(".txt"), str(n)),
}


def _write(path, text):
    with writing(path) as partial:
        partial.write_text(text)


@pytest.mark.parametrize("kind", WRITERS)
def test_eight_threads_that_write_one_path_all_succeed(tmp_path, kind):
    failures = []
    start = threading.Barrier(8)

    def write(number):
        start.wait()
        try:
            for _ in range(12):
                WRITERS[kind](tmp_path / "made" / "x", number)
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    (left,) = (tmp_path / "made").iterdir()
    assert left.name.startswith("x.")
    if kind == "text":
        assert left.read_text() in set("01234567")


def test_eight_threads_that_fail_in_a_folder_leave_it_to_those_that_succeed(tmp_path):
    """A writer that fails removes the folders that it made: never one that another needs."""
    failures = []

    def write(number):
        for _ in range(50):
            try:
                with writing(tmp_path / "a" / "b" / f"{number}.txt") as partial:
                    partial.write_text("x")
                    if number % 2:
                        raise ZeroDivisionError
            except ZeroDivisionError:
                pass
            except OSError as error:
                failures.append(error)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert sorted(path.name for path in (tmp_path / "a" / "b").iterdir()) == ["0.txt", "2.txt", "4.txt", "6.txt"]


def test_processes_that_write_one_path_all_succeed(tmp_path):
    code = (
        "import sys, numpy as np, rsflow\n"
        "for n in range(30): rsflow.write_flow(sys.argv[1], np.full((16, 16, 2), n, np.float32))\n"
    )
    path = tmp_path / "x.flo"
    running = [subprocess.Popen([sys.executable, "-c", code, path], stderr=subprocess.PIPE) for _ in range(4)]
    assert [process.communicate(timeout=120)[1] for process in running] == [b""] * 4
    assert list(tmp_path.iterdir()) == [path]
    assert (rsflow.read_flow(path) == 29).all()


@posix
def test_a_link_planted_under_the_working_name_is_not_followed(tmp_path, monkeypatch):
    """Even where the random part was known."""
    victim = tmp_path / "victim"
    victim.write_text("mine")
    given = [bytes(6), bytes(6), b"\1" * 6]
    monkeypatch.setattr(os, "urandom", lambda _: given.pop(0))
    planted = working_name(tmp_path / "x.flo")
    planted.symlink_to(victim)
    rsflow.write_flow(tmp_path / "x.flo", np.zeros((4, 4, 2), np.float32))
    assert victim.read_text() == "mine"
    assert planted.is_symlink()
    assert rsflow.read_flow(tmp_path / "x.flo").shape == (4, 4, 2)
    assert given == []


@posix
def test_a_link_at_the_final_name_is_replaced_and_its_target_kept(tmp_path):
    target, link = tmp_path / "target.flo", tmp_path / "link.flo"
    target.write_text("mine")
    link.symlink_to(target)
    rsflow.write_flow(link, np.zeros((4, 4, 2), np.float32))
    assert target.read_text() == "mine"
    assert not link.is_symlink()
    assert rsflow.read_flow(link).shape == (4, 4, 2)


@posix
@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_permissions_are_what_the_umask_gives(tmp_path, mask, mode):
    before = os.umask(mask)
    try:
        rsflow.write_flow(tmp_path / "x.flo", np.zeros((4, 4, 2), np.float32))
        with rsflow.VideoWriter(tmp_path / "x.mp4", frame_rate=25) as video:
            video.write(np.zeros((32, 32), np.uint8))
    finally:
        os.umask(before)
    assert [(tmp_path / name).stat().st_mode & 0o777 for name in ("x.flo", "x.mp4")] == [mode] * 2


@posix
def test_devices_and_pipes_are_written_to_and_stay(tmp_path):
    before = os.lstat("/dev/null")
    _write(Path("/dev/null"), "x")
    assert os.lstat("/dev/null").st_ino == before.st_ino
    pipe = tmp_path / "pipe.flo"
    os.mkfifo(pipe)
    got = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    rsflow.write_flow(pipe, np.zeros((4, 4, 2), np.float32))
    reader.join()
    assert got[0][:4] == b"PIEH"
    assert len(got[0]) == 12 + 8 * 16
    assert list(tmp_path.iterdir()) == [pipe]


@posix
@pytest.mark.parametrize("redirected", [False, True])
@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_is_written_to_in_order(tmp_path, name, redirected):
    if name.startswith("/proc") and not sys.platform.startswith("linux"):
        pytest.skip("as Linux has it")
    code = (
        "import sys, rsflow\n"
        "print('before')\n"
        f"rsflow.Camera(30, 30, 8, 8, width=17, height=17).save({name!r}, format='json')\n"
        "print('after')\n"
    )
    before = os.lstat("/dev/stdout")
    if redirected:
        (tmp_path / "log").write_text("first\n")
        with (tmp_path / "log").open("a") as log:
            subprocess.run([sys.executable, "-c", code], stdout=log, check=True)
        text = (tmp_path / "log").read_text()
        assert text.startswith("first\nbefore\n{")
    else:
        text = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        assert text.startswith("before\n{")
    assert text.endswith("}\nafter\n")
    assert os.lstat("/dev/stdout").st_ino == before.st_ino


def test_a_long_name_is_no_trouble(tmp_path):
    path = tmp_path / ("\u00e9" * 120 + ".flo")
    rsflow.write_flow(path, np.zeros((4, 4, 2), np.float32))
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_in_the_place_of_the_file_is_an_error_that_names_it(tmp_path):
    (tmp_path / "x.flo").mkdir()
    with pytest.raises(OSError, match=r"cannot write .*x\.flo"):
        rsflow.write_flow(tmp_path / "x.flo", np.zeros((4, 4, 2), np.float32))
    assert [path.name for path in tmp_path.iterdir()] == ["x.flo"]


# --- what dead processes leave --------------------------------------------------------------------------------------

LEAVE = """
import sys, time
from pathlib import Path
from rsflow.io.atomic import Working
files = [Working(Path(sys.argv[1], "x.csv")) for _ in range(3)]
print("ready", flush=True)
time.sleep(600)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="knows dead processes by /proc")
def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path):
    process = subprocess.Popen([sys.executable, "-c", LEAVE, tmp_path], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    mine = Working(tmp_path / "mine.csv")
    foreign = tmp_path / ".x.working-1-deadbeef-5-0123456789ab.csv"
    foreign.write_text("of another machine")
    other = tmp_path / ".x.working-copy.csv"
    other.write_text("the user's")
    living = {path.name for path in tmp_path.iterdir()}
    assert len(living) == 6
    remove_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == living
    process.kill()
    process.communicate()
    # The next writer into the folder removes it, once.
    atomic._swept.clear()
    rsflow.write_flow(tmp_path / "y.flo", np.zeros((4, 4, 2), np.float32))
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {mine.path.name, foreign.name, other.name, "y.flo"}
    mine.discard()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="knows dead processes by /proc")
def test_a_process_that_got_the_number_of_a_dead_one_is_not_it():
    pid, machine, started = processes.this_process().split("-")
    assert processes.is_alive(f"{pid}-{machine}-{started}")
    assert not processes.is_alive(f"{pid}-{machine}-{int(started) - 1}")
    assert processes.is_alive(f"{pid}-{int(machine, 16) ^ 1:x}-{int(started) - 1}")
    child = subprocess.Popen([sys.executable, "-c", ""])
    number = child.pid
    ticks = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[19]
    # Ended, but not yet waited for.
    os.waitid(os.P_PID, number, os.WEXITED | os.WNOWAIT)
    assert not processes.is_alive(f"{number}-{machine}-{ticks}")
    child.wait()
    assert not processes.is_alive(f"{number}-{machine}-{ticks}")
