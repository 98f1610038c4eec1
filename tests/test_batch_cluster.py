"""A batch on a real cluster of several processes, one of which is killed and another one restarted in the middle."""

import contextlib
import json
import os
import signal
import sys
import threading
import time

import pytest

import rsflow
from parts_helpers import METRIC, made_clip, same_measurements
from rsflow.batch.work import PARTS
from rsflow.cli import main

TABLES = ("motion", "objects", "velocity", "trajectory")

pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cluster")
    clip = made_clip(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return clip, rsflow.extract(clip, folder / "whole", **METRIC)


@pytest.fixture
def scheduler():
    """Give a cluster of two worker processes, each with one that looks after it."""
    distributed = pytest.importorskip("distributed")
    os.environ.setdefault("DASK_DISTRIBUTED__WORKER__DAEMON", "True")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0, silence_logs=50
    ) as cluster:
        yield cluster


def until(found, seconds=60):
    end = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return value


@pytest.mark.skipif(sys.platform == "win32", reason="kills as POSIX does")
def test_a_cluster_gives_what_one_process_gives(made, scheduler, tmp_path, monkeypatch, capsys):
    import distributed

    clip, whole = made
    monkeypatch.chdir(clip.parent)
    (tmp_path / "in").mkdir()
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / "in" / name).symlink_to(clip)
    (tmp_path / "in" / "broken.mp4").write_bytes(b"no video")
    out = tmp_path / "out"
    did: list[str] = []

    def trouble():
        # What is being written tells who writes it.
        def writer():
            found = out.glob(f"*/{PARTS}/*/.part-*")
            return next((int(path.name.split("working-")[1].split("-")[0]) for path in found), None)

        with distributed.Client(scheduler.scheduler_address, set_as_default=False) as client:
            addresses = {pid: address for address, pid in client.run(os.getpid).items()}
            killed = until(writer)
            os.kill(killed, signal.SIGKILL)
            did.append("killed")
            other = next(address for pid, address in addresses.items() if pid != killed)
            until(lambda: list(out.glob(f"*/{PARTS}/*/part-*")))
            with contextlib.suppress(Exception):
                client.restart_workers([other], timeout=30)
            did.append("restarted")

    troublemaker = threading.Thread(target=trouble)
    troublemaker.start()
    command = ["batch", str(tmp_path / "in"), "-o", str(out), "--scheduler", scheduler.scheduler_address]
    options = ["--camera", "camera.json", "--height", "0.2", "--no-videos", "--part-frames", "20", "--overlap", "6"]
    code = main([*command, *options, "--json"])
    troublemaker.join()
    assert did == ["killed", "restarted"]
    items = json.loads(capsys.readouterr().out)
    assert [item["status"] for item in items] == ["done", "done", "failed"], items
    assert code == 1
    for name in ("a", "b"):
        files = {table: out / name / f"{table}.csv" for table in TABLES}
        one = rsflow.Extraction(out / name, True, files, {})
        same_measurements(one, rsflow.Extraction(whole.folder, True, {n: whole.files[n] for n in TABLES}, {}))
        assert not (out / name / PARTS).exists()


def test_a_scheduler_that_is_not_there_is_told(tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    monkeypatch.setattr("rsflow.batch.cluster._WAIT_S", 0.5)
    assert main(["batch", "a.mp4", "-o", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:9"]) == 1
    assert "expected the address of a Dask scheduler" in capsys.readouterr().err
    # Dask would wait for a file that is not there.
    assert main(["batch", "a.mp4", "-o", str(tmp_path / "out"), "--scheduler", "nobody"]) == 1
    assert "--scheduler: got 'nobody', expected an address, as tcp://host:8786, or" in capsys.readouterr().err
