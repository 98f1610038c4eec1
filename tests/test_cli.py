"""The command line: overview, errors on one line, exit codes, and the commands that need no estimator of their own."""

import itertools
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from rsflow import cli, synthetic
from rsflow.cli import COMMANDS, main


def lines_of(capsys):
    out, err = capsys.readouterr()
    return out, err.splitlines()


def test_overview_imports_nothing_heavy():
    code = (
        "import sys, rsflow.cli; rc = rsflow.cli.main(['--help']);"
        "heavy = {'cv2', 'matplotlib', 'tqdm', 'av', 'yaml'} & set(sys.modules); print(rc, sorted(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("0 []\n"), done.stdout


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_is_listed_and_teaches(name, capsys):
    assert main(["--help"]) == 0
    assert f"\n  {name} " in capsys.readouterr().out
    assert main([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"rsflow {name}" in text
    assert "example" in text
    assert "exit code" in text.lower()
    assert main(["help", name]) == 0
    assert capsys.readouterr().out == text


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("rsflow ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["a command is needed", "extract"]),
        (["extrct"], ["there is no command 'extrct'", "did you mean 'extract'"]),
        (["zzz"], ["there is no command 'zzz'", "rsflow --help"]),
        (["extract"], ["the following arguments are required", "SOURCE"]),
        (["extract", "a.mp4", "-o", "b", "--heigth", "1"], ["--heigth", "did you mean '--height'"]),
        (["extract", "a.mp4", "-o", "b", "--roi", "1,2"], ["expected x,y,width,height", "'1,2'"]),
        (["extract", "a.mp4", "-o", "b", "--preset", "best"], ["--preset: got 'best', expected", "balanced"]),
        (["extract", "a.mp4", "-o", "b", "--height", "1", "--height-csv", "h.csv"], ["not allowed with"]),
        (["live", "a.mp4", "--quux", "3"], ["unrecognized arguments: --quux 3 (see"]),
        (["live", "a.mp4", "--view-rate", "nan"], ["--view-rate: got 'nan', expected a number above 0"]),
        (["demo", "--frames", "3"], ["at least 10"]),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(arguments, words, capsys):
    assert main(arguments) == 2
    out, err = lines_of(capsys)
    assert out == ""
    assert len(err) == 1, err
    for word in words:
        assert word in err[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["extract", "missing.mp4", "-o", "out"], ["rsflow extract: ", "missing.mp4"]),
        (["extract", "missing.mp4", "-o", "out", "--height", "1"], ["--height: got one", "--camera"]),
        (["live", "missing.mp4"], ["rsflow live: ", "missing.mp4"]),
        (["live", "missing.mp4", "--height", "1"], ["--camera, --height: got ", "both"]),
    ],
)
def test_failures_are_one_line_and_exit_code_1(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 1
    _, err = lines_of(capsys)
    assert len(err) == 1, err
    for word in words:
        assert word in err[0]
    assert list(tmp_path.iterdir()) == []


def command_that(raises, monkeypatch):
    class Module:
        DESCRIPTION = "x"

        @staticmethod
        def add_arguments(parser):
            pass

        @staticmethod
        def run(args):
            raise raises

    monkeypatch.setitem(cli.COMMANDS, "probe", ("probe_module", "x"))
    monkeypatch.setitem(sys.modules, "probe_module", Module)


def test_a_fault_of_the_program_is_one_line_too(capsys, monkeypatch):
    command_that(ZeroDivisionError("division\nby zero"), monkeypatch)
    assert main(["probe"]) == 1
    _, err = lines_of(capsys)
    assert err == [
        "rsflow probe: internal error, ZeroDivisionError: division by zero "
        "(a fault of rsflow; RSFLOW_TRACEBACK=1 shows where)"
    ]
    monkeypatch.setenv("RSFLOW_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        main(["probe"])


def test_errors_of_the_system_name_the_file(capsys, monkeypatch):
    command_that(FileNotFoundError(2, "No such file or directory", "a/b.yaml"), monkeypatch)
    assert main(["probe"]) == 1
    assert lines_of(capsys)[1] == ["rsflow probe: a/b.yaml: No such file or directory"]
    command_that(PermissionError(13, "Permission denied", "out/.run.working-1-a2-b3"), monkeypatch)
    assert main(["probe"]) == 1
    assert lines_of(capsys)[1] == ["rsflow probe: cannot write into the folder out: Permission denied"]


def test_interrupt_is_exit_code_130(capsys, monkeypatch):
    command_that(KeyboardInterrupt(), monkeypatch)
    assert main(["probe"]) == 130
    assert lines_of(capsys)[1] == ["rsflow probe: interrupted"]


def test_a_reader_that_goes_away_is_no_error(tmp_path):
    command = f"{sys.executable} -m rsflow doctor --json | head -c 1 > /dev/null; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


# --- doctor ---------------------------------------------------------------------------------------------------------


def test_doctor_is_well_here(capsys):
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    for word in ("rsflow", "opencv", "test shift", "test dense flow", "test points", "ms for 320 x 240"):
        assert word in text
    assert text.endswith("all is well\n")


def test_doctor_as_json(capsys):
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["wrong"] == []
    assert found["opencv"]["wheels"]
    assert {check["passed"] for check in found["self_test"].values()} == {True}


def test_doctor_names_a_clash_of_wheels(capsys, monkeypatch):
    from rsflow.cli import doctor

    versions = {"opencv-python": "4.10.0.84", "opencv-python-headless": "5.0.0.93"}
    monkeypatch.setattr(doctor, "_version", lambda name: versions.get(name, "1.0" if "opencv" not in name else None))
    monkeypatch.setattr(doctor, "self_test", dict)
    assert main(["doctor"]) == 1
    text = capsys.readouterr().out
    assert "wrong: 2 OpenCV wheels overwrite each other" in text
    assert "pip uninstall -y opencv-python opencv-python-headless" in text


@pytest.mark.parametrize(
    ("files", "shared"),
    [
        (["main.py"], None),
        (["rsflow/__init__.py"], "the package in .*rsflow"),
        (["main.py", "<command>"], "the command rsflow"),
        (["rsflow/cli.py", "<command>"], "the package in .*rsflow and the command rsflow"),
    ],
)
def test_doctor_tells_of_the_other_distribution(capsys, monkeypatch, tmp_path, files, shared):
    from rsflow.cli import doctor

    folder = tmp_path / "rsflow-0.1.1.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: rsflow\nVersion: 0.1.1\n")
    if "<command>" in files:
        (folder / "entry_points.txt").write_text("[console_scripts]\nrsflow = main:main\n")
    package = tmp_path / "rsflow"
    (package / "cli").mkdir(parents=True)
    # Those that are there: where the backport of importlib.metadata is loaded, others are not told.
    there = [name for name in files if name != "<command>"]
    for name in there:
        (tmp_path / name).touch()
    (folder / "RECORD").write_text("".join(f"{name},,\n" for name in there))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(doctor, "__file__", str(package / "cli" / "doctor.py"))
    monkeypatch.setattr(doctor, "self_test", dict)
    assert main(["doctor"]) == (0 if shared is None else 1)
    text = capsys.readouterr().out
    if shared is None:
        assert "advice: the distribution rsflow 0.1.1 is not this program, which is rsflow-motion" in text
    else:
        told = rf"wrong: the distribution rsflow 0\.1\.1 is not this program and overwrites {shared}: "
        assert re.search(told + "pip uninstall -y rsflow, then pip install --force-reinstall rsflow-motion\n", text)


def test_doctor_tells_a_wrong_measurement(capsys, monkeypatch):
    from rsflow.cli import doctor

    bad = {"shift": {"error_px": 0.7, "time_ms": 1.0, "passed": False}}
    monkeypatch.setattr(doctor, "self_test", lambda: bad)
    assert main(["doctor"]) == 1
    assert "wrong: self-test of shift: off by 0.700 px" in capsys.readouterr().out


# --- live -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A short flight to the right as numbered pictures, its camera beside it."""
    import cv2

    folder = tmp_path_factory.mktemp("clip")
    flight = synthetic.flight(frames=5, velocity_m_s=(0.03, 0.01, 0.0), seed=2)
    for index, image in enumerate(flight.images):
        cv2.imwrite(str(folder / f"{index:03d}.png"), image)
    flight.camera.save(folder / "camera.json")
    return folder


def test_live_prints_a_line_a_frame(clip, capsys):
    assert main(["live", f"{clip}/*.png", "--frames", "3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["frame", "t_s", "dx_px", "dy_px", "std_px", "status"]
    assert len(lines) == 4
    # 0.03 m/s * 180 px / 0.2 m / 30 Hz to the left.
    assert float(lines[1].split()[2]) == pytest.approx(-0.9, abs=0.05)


def test_live_as_json_lines(clip, capsys):
    assert main(["live", f"{clip}/*.png", "--json"]) == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [reading["frame"] for reading in found] == [1, 2, 3, 4]
    assert found[0]["status"] == "ok"
    assert found[0]["vx_m_s"] is None


def test_live_measures_velocity_with_camera_and_height():
    from rsflow import live

    flight = synthetic.flight(frames=4, velocity_m_s=(0.03, 0.01, 0.0), seed=2)
    pairs = list(zip(flight.images, flight.t_s, strict=True))
    found = list(live.readings(pairs, camera=flight.camera, height_m=0.2))
    assert [reading.velocity_status for reading in found] == ["ok"] * 3
    np.testing.assert_allclose([reading.vx_m_s for reading in found], 0.03, atol=1e-3)
    np.testing.assert_allclose([reading.vy_m_s for reading in found], 0.01, atol=1e-3)
    assert len(found[0].notes) == 1
    assert "not stated" in found[0].to_dict()["notes"][0]
    (reading, *_) = live.readings(pairs, camera=flight.camera.scaled(352, 288), height_m=0.2, height_std_m=0.0)
    assert "was scaled to 176 x 144" in reading.notes[0]
    assert "height" not in reading.notes[1]


def test_live_says_that_a_headless_opencv_has_no_window(clip, capsys, monkeypatch):
    from rsflow.cli import doctor

    monkeypatch.setattr(doctor, "opencv_windows", lambda: "NONE")
    assert main(["live", f"{clip}/*.png", "--window"]) == 1
    _out, err = lines_of(capsys)
    assert len(err) == 1
    assert "headless and has no windows" in err[0]
    assert "pip install opencv-python" in err[0]


def test_interrupted_live_ends_with_130(clip):
    code = (
        "import sys, os, signal, rsflow.live as live\n"
        "from rsflow.cli import main\n"
        "real = live.readings\n"
        "def slow(*a, **k):\n"
        "    for reading in real(*a, **k):\n"
        "        yield reading\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "live.readings = slow\n"
        f"sys.exit(main(['live', {os.fspath(clip) + '/*.png'!r}]))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "rsflow live: interrupted\n")
    assert len(done.stdout.splitlines()) == 2


def plain(line):
    return bool(line) and not line.startswith(" ")


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_help_fits_the_terminal_and_loses_no_word(command, capsys, monkeypatch):
    told = {}
    for columns in (200, 80, 40):
        monkeypatch.setenv("COLUMNS", str(columns))
        with pytest.raises(SystemExit):
            cli._parsed([command, "--help"])
        whole = capsys.readouterr().out
        before = re.split(r"\n\n(?:positional arguments|options):\n", whole)[0]
        told[columns] = before.split("\n\n", 1)[1]
        lines = told[columns].splitlines()
        loose = " " if columns < 80 else "  rsflow "
        assert [line for line in lines if len(line) > columns and not line.startswith(loose)] == []
        # A command to copy stays whole, what it does stands behind it or below.
        examples = [line for line in told[200].splitlines() if line.startswith("  rsflow ")]
        assert {line.strip().split("   ")[0] for line in examples} <= {line.strip().split("   ")[0] for line in lines}
        assert [line for line in lines if len(line) > columns and "   " in line.strip()] == []
        # A paragraph is filled: no line ends before the next word would not fit.
        filled = itertools.pairwise(lines) if columns == 80 else ()
        short = [one for one, other in filled if plain(one) and plain(other) and len(f"{one} {other.split()[0]}") < 79]
        assert short == []
    assert told[40].split() == told[80].split() == told[200].split()


def test_stop_and_frames_mean_the_same_range_and_the_same_result(clip, capsys, tmp_path):
    out = tmp_path / "out"

    def frames_of(*options):
        assert main(["track", str(clip), "-o", str(out), *options]) == 0, capsys.readouterr().err
        return len({line.split(",")[0] for line in (out / "tracks.csv").read_text().splitlines()[1:]})

    assert frames_of("--start", "1", "--frames", "2") == 2
    # It is the result that is there already: none that would have to be overwritten.
    assert frames_of("--start", "1", "--stop", "3") == 2
    assert main(["track", str(clip), "-o", str(out), "--start", "1", "--stop", "4"]) == 1
    assert "--overwrite" in capsys.readouterr().err
    # Of five frames 0 and 2.
    assert frames_of("--frames", "2", "--stride", "2", "--overwrite") == 2
    assert main(["track", str(clip), "-o", str(out), "--frames", "2", "--stop", "2"]) == 2
    assert "--stop: not allowed with argument --frames" in capsys.readouterr().err
    assert main(["track", str(clip), "-o", str(out), "--frames", "0"]) == 2
    assert "--frames: got '0', expected a whole number of at least 1" in capsys.readouterr().err


@pytest.mark.parametrize("word", ["--frames", "--stop"])
def test_live_ends_by_both_words(clip, capsys, word):
    assert main(["live", str(clip), "--json", word, "2"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        ("segment CLIP -o OUT --line 1,1,1,1", 2, "--line: got '1,1,1,1', expected X0,Y0,X1,Y1: two ends at different"),
        ("segment CLIP -o OUT --line -1,2,3", 2, "--line: got '-1,2,3', expected four numbers X0,Y0,X1,Y1"),
        ("extract CLIP -o OUT --scale -1", 2, "--scale: got '-1', expected a number above 0"),
        ("grid CLIP -o OUT --scale -1mm/px", 2, "--scale: got '-1mm/px', expected a length a pixel above 0"),
        ("grid CLIP -o OUT --scale 5/px", 2, "--scale: got '5/px', expected a length a pixel above 0"),
        ("grid CLIP -o OUT --dt -1ms", 2, "--dt: got '-1ms', expected a time above 0, as 1ms"),
        ("grid CLIP -o OUT --window 0", 1, "--window: got 0, expected an integer of pixels from 8 to 256"),
        ("extract CLIP -o OUT --roi -1,2,3,4", 1, "--roi: got (-1, 2, 3, 4), expected (x, y, width, height), four"),
        ("extract CLIP -o OUT --rate 0", 1, "--rate: got 0.0, expected a positive number of frames per second"),
        ("extract CLIP -o OUT --height 1", 1, "--height: got one, expected --camera with it"),
        ("extract CLIP -o OUT --height-std x", 2, "--height-std: got 'x', expected a number"),
        ("extract CLIP -o OUT --camera CLIP/camera.json --height -1", 1, "--height: got -1.0, expected a positive"),
        (
            "flow CLIP -o OUT --max-displacement -1",
            1,
            "--max-displacement: got -1.0, expected a positive number of pixels",
        ),
        ("velocity CLIP -o OUT --camera CLIP/camera.json --height 1 --mavlink x", 1, "--mavlink: got "),
        ("live CLIP --json --seconds -1", 2, "--seconds: got '-1', expected a number above 0"),
        ("live CLIP --json --scale -1", 2, "--scale: got '-1', expected a number above 0"),
        ("batch CLIP -o OUT --jobs x", 2, "--jobs: got 'x', expected a whole number"),
        ("bench nothing", 2, "subject: got 'nothing', expected kinds, velocity, segmentation or extract"),
    ],
)
def test_a_value_that_is_wrong_is_told_by_its_option_as_typed_and_by_what_is_expected(
    clip, capsys, tmp_path, line, code, message
):
    assert main(line.replace("CLIP", str(clip)).replace("OUT", str(tmp_path / "out")).split()) == code
    (told,) = capsys.readouterr().err.splitlines()
    assert message in told
    assert "None" not in told
