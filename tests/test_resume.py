"""A run that was stopped or killed and is resumed: the same tables, to the byte, as of a run in one piece.

Long because everything here goes on with one extraction, which is made once.
"""

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rsflow
from extraction_helpers import FILES, names_in, partials
from rsflow import synthetic
from rsflow.batch import extract_many
from rsflow.cli import main
from rsflow.errors import FormatError, OptionError
from rsflow.extraction import checkpoint
from rsflow.extraction.state import decode, encode
from rsflow.extraction.workspace import PARKED, unfinished
from rsflow.video import sinks
from rsflow.video.join import Part, join

FRAMES = 30
TABLES = ("motion", "objects", "velocity", "trajectory")
ARGUMENTS = ["extract", "clip.mp4", "-o", "out", "--camera", "camera.json", "--height", "0.2", "--resume", "-q"]
OPTIONS = {"camera": "camera.json", "height_m": 0.2}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A clip with a thing that moves, in light that drifts, a still camera's, and what they give in one piece."""
    folder = tmp_path_factory.mktemp("resume")
    flight = synthetic.flight_with_object(
        frames=FRAMES,
        height_m=0.2,
        velocity_m_s=(0.04, -0.015, 0.0),
        exposure_drift=synthetic.auto_exposure(0.1),
        seed=3,
    )
    write(folder / "clip.mp4", flight.images)
    flight.camera.save(folder / "camera.json")
    ground = np.pad(flight.images[0], 0)
    pictures = []
    for k in range(FRAMES):
        picture = ground.copy()
        # It pauses half-way, as things before a still camera do.
        x = 10 + 4 * min(k, 14) + 4 * max(0, k - 22)
        picture[30:60, x : x + 25] = flight.images[5][80:110, 40:65]
        pictures.append(picture)
    write(folder / "still.mp4", pictures)
    rsflow.extract(folder / "clip.mp4", folder / "whole", **{**OPTIONS, "camera": folder / "camera.json"})
    rsflow.extract(folder / "still.mp4", folder / "whole-still", videos=False)
    return folder


def write(path, pictures):
    with rsflow.VideoWriter(path, frame_rate=30) as video:
        for picture in pictures:
            video.write(picture)


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    for name in ("clip.mp4", "camera.json", "still.mp4"):
        shutil.copy2(made / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def every_frame(monkeypatch):
    often(monkeypatch, 0.0)


def often(monkeypatch, seconds):
    monkeypatch.setattr(checkpoint, "_EVERY_S", seconds)
    monkeypatch.setattr(checkpoint, "_SHARE", 1e9)
    monkeypatch.setattr(checkpoint, "_GROWTH", 0.0)


def stop_at(frame):
    def press(measured):
        if measured.frame.index == frame:
            os.kill(os.getpid(), signal.SIGINT)

    return press


def count(path):
    with rsflow.frames(path) as stream:
        return len(list(stream))


def same(out, whole, tables=TABLES):
    for name in tables:
        assert (out / f"{name}.csv").read_bytes() == (whole / f"{name}.csv").read_bytes(), name
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (out, whole)]
    for summary in summaries:
        for name in ("date", "seconds", "frames_per_second", "source", "settings", "identity"):
            summary.pop(name)
    assert summaries[0] == summaries[1]
    assert names_in(out) == names_in(whole)


