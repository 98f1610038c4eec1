"""Nothing is written over what is read, nor over the result of another run; where no frame is left, all say so."""

import json
import os
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from extraction_helpers import names_in
from rsflow import synthetic
from rsflow._results.identity import of_file, of_settings, of_source
from rsflow._results.inputs import Inputs, source_files
from rsflow.batch import extract_many
from rsflow.cli import main
from rsflow.errors import CaptureError, OptionError
from rsflow.extraction.file_names import partial_name


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A clip of 12 frames, the same as pictures, its camera, and pictures of a board."""
    folder = tmp_path_factory.mktemp("made")
    flight = synthetic.flight(frames=12, height_m=0.2, velocity_m_s=(0.04, 0.0, 0.0), seed=2)
    with rsflow.VideoWriter(folder / "clip.mp4", frame_rate=30) as video:
        for image in flight.images:
            video.write(image)
    (folder / "imgs").mkdir()
    for index, image in enumerate(flight.images[:6]):
        cv2.imwrite(str(folder / "imgs" / f"{index:03}.png"), image)
    flight.camera.save(folder / "camera.json")
    (folder / "heights.csv").write_text("t_s,height_m\n0,0.2\n1,0.2\n")
    (folder / "far.csv").write_text("t_s,height_m\n100,0.2\n200,0.2\n")
    (folder / "beyond.csv").write_text("t_s,height_m\n0.6,0.2\n0.7,0.2\n")
    (folder / "frames.csv").write_text("frame,height_m\n500,0.2\n501,0.2\n")
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def refused(arguments, capsys):
    before = contents(Path())
    assert main(arguments) == 1, arguments
    line = capsys.readouterr().err.strip()
    assert len(line.splitlines()) == 1
    assert contents(Path()) == before
    return line


# --- what is read ---------------------------------------------------------------------------------------------------

METRIC = ["--camera", "camera.json", "--height", "0.2"]


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("flow.mp4", "extract flow.mp4 -o ."),
        ("flow.partial.mp4", "extract flow.partial.mp4 -o ."),
        ("moving.mp4", "segment moving.mp4 -o ."),
        ("static.mp4", "segment static.mp4 -o ./"),
        ("tracks.mp4", "track tracks.mp4 -o ."),
        ("tracks.mp4", "track tracks.mp4"),
        ("arrows.mp4", "flow arrows.mp4 --picture arrows.mp4"),
        ("out/flow.mp4", "extract out/flow.mp4 -o imgs/../out"),
        ("out/flow/static.mp4", "batch out/flow/static.mp4 clip.mp4 flow.mp4 -o out"),
    ],
)
def test_a_video_that_would_be_an_output_is_refused(here, capsys, name, command):
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy("clip.mp4", name)
    arguments = command.split()
    line = refused(arguments, capsys)
    assert "which is read" in line
    assert Path(name).name in line


@pytest.mark.parametrize("link", [os.link, os.symlink, "other case"])
def test_identity_counts_and_not_names(here, capsys, link):
    if link == "other case":
        Path("FLOW.MP4").write_bytes(Path("clip.mp4").read_bytes())
        if not Path("flow.mp4").exists():
            pytest.skip("this file system tells upper from lower case")
    else:
        link(here / "clip.mp4", here / "flow.mp4")
    line = refused(["extract", "clip.mp4" if link != "other case" else "FLOW.MP4", "-o", "."], capsys)
    assert "flow.mp4" in line


def test_pictures_pairs_files_of_flow_and_of_cameras(here, capsys):
    shutil.copy("imgs/000.png", "a.png")
    shutil.copy("imgs/001.png", "b.png")
    for output in ("a.png", "b.png"):
        assert output in refused(["flow", "a.png", "b.png", "-o", output], capsys)
        assert output in refused(["flow", "a.png", "b.png", "--picture", output], capsys)
    rsflow.write_flow("guess.flo", np.zeros((*cv2.imread("a.png").shape[:2], 2), np.float32))
    assert "guess.flo" in refused(["flow", "a.png", "b.png", "--initial", "guess.flo", "-o", "guess.flo"], capsys)
    Path("again.flo").symlink_to("guess.flo")
    assert "again.flo" in refused(["convert", "guess.flo", "again.flo"], capsys)
    assert "camera.json" in refused(["convert", "camera.json", "camera.json"], capsys)
    with pytest.raises(OptionError, match="which is read"):
        rsflow.camera.formats.convert_camera("camera.json", "./camera.json")
    shutil.copy("camera.json", "velocity.csv")
    assert "velocity.csv" in refused(["velocity", "clip.mp4", "--camera", "velocity.csv", "--height", "1"], capsys)
    shutil.copy("heights.csv", "trajectory.csv")
    arguments = ["extract", "clip.mp4", "-o", ".", "--camera", "camera.json", "--height-csv", "trajectory.csv"]
    assert "trajectory.csv" in refused(arguments, capsys)


@pytest.mark.parametrize(
    "command",
    [
        "extract imgs -o imgs --rate 30",
        "extract imgs/*.png -o imgs --rate 30",
        "extract imgs/**/*.png -o imgs/new --rate 30",
        "extract im*/[!x]*.png -o imgs --rate 30",
        "extract imgs/0*.png -o imgs --rate 30",
        "velocity imgs -o imgs --rate 30 --camera camera.json --height 0.2",
        "velocity imgs/*.png -o imgs --rate 30 --camera camera.json --height 0.2",
        "flow imgs -o imgs --format png",
        "batch imgs -o . --rate 30",
    ],
)
def test_results_do_not_become_frames(here, capsys, command):
    line = refused(command.split(), capsys)
    assert "imgs" in line


def test_what_is_no_frame_is_written_beside_the_pictures(here, capsys):
    assert main(["segment", "imgs", "-o", "imgs", "--rate", "30"]) == 0
    assert main(["flow", "imgs/000.png", "imgs/001.png", "-o", "imgs/pair.flo", "--picture", "imgs/pair.png"]) == 0
    # What is found of a board is not drawn among the pictures of it.
    Path("board").mkdir()
    for number, view in enumerate(rsflow.synthetic.chessboard_views(rsflow.Camera.load("camera.json"), seed=1)):
        cv2.imwrite(f"board/{number}.png", view)
    command = ["calibrate", "board", "--board", "8x6", "--square", "0.025", "--pictures"]
    capsys.readouterr()
    assert "coverage.png" in refused([*command, "board"], capsys)
    assert main([*command, "board/corners"]) == 0


@pytest.mark.parametrize("call", [
    lambda: rsflow.extract("flow.mp4", "."),
    lambda: rsflow.extract(Path("flow.mp4").resolve(), Path()),
    lambda: rsflow.extract(["imgs/000.png", "imgs/001.png"], "imgs"),
    lambda: rsflow.extract([("imgs/000.png", 0.0), ("imgs/001.png", 0.1)], "./imgs/../imgs"),
    lambda: rsflow.extract("clip.mp4", ".", camera="trajectory.csv", height_m=0.2),
    lambda: extract_many(["flow.mp4", "out/flow/motion.csv"], "out"),
    lambda: rsflow.extract(f"file://{Path('flow.mp4').resolve()}", "."),
])  # fmt: skip
def test_functions_refuse_too(here, call):
    shutil.copy("clip.mp4", "flow.mp4")
    shutil.copy("camera.json", "trajectory.csv")
    Path("out/flow").mkdir(parents=True)
    shutil.copy("clip.mp4", "out/flow/motion.csv")
    before = contents(here)
    with pytest.raises(OptionError, match=r"cannot write .*(which is read|read as a frame)"):
        call()
    assert contents(here) == before


def test_the_files_of_a_source(here):
    def names(source):
        return sorted(str(path) for path in source_files(source))

    assert names("imgs") == [f"imgs/{n:03}.png" for n in range(6)]
    assert names("imgs/%03d.png") == names("imgs/*.png") == names(Path("imgs"))
    assert names(("a.png", 0.1)) == []
    assert names(["imgs/000.png", ("imgs/001.png", 0.5), np.zeros((2, 2))]) == ["imgs/000.png", "imgs/001.png"]
    assert names(("imgs/000.png", "imgs/001.png")) == ["imgs/000.png", "imgs/001.png"]
    assert names(0) == names("rtsp://host/x") == names(iter([])) == names("missing.mp4") == []
    Inputs("clip.mp4").refuse(["/dev/null", "new.mp4"])


# --- what stands in the folder --------------------------------------------------------------------------------------

QUICK = ["--no-videos", "-q"]


def test_the_same_command_again_replaces_its_result(here):
    for _ in range(2):
        assert main(["extract", "clip.mp4", "-o", "out", *QUICK]) == 0
    # The same source under another name, and options that say the same.
    shutil.copy("clip.mp4", "copy.mp4")
    rsflow.extract("copy.mp4", "out", videos=False, stride=np.int64(1))


@pytest.mark.parametrize(
    ("second", "what"),
    [
        (["extract", "other.mp4"], "another source"),
        (["extract", "imgs", "--rate", "30"], "another source"),
        (["extract", "clip.mp4", "--stride", "2"], "other settings .*stride was 1"),
        (["extract", "clip.mp4", *METRIC], "other settings"),
        (["extract", "clip.mp4", "--start", "1"], "other settings"),
    ],
)
def test_the_result_of_another_run_is_refused(here, capsys, second, what):
    with rsflow.frames("clip.mp4") as stream, rsflow.VideoWriter("other.mp4", frame_rate=30) as video:
        for frame in stream:
            video.write(frame.image[::-1])
    assert main(["extract", "clip.mp4", "-o", "out", "--no-videos", "-q"]) == 0
    line = refused([*second, "-o", "out", *QUICK], capsys)
    assert re.search(what, line), line
    assert "--overwrite" in line
    assert main([*second, "-o", "out", *QUICK, "--overwrite"]) == 0


def test_what_is_overwritten_leaves_nothing_behind(here):
    assert main(["extract", "clip.mp4", "-o", "out", *METRIC, "-q"]) == 0
    assert {"velocity.csv", "flow.mp4"} <= names_in(here / "out")
    assert main(["extract", "clip.mp4", "-o", "out", "--stride", "2", "--no-videos", "-q", "--overwrite"]) == 0
    assert names_in(here / "out") == {"motion.csv", "objects.csv", "background.png", "summary.json", "report.html"}


def test_unknown_and_partial_results_are_refused(here, capsys):
    assert main(["extract", "clip.mp4", "-o", "out", *QUICK]) == 0
    summary = json.loads(Path("out/summary.json").read_text())
    del summary["identity"]
    Path("out/summary.json").write_text(json.dumps(summary))
    assert "of which nothing is known" in refused(["extract", "clip.mp4", "-o", "out", *QUICK], capsys)
    Path("mine").mkdir()
    Path("mine/motion.csv").write_text("mine")
    assert "motion.csv" in refused(["extract", "clip.mp4", "-o", "mine", *QUICK], capsys)
    Path("damaged").mkdir()
    Path("damaged/summary.json").write_text("[" * 100_000)
    assert "summary.json" in refused(["extract", "clip.mp4", "-o", "damaged", *QUICK], capsys)

    def broken():
        yield from [np.zeros((48, 64), np.uint8)] * 4
        raise CaptureError("x")

    with pytest.raises(rsflow.PartialExtractionError):
        rsflow.extract(broken(), "partial", videos=False)
    assert partial_name(Path("partial/motion.csv")).name in refused(
        ["extract", "clip.mp4", "-o", "partial", *QUICK], capsys
    )
    # What comes out of a camera or a generator is never known to be the same.
    with pytest.raises(OptionError, match="cannot be known to be the same"):
        rsflow.extract(broken(), "partial", videos=False)
    with pytest.raises(rsflow.PartialExtractionError):
        rsflow.extract(broken(), "partial", videos=False, overwrite=True)


OTHERS = {
    "segment": (
        ["segment", "{}", "-o", "out"],
        {"moving.mp4", "static.mp4", "objects.csv", "objects.json", "paths.svg"},
    ),
    "track": (["track", "{}", "-o", "out"], {"tracks.mp4", "tracks.csv"}),
    "velocity": (
        ["velocity", "{}", "-o", "out", *METRIC],
        {"velocity.csv", "velocity.svg", "velocity.png", "trajectory.csv"},
    ),
    "grid": (["grid", "{}", "-o", "out"], {"grids.csv"} | {f"grid_{k:06d}.csv" for k in range(1, 12)}),
    "flow": (["flow", "{}", "-o", "out"], {f"flow_{k:06d}.flo" for k in range(1, 12)}),
}


@pytest.mark.parametrize("name", OTHERS)
def test_the_other_commands_have_the_same_rule(here, capsys, name):
    command, files = OTHERS[name]
    with rsflow.frames("clip.mp4", stop=6) as stream, rsflow.VideoWriter("other.mp4", frame_rate=30) as video:
        for frame in stream:
            video.write(frame.image[::-1])

    def arguments(source, *options):
        return [part.format(source) for part in command] + list(options)

    for _ in range(2):
        assert main(arguments("clip.mp4")) == 0
    assert names_in(here / "out") == files | {".rsflow.json"}
    capsys.readouterr()
    assert "another source" in refused(arguments("other.mp4"), capsys)
    assert "other settings" in refused(arguments("clip.mp4", "--stop", "6"), capsys)
    assert main(arguments("other.mp4", "--overwrite")) == 0
    if name == "flow":
        # Nothing is left of the longer clip.
        assert names_in(here / "out") == {f"flow_{k:06d}.flo" for k in range(1, 6)} | {".rsflow.json"}
    Path("out/.rsflow.json").unlink()
    capsys.readouterr()
    assert "of which nothing is known" in refused(arguments("other.mp4"), capsys)


def test_demo_and_reproduce_have_it_too(here, capsys):
    assert main(["extract", "clip.mp4", "-o", "out", *QUICK]) == 0
    assert "motion.csv" in refused(["demo", "-o", "out", "--frames", "10"], capsys)
    for _ in range(2):
        assert main(["demo", "-o", "demo", "--frames", "10", "--json"]) in (0, 1)
    capsys.readouterr()
    assert "other settings" in refused(["demo", "-o", "demo", "--frames", "11"], capsys)
    Path("own").mkdir()
    Path("own/reproduce.txt").write_text("mine")
    assert "reproduce.txt" in refused(["reproduce", "imgs/000.png", "-o", "own"], capsys)


def test_batch_refuses_for_each_source_and_for_a_folder_that_two_share(here, capsys):
    shutil.copytree("imgs", "more")
    command = ["batch", "imgs", "clip.mp4", "-o", "out", "--rate", "30", "--no-videos", "-q", "--jobs", "1"]
    assert main(command) == 0
    # The order decides the names of folders only where two are alike.
    assert main([*command[:1], "clip.mp4", "imgs", *command[3:]]) == 0
    capsys.readouterr()
    assert main([*command, "--preset", "balanced"]) == 1
    assert capsys.readouterr().out.count("failed") == 2
    Path("out/more").symlink_to("imgs")
    with pytest.raises(OptionError, match="one folder"):
        extract_many(["imgs", "more"], "out", videos=False)


def test_identities(here):
    assert of_source("clip.mp4") == of_source(Path("clip.mp4").resolve()) != of_source("imgs")
    assert of_source("imgs") == of_source("imgs/*.png") != of_source("imgs/00[1-9].png")
    a, b = np.zeros((2, 8, 8), np.uint8), np.ones((2, 8, 8), np.uint8)
    assert of_source(a) == of_source(a.copy()) != of_source(b)
    assert of_source(list(a)) == of_source(list(a)) != of_source(list(b))
    assert of_source([(a[0], 0.1)]) != of_source([(a[0], 0.2)])
    assert of_source(iter(a)) is of_source(0) is of_source([None]) is of_source("missing") is None
    data = bytearray(10_000_000)
    Path("x").write_bytes(data)
    before = of_file(Path("x"))
    for place in (0, 5_000_000, 9_999_999):
        data[place] ^= 1
        Path("x").write_bytes(data)
        assert of_file(Path("x")) not in (before, None), place
        data[place] ^= 1
    assert of_settings({"a": 30}) == of_settings({"a": 30.0}) != of_settings({"a": "30"})


# --- nothing to measure ---------------------------------------------------------------------------------------------

COMMANDS = ("extract", "track", "velocity", "segment", "flow")
EMPTY = [["--start", "12"], ["--start", "50"], ["--stop", "0"], ["--start", "5", "--stop", "5"]]


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("limits", EMPTY, ids=" ".join)
def test_an_empty_range_says_how_many_frames_there_are(here, capsys, command, limits):
    for source, count in (("clip.mp4", 12), ("imgs", 6)):
        arguments = [command, source, "-o", "out", *limits, "--rate", "30"]
        line = refused(arguments + (METRIC if command == "velocity" else []), capsys)
        assert f"has {count} frames" in line
        assert not Path("out").exists()


def test_an_empty_range_is_no_interrupt_in_python(here):
    with pytest.raises(CaptureError, match=r"has 12 frames, and none is left by start=50"):
        rsflow.extract("clip.mp4", "out", start=50)
    with pytest.raises(CaptureError, match=r"none is left by start=0, stop=0"):
        rsflow.extract(iter(np.zeros((3, 48, 64), np.uint8)), "out", stop=0)
    with pytest.raises(CaptureError, match=r"has 3 frames, and none is left by start=7, stride=2"):
        rsflow.extract(iter(np.zeros((3, 48, 64), np.uint8)), "out", start=7, stride=2)
    assert not Path("out").exists()
    items = extract_many(["clip.mp4", "imgs"], "out", jobs=1, start=8, videos=False, frame_rate=30)
    assert [item.status for item in items] == ["done", "failed"]
    assert "has 6 frames" in items[1].error


@pytest.mark.parametrize("command", ["extract", "velocity"])
@pytest.mark.parametrize("heights", ["far.csv", "frames.csv", "beyond.csv"])
def test_a_table_of_heights_that_covers_no_frame_is_an_error(here, capsys, command, heights):
    arguments = [command, "clip.mp4", "-o", "out", "--camera", "camera.json", "--height-csv", heights]
    assert main(arguments) == 1
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert heights in line
    assert "frame" in line
    assert not Path("out/velocity.csv").exists()
    if heights != "beyond.csv":
        assert not Path("out").exists()
