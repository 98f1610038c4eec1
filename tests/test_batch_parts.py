"""A batch over sources that are cut into parts: on processes, resumed, from and to storage."""

import json
import os
import re
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import rsflow
from parts_helpers import METRIC, made_clip, same_measurements
from rsflow.batch import extract_many
from rsflow.batch.places import found_sources
from rsflow.batch.processors import processors, quota
from rsflow.batch.work import OF_WHAT_MOVES, PARTS
from rsflow.cli import main
from rsflow.errors import OptionError

TABLES = ("motion", "objects", "velocity", "trajectory")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("batch-parts")
    clip = made_clip(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        whole = rsflow.extract(clip, folder / "whole", **METRIC)
    return clip, whole


@pytest.fixture
def clip(made, monkeypatch):
    monkeypatch.chdir(made[0].parent)
    return made[0]


@pytest.fixture
def whole(made):
    return made[1]


def result(folder):
    return rsflow.Extraction(
        folder,
        True,
        {name: folder / f"{name}.csv" for name in TABLES},
        json.loads((folder / "summary.json").read_text()),
    )


def same(folder, whole):
    one = result(folder)
    same_measurements(one, rsflow.Extraction(whole.folder, True, {n: whole.files[n] for n in TABLES}, whole.summary))


def same_bytes(folder, whole):
    for name in TABLES:
        assert (folder / f"{name}.csv").read_bytes() == whole.files[name].read_bytes(), name


def test_folders_and_parts_on_processes(clip, whole, tmp_path, capsys):
    pytest.importorskip("pyarrow")
    import pyarrow.parquet

    folder = tmp_path / "in"
    (folder / "below").mkdir(parents=True)
    for name in ("a.mp4", "below/a.mp4"):
        (folder / name).symlink_to(clip)
    (folder / "notes.txt").write_text("no video")
    (folder / "broken.mp4").write_bytes(clip.read_bytes()[:2000])
    options = ["--camera", "camera.json", "--height", "0.2", "--no-videos", "--jobs", "2"]
    cut = ["--part-frames", "24", "--overlap", "8", "--parquet"]
    assert main(["batch", str(folder), "-o", str(tmp_path / "out"), *options, *cut]) == 1
    out, err = capsys.readouterr()
    assert "1 file is no video and left out: notes.txt" in err
    assert "broken.mp4: failed" in err
    assert [line.split()[1] for line in out.splitlines()[1:-1]] == ["done", "failed", "done"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"a", "a-2", "index.html"}
    for name in ("a", "a-2"):
        same(tmp_path / "out" / name, whole)
        # What is not that of one run is said by name.
        summary = json.loads((tmp_path / "out" / name / "summary.json").read_text())
        assert summary["parts"] == 2
        assert set(OF_WHAT_MOVES) <= set(re.findall(r"\w+", summary["notes"][-1]))
        assert {**whole.summary, "notes": summary["notes"][:-1]}.keys() == summary.keys() - {"parts"}
        assert not (tmp_path / "out" / name / PARTS).exists()
    assert "2 of them were measured in parts that overlap" in (tmp_path / "out" / "index.html").read_text()
    groups = pyarrow.parquet.ParquetFile(tmp_path / "out" / "a" / "motion.parquet").metadata
    assert [groups.row_group(k).num_rows for k in range(groups.num_row_groups)] == [24, 36]
    # What is done is not done again.
    before = (tmp_path / "out" / "a" / "summary.json").stat().st_mtime_ns
    # A process that was killed when all was there has left its parts.
    (tmp_path / "out" / "a" / PARTS).mkdir()
    assert main(["batch", str(folder / "a.mp4"), "-o", str(tmp_path / "out"), *options, *cut, "--resume", "-q"]) == 0
    assert (tmp_path / "out" / "a" / "summary.json").stat().st_mtime_ns == before
    assert not (tmp_path / "out" / "a" / PARTS).exists()


def test_a_batch_that_was_interrupted_goes_on_with_the_parts_that_are_there(clip, whole, tmp_path):
    options = {**METRIC, "part_frames": 16, "overlap": None}

    def press(done, total):
        if done > 0.3:
            signal.raise_signal(signal.SIGINT)

    with ThreadPoolExecutor(1) as pool:
        (item,) = extract_many([clip], tmp_path, executor=pool, on_progress=press, **options)
        assert item.status == "partial"
        assert "parts are done, the same command with --resume goes on" in item.error
        done = sorted((tmp_path / "clip" / PARTS).glob("*/part-*/part.json"))
        times = [path.stat().st_mtime_ns for path in done]
        assert 1 <= len(done) < 3
        seen = []

        def look(share, total):
            seen.append(share)
            assert [path.stat().st_mtime_ns for path in done if path.exists()] in (times, [])

        (item,) = extract_many([clip], tmp_path, executor=pool, on_progress=look, resume=True, **options)
    assert item.status == "done", item.error
    assert seen[0] > 0.2
    # Parts that follow each other give all that one run gives.
    same_bytes(tmp_path / "clip", whole)
    assert item.summary["frames"] == 60
    assert item.summary["notes"] == whole.summary["notes"]


def test_parts_of_other_settings_are_not_taken(clip, tmp_path):
    with ThreadPoolExecutor(1) as pool:
        options = {"videos": False, "part_frames": 20, "overlap": 5, "executor": pool}
        stop = {"on_progress": lambda done, total: done > 0.2 and signal.raise_signal(signal.SIGINT)}
        extract_many([clip], tmp_path, **options, **stop)
        root = tmp_path / "clip" / PARTS
        assert len(list(root.iterdir())) == 1
        extract_many([clip], tmp_path, **options, **stop, resume=True, illumination="offset")
        assert len(list(root.iterdir())) == 2
        # Without resume=True all begins anew.
        extract_many([clip], tmp_path, **options, **stop, illumination="none")
        assert len(list(root.iterdir())) == 1


@pytest.mark.skipif(not Path("/proc").exists(), reason="kills a process by its number")
def test_a_part_whose_process_is_killed_is_done_again(clip, whole, tmp_path):
    killed = []

    def kill(done, total):
        # The name of what is being written tells who writes it.
        for path in (tmp_path / "clip" / PARTS).glob("*/.part-*"):
            pid = int(path.name.split("working-")[1].split("-")[0])
            if not killed and pid != os.getpid():
                killed.append(pid)
                os.kill(pid, signal.SIGKILL)

    options = {**METRIC, "part_frames": 16, "overlap": 6, "retries": 1}
    (item,) = extract_many([clip], tmp_path, jobs=2, on_progress=kill, **options)
    assert killed
    assert item.status == "done", item.error
    same(tmp_path / "clip", whole)


def test_storage_that_is_none_is_told_before_the_work(clip, capsys, monkeypatch):
    fsspec = pytest.importorskip("fsspec")
    for out in ("nosuch://bucket/out", "memory://out"):
        with pytest.raises(OptionError, match=out):
            extract_many([clip], out, jobs=1)

    def lacking(url):
        raise ImportError(f"Install what {url} needs")

    assert main(["batch", str(clip), "-o", "nosuch://bucket/out"]) == 1
    assert "rsflow batch: storage: got nosuch://bucket/out, expected what fsspec knows" in capsys.readouterr().err
    with ThreadPoolExecutor(1) as pool:
        words = ["nosuch://bucket/a.mp4", "memory://none/a.mp4"]
        sources, _ = found_sources(words)
        assert sources == words
        items = extract_many(sources, "out", executor=pool)
        assert items[0].error.startswith("storage: got nosuch://bucket/a.mp4, expected")
        assert items[1].error == "memory://none/a.mp4: no such file in storage"
    monkeypatch.setattr(fsspec.core, "url_to_fs", lacking)
    with pytest.raises(rsflow.MissingExtraError, match=r"s3://b/out: .* Install what s3://b/out needs"):
        extract_many([clip], "s3://b/out", jobs=1)


def test_storage_for_sources_and_results(clip, whole, tmp_path):
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    memory.put_file(str(clip), "/videos/day/clip.mp4")
    memory.pipe_file("/videos/day/notes.txt", b"no video")
    sources, _ = found_sources(["memory://videos/day/", "memory://videos/*/*.mp4", "memory://videos/none"])
    assert sources == ["memory:///videos/day/clip.mp4", "memory://videos/none"]
    options = {**METRIC, "part_frames": 20, "overlap": 7}
    with ThreadPoolExecutor(1) as pool:
        items = extract_many(sources, "memory://results", executor=pool, **options)
        assert [item.status for item in items] == ["done", "failed"]
        assert items[0].folder == "memory://results/clip"
        assert items[0].summary["frames"] == 60
        names = {name.split("/results/clip/")[1] for name in memory.find("/results/clip")}
        assert {"motion.csv", "report.html", "summary.json"} <= names
        assert not any("working" in name or PARTS in name for name in names)
        memory.get("/results/clip/", str(tmp_path / "got"), recursive=True)
        same(tmp_path / "got", whole)
        summary = json.loads(memory.cat_file("/results/clip/summary.json"))
        assert summary["source"] == "memory:///videos/day/clip.mp4"
        # What is there is not done again; what has changed is.
        before = memory.info("/results/clip/motion.csv")["created"]
        (item,) = extract_many(sources[:1], "memory://results", executor=pool, resume=True, **options)
        assert item.status == "done"
        assert memory.info("/results/clip/motion.csv")["created"] == before
        # In one piece, to a folder that fsspec writes.
        (item,) = extract_many(
            sources[:1], f"file://{tmp_path}/files", executor=pool, stop=12, videos=False, camera_motion="moving"
        )
        assert item.status == "done", item.error
        assert (tmp_path / "files" / "clip" / "motion.csv").read_text().count("\n") == 13
    memory.rm("/videos", recursive=True)
    memory.rm("/results", recursive=True)


def test_sources_that_words_stand_for(tmp_path):
    import cv2
    import numpy as np

    (tmp_path / "pictures").mkdir()
    cv2.imwrite(str(tmp_path / "pictures" / "1.png"), np.zeros((8, 8), np.uint8))
    (tmp_path / "videos" / "deep").mkdir(parents=True)
    for name in ("b10.mp4", "b2.MP4", "deep/c.mkv", ".hidden.mp4", "x.csv"):
        (tmp_path / "videos" / name).touch()
    (tmp_path / "empty").mkdir()
    folder = str(tmp_path / "videos")
    videos = [f"{folder}/b2.MP4", f"{folder}/b10.mp4", f"{folder}/deep/c.mkv"]
    assert found_sources([folder]) == (videos, [f"{folder}: 1 file is no video and left out: x.csv"])
    assert found_sources([f"{folder}/*"])[0] == videos
    # Each once.
    assert found_sources([videos[1], folder])[0] == [videos[1], videos[0], videos[2]]
    for word in (str(tmp_path / "pictures"), f"{tmp_path}/pictures/*.png", "none.mp4", "no/*.mp4", "rtsp://host/a"):
        assert found_sources([word]) == ([word], [])
    assert found_sources([str(tmp_path / "empty"), "0"]) == ([str(tmp_path / "empty"), 0], [])


@pytest.mark.parametrize(
    ("cgroup", "files", "expected"),
    [
        ("0::/job", {"sys/fs/cgroup/job/cpu.max": "150000 100000"}, 1.5),
        ("0::/a/b", {"sys/fs/cgroup/a/cpu.max": "400000 100000", "sys/fs/cgroup/a/b/cpu.max": "max 100000"}, 4.0),
        # Within a container the path is that of the host.
        ("0::/host/only", {"sys/fs/cgroup/cpu.max": "50000 100000"}, 0.5),
        (
            "4:cpu,cpuacct:/docker/1",
            {"sys/fs/cgroup/cpu/cpu.cfs_quota_us": "300000", "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000"},
            3.0,
        ),
        ("1:cpu:/", {"sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1", "sys/fs/cgroup/cpu/cpu.cfs_period_us": "1"}, None),
        ("0::/", {"sys/fs/cgroup/cpu.max": "nonsense"}, None),
        ("", {}, None),
    ],
)
def test_the_quota_of_a_container(tmp_path, monkeypatch, cgroup, files, expected):
    for name, text in {"proc/self/cgroup": cgroup, **files}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text + "\n")
    assert quota(tmp_path) == expected
    monkeypatch.setattr("rsflow.batch.processors.quota", lambda: 0.5)
    assert processors() == 1


def test_options_that_contradict_each_other(tmp_path, capsys):
    with pytest.raises(OptionError, match="overlap: got 60, expected fewer frames than part_frames, 20"):
        extract_many(["a.mp4"], tmp_path, part_frames=20)
    with pytest.raises(OptionError, match="part_frames: got 3"):
        extract_many(["a.mp4"], tmp_path, part_frames=3)
    assert main(["batch", "a.mp4", "-o", str(tmp_path), "--jobs", "1", "--scheduler", "tcp://x:1"]) == 1
    assert main(["batch", "a.mp4", "-o", str(tmp_path), "--in-order", "--overlap", "3"]) == 1
    assert "parts in order do not overlap" in capsys.readouterr().err