# --- stopped --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [0.0, 1e9], ids=["a checkpoint a frame", "none before the end"])
def test_a_run_that_was_stopped_goes_on(made, here, monkeypatch, seconds):
    often(monkeypatch, seconds)
    with pytest.raises(rsflow.ExtractionInterrupted, match=r"--resume goes on") as stop:
        rsflow.extract("clip.mp4", "out", **OPTIONS, on_frame=stop_at(13))
    done = stop.value.extraction.frames
    assert 14 <= done < FRAMES
    metric = {"velocity.csv", "trajectory.csv"}
    assert names_in(here / "out") == partials(FILES | metric) | {PARKED}
    for name in ("flow", "moving", "static"):
        assert count(f"out/{name}.partial.mp4") == done
    kept = Path("out/motion.partial.csv").read_bytes()
    # Stopped again, and then to the end. The command and the function are one.
    seen = []

    def press_at_first(measured):
        seen.append(measured)
        stop_at(seen[0].frame.index)(measured)

    with pytest.raises(rsflow.ExtractionInterrupted) as stop:
        rsflow.extract("clip.mp4", "out", **OPTIONS, resume=True, on_frame=press_at_first)
    assert seen[0].frame.index == done
    assert Path("out/motion.partial.csv").read_bytes().startswith(kept)
    assert (
        main(["extract", "clip.mp4", "-o", "out", "--camera", "camera.json", "--height", "0.2", "--resume", "-q"]) == 0
    )
    same(here / "out", made / "whole")
    for name in ("flow", "moving", "static"):
        assert count(f"out/{name}.mp4") == FRAMES
    # There is nothing left to do.
    before = {path.name: path.stat().st_mtime_ns for path in Path("out").iterdir()}
    again = rsflow.extract("clip.mp4", "out", **OPTIONS, resume=True)
    assert again.complete
    assert again.frames == FRAMES
    assert {path.name: path.stat().st_mtime_ns for path in Path("out").iterdir()} == before


@pytest.mark.usefixtures("every_frame")
def test_a_camera_that_stands_still_remembers_what_pauses(made, here):
    for frame in (12, 20):
        with pytest.raises(rsflow.ExtractionInterrupted):
            rsflow.extract("still.mp4", "out", videos=False, resume=True, on_frame=stop_at(frame))
    rsflow.extract("still.mp4", "out", videos=False, resume=True)
    assert json.loads(Path("out/summary.json").read_text())["camera_motion"] == "static"
    same(here / "out", made / "whole-still", ("motion", "objects"))


@pytest.mark.usefixtures("every_frame")
@pytest.mark.parametrize("depth", [np.uint16, np.float32])
def test_a_list_of_deep_pictures_with_gaps_goes_on(here, depth):
    with rsflow.frames("clip.mp4") as stream:
        pictures = [
            (frame.image.astype(depth) * 7 - (3.5 if depth == np.float32 else 0), frame.t_s) for frame in stream
        ]
    limits = {"start": 1, "stop": 33, "stride": 2, "roi": (10, 5, 121, 99), "camera_motion": "moving"}
    rsflow.extract(pictures, "whole", **limits)
    with pytest.raises(rsflow.ExtractionInterrupted):
        rsflow.extract(pictures, "out", **limits, on_frame=stop_at(3))
    rsflow.extract(pictures, "out", **limits, resume=True)
    same(here / "out", here / "whole", ("motion", "objects"))
    assert count("out/flow.mp4") == count("whole/flow.mp4") == len(range(1, FRAMES, 2))


def test_a_run_that_was_stopped_before_the_probe_begins_anew(made, here):
    with pytest.raises(rsflow.ExtractionInterrupted):
        _stopped_early()
    assert PARKED not in names_in(here / "out")
    rsflow.extract("clip.mp4", "out", **OPTIONS, resume=True)
    same(here / "out", made / "whole")


def _stopped_early():
    from rsflow.extraction.pipeline import Pipeline

    real = Pipeline.measure

    def measure(self, frame):
        if frame.index == 5:
            os.kill(os.getpid(), signal.SIGINT)
        return real(self, frame)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Pipeline, "measure", measure)
        rsflow.extract("clip.mp4", "out", **OPTIONS)


@pytest.mark.usefixtures("every_frame")
def test_a_failure_on_the_way_can_be_resumed(made, here):
    def fail(measured):
        if measured.frame.index == 22:
            raise ZeroDivisionError

    with pytest.raises(rsflow.PartialExtractionError):
        rsflow.extract("clip.mp4", "out", **OPTIONS, on_frame=fail)
    assert PARKED in names_in(here / "out")
    rsflow.extract("clip.mp4", "out", **OPTIONS, resume=True)
    same(here / "out", made / "whole")


@pytest.mark.usefixtures("every_frame")
def test_without_pyav_the_parts_become_one_video_too(here):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sinks, "av_encoder", lambda codec: None)
        _stopped_and_resumed_without_pyav()
    # With PyAV the parts would not fit together.
    if sinks.av_encoder("h264"):
        with pytest.raises(FormatError, match="its videos are mp4v by cv2"):
            rsflow.extract("clip.mp4", "other", resume=True)
        assert PARKED in names_in(here / "other")


def _stopped_and_resumed_without_pyav():
    with pytest.raises(rsflow.ExtractionInterrupted) as stop:
        rsflow.extract("clip.mp4", "out", on_frame=stop_at(15))
    for name in ("flow", "moving", "static"):
        assert count(f"out/{name}.partial.mp4") == stop.value.extraction.frames
    rsflow.extract("clip.mp4", "out", resume=True)
    for name in ("flow", "moving", "static"):
        assert count(f"out/{name}.mp4") == FRAMES
    with pytest.raises(rsflow.ExtractionInterrupted):
        rsflow.extract("clip.mp4", "other", on_frame=stop_at(15))


# --- killed ---------------------------------------------------------------------------------------------------------

# Runs the command and kills itself at the n-th call of a function, before or after what it does.
KILLED = """
import os, signal, sys
from rsflow.io import atomic
from rsflow.extraction import checkpoint, finish, outputs, tables, views, workspace
checkpoint._EVERY_S, checkpoint._SHARE, checkpoint._GROWTH = 0.0, 1e9, 0.0
owner, name, at, when, *arguments = sys.argv[1:]
owner = eval(owner)
real, calls = getattr(owner, name), 0

def killing(*args, **options):
    global calls
    calls += 1
    if calls == int(at) and when == "before":
        os.kill(os.getpid(), signal.SIGKILL)
    result = real(*args, **options)
    if calls == int(at) and when == "after":
        os.kill(os.getpid(), signal.SIGKILL)
    return result

setattr(owner, name, killing)
from rsflow.cli import main
sys.exit(main(arguments))
"""

MOMENTS = [
    [("outputs.Outputs", "add", 5, "after")],
    [("checkpoint.Draft", "write", 1, "before"), ("checkpoint.Draft", "write", 2, "after")],
    [("views.Clip", "cut", 8, "after"), ("atomic.Working", "keep", 18, "before")],
    [("views.Clip", "joined", 2, "after"), ("workspace.Grown", "copy", 4, "after")],
    [("finish", "build", 1, "before"), ("finish", "remove_partial", 1, "after")],
]  # fmt: skip


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="knows dead processes by /proc")
@pytest.mark.parametrize("moments", MOMENTS, ids=lambda moments: "-".join(moment[1] for moment in moments))
def test_a_run_that_was_killed_goes_on(made, here, moments):
    for owner, name, at, when in moments:
        command = [sys.executable, "-c", KILLED, owner, name, str(at), when, *ARGUMENTS]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == -signal.SIGKILL, (done.returncode, done.stderr)
        # What is there of the videos can be looked at.
        for part in Path("out").glob(".run*/[!.]*-*.mp4"):
            assert count(part) > 0
    assert main(ARGUMENTS) == 0
    same(here / "out", made / "whole")
    for name in ("flow", "moving", "static"):
        assert count(f"out/{name}.mp4") == FRAMES


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="knows dead processes by /proc")
def test_without_resume_what_was_killed_is_removed(made, here):
    command = [sys.executable, "-c", KILLED, "checkpoint.Draft", "write", "3", "after", *ARGUMENTS]
    assert subprocess.run(command, capture_output=True, check=False).returncode == -signal.SIGKILL
    (left,) = names_in(here / "out")
    assert left.startswith(".run.working-")
    # Another command into the folder leaves it alone, as does one that fails.
    assert main(["track", "clip.mp4", "-o", "out", "--no-video"]) == 0
    assert main([*ARGUMENTS, "--stride", "2"]) == 1
    assert left in names_in(here / "out")
    assert main(["extract", "clip.mp4", "-o", "out", "--camera", "camera.json", "--height", "0.2", "-q"]) == 0
    assert names_in(here / "out") - {"tracks.csv", ".rsflow.json"} == names_in(made / "whole")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="knows dead processes by /proc")
def test_a_run_that_was_killed_in_a_container_goes_on_in_another(made, here):
    command = [sys.executable, "-c", KILLED, "checkpoint.Draft", "write", "5", "after", *ARGUMENTS]
    assert subprocess.run(command, capture_output=True, check=False).returncode == -signal.SIGKILL
    (left,) = Path("out").iterdir()
    # As its process number and its machine are seen from elsewhere.
    number, _, rest = left.name.removeprefix(".run.working-").split("-", 2)
    there = left.rename(left.with_name(f".run.working-{number}-abcdef12-{rest}"))
    # While somebody holds its lock it runs.
    fcntl = pytest.importorskip("fcntl")
    with (there / "lock").open("r+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert list(unfinished(here / "out")) == []
    assert list(unfinished(here / "out")) == [here / "out" / there.name]
    assert main(ARGUMENTS) == 0
    same(here / "out", made / "whole")


# --- refused --------------------------------------------------------------------------------------------------------


@pytest.fixture
def parked(here, monkeypatch):
    often(monkeypatch, 0.0)
    with pytest.raises(rsflow.ExtractionInterrupted):
        rsflow.extract("clip.mp4", "out", videos=False, on_frame=stop_at(15))
    return here / "out" / PARKED


def test_another_source_or_other_settings_are_refused(parked):
    for source, options in (("still.mp4", {}), ("clip.mp4", {"preset": "balanced"})):
        with pytest.raises(OptionError, match="--overwrite"):
            rsflow.extract(source, "out", videos=False, resume=True, **options)
    for path in Path("out").glob("*.partial.*"):
        if path.is_file():
            path.unlink()
    with pytest.raises(OptionError, match=r"resume.partial.d, the result of another source, expected .*--overwrite"):
        rsflow.extract("still.mp4", "out", videos=False, resume=True)
    with pytest.raises(OptionError, match="does not show the same again"):
        rsflow.extract(iter(np.zeros((3, 48, 64), np.uint8)), "new", videos=False, resume=True)
    assert parked.exists()
    rsflow.extract("still.mp4", "out", videos=False, resume=True, overwrite=True)
    assert not parked.exists()


def test_another_version_is_refused(parked, monkeypatch):
    monkeypatch.setattr(checkpoint, "__version__", "0.0.7")
    with pytest.raises(OptionError, match=r"other versions \(rsflow .*, here 0.0.7\), expected .*--overwrite"):
        rsflow.extract("clip.mp4", "out", videos=False, resume=True)


def damage(name):
    def change(folder):
        path = folder / checkpoint.NAME
        data = bytearray(path.read_bytes())
        if name == "cut":
            path.write_bytes(data[: len(data) // 2])
        elif name == "empty":
            path.write_bytes(b"")
        elif name == "bits":
            for place in range(100, len(data), 997):
                data[place] ^= 0x55
            path.write_bytes(data)
        elif name == "foreign":
            np.savez(path, flow=np.zeros((4, 4, 2)))
        elif name == "pickled":
            np.savez(path, text=np.array([{"x": print}], dtype=object))
        elif name == "table cut":
            table = folder / "motion.csv"
            table.write_bytes(table.read_bytes()[:900])
        elif name == "table changed":
            table = folder / "motion.csv"
            table.write_bytes(table.read_bytes().replace(b"ok", b"no", 1))
        elif name == "table missing":
            (folder / "objects.csv").unlink()
        else:
            tree = json.loads(np.load(path)["text"].tobytes())
            tree["content"]["pipeline"] = {"object": "Popen", "state": {}} if name == "class" else {"array": 10**9}
            with np.load(path) as archive:
                arrays = {key: archive[key] for key in archive.files}
            np.savez(path, **{**arrays, "text": np.frombuffer(json.dumps(tree).encode(), np.uint8)})

    return change


@pytest.mark.parametrize(
    "name",
    ["cut", "empty", "bits", "foreign", "pickled", "table cut", "table changed", "table missing", "class", "array"],
)
def test_a_damaged_checkpoint_is_an_error_that_says_what_to_do(parked, name, capsys):
    damage(name)(parked)
    arguments = ["extract", "clip.mp4", "-o", "out", "--no-videos", "-q", "--resume"]
    for _ in range(2):
        assert main(arguments) == 1
        line = capsys.readouterr().err
        assert "begin anew with --overwrite" in line
        assert len(line.splitlines()) == 1
    assert main([*arguments, "--overwrite"]) == 0
    assert names_in(Path("out")) == FILES - {"flow.mp4", "moving.mp4", "static.mp4"}


# --- batch ----------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("every_frame")
def test_a_batch_goes_on(made, here):
    with pytest.raises(rsflow.ExtractionInterrupted):
        rsflow.extract("still.mp4", "out/still", videos=False, on_frame=stop_at(15))
    rsflow.extract("clip.mp4", "out/clip", videos=False)
    before = Path("out/clip/motion.csv").stat().st_mtime_ns
    items = extract_many(["clip.mp4", "still.mp4"], "out", jobs=1, videos=False, resume=True)
    assert [item.status for item in items] == ["done", "done"]
    assert Path("out/clip/motion.csv").stat().st_mtime_ns == before
    same(here / "out" / "still", made / "whole-still", ("motion", "objects"))


# --- the parts of it ------------------------------------------------------------------------------------------------


def test_a_state_is_the_same_to_the_bit():
    rng = np.random.default_rng(1)
    values = {
        "plain": [None, True, 3, -0.0, float("nan"), float("inf"), 0.1, "x"],
        "pair": (1, (2.5, np.float32(0.1), np.int64(3), np.bool_(True))),
        "whole": rng.integers(0, 256, (7, 9)).astype(np.float32),
        "deep": rng.integers(0, 65536, (7, 9)).astype(np.int32),
        "minus zero": np.array([-0.0, 1.0], np.float32),
        "parts": rng.standard_normal((5, 3)),
        "nan": np.array([np.nan, 3.0], np.float32),
        "mask": rng.random((7, 9)) < 0.5,
        "empty": np.zeros((0, 3), bool),
    }
    arrays = []
    tree = json.loads(json.dumps(encode(values, arrays)))
    again = decode(tree, arrays)
    assert str(again["plain"]) == str(values["plain"])
    assert again["pair"] == values["pair"]
    assert [type(item) for item in again["pair"][1]] == [float, np.float32, np.int64, np.bool_]
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            assert again[name].dtype == value.dtype
            assert again[name].shape == value.shape
            assert again[name].tobytes() == value.tobytes(), name
    assert arrays[0].dtype == np.uint8
    for strange in (object(), {1: 2}, print, b"x", {"x": {1}}):
        with pytest.raises(TypeError):
            encode(strange, [])


@pytest.mark.parametrize("steps", ["even", "uneven"])
def test_joined_parts_are_the_pictures_in_order_at_their_times(tmp_path, steps):
    pytest.importorskip("av")
    rng = np.random.default_rng(4)
    times = np.cumsum(np.full(60, 0.04) if steps == "even" else rng.uniform(0.005, 0.4, 60))
    pictures = synthetic.flight(frames=60, velocity_m_s=(0.1, 0.05, 0.0), seed=1).images
    parts, cuts = [], [0, 1, 2, 25, 27, 60]
    for number, (begin, end) in enumerate(itertools.pairwise(cuts)):
        path = tmp_path / f"{number}.mp4"
        with rsflow.VideoWriter(path, frame_rate=25) as video:
            for k in range(begin, end):
                video.write(pictures[k], float(times[k]))
        parts.append(Part(path, end - begin, round((times[begin] - times[0]) * sinks.CLOCK)))
    join(parts, tmp_path / "whole.mp4", codec="h264", library="av", frame_rate=25)
    with rsflow.frames(tmp_path / "whole.mp4") as stream:
        found = list(stream)
    assert len(found) == 60
    assert np.abs([frame.t_s - time for frame, time in zip(found, times - times[0], strict=True)]).max() < 0.002
    for frame, picture in zip(found, pictures, strict=True):
        assert np.abs(frame.image.astype(int) - picture).mean() < 6
    (tmp_path / "3.mp4").write_bytes((tmp_path / "0.mp4").read_bytes())
    with pytest.raises(OSError, match=r"3\.mp4: has 1 pictures, expected 2"):
        join(parts, tmp_path / "whole.mp4", codec="h264", library="av", frame_rate=25)
