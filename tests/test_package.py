"""The package itself: light to import, honest about its build, clear about what is missing."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import rsflow

HEAVY = ("cv2", "matplotlib", "yaml", "tqdm", "av", "pyarrow", "scipy", "skimage")


def run_python(code: str, **env: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, **env},
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_loads_nothing_heavy():
    found = run_python(f"import sys, rsflow; print([name for name in {HEAVY!r} if name in sys.modules])")
    assert found.strip() == "[]"


def test_import_takes_under_100_ms_beyond_numpy():
    code = (
        "import time, numpy\nstart = time.perf_counter()\nimport rsflow\n"  #
        "print(time.perf_counter() - start)"
    )
    assert min(float(run_python(code)) for _ in range(5)) < 0.1


def test_every_public_name_resolves():
    for name in [*rsflow.__all__, *rsflow._SUBMODULES]:
        assert getattr(rsflow, name) is not None
    assert set(rsflow._LAZY) <= set(rsflow.__all__)
    assert dir(rsflow) == sorted({*rsflow.__all__, *rsflow._SUBMODULES})
    assert not any(name.startswith("_") for name in set(dir(rsflow)) - {"__version__"})
    with pytest.raises(AttributeError, match="no attribute 'flows'"):
        _ = rsflow.flows


@pytest.mark.parametrize(
    "name",
    [
        *(
            "bench.measure",
            "reproduce.report",
            "segmentation.MotionSegmenter",
            "tracking.TrackTable",
            "velocity.Heights",
        ),
        *(
            "camera.board",
            "camera.calibration",
            "camera.capture",
            "camera.formats.convert_camera",
            "camera.load_camera",
        ),
        *("interop.flow_sensor", "interop.mavlink", "interop.opencv.calcOpticalFlowPyrLK", "interop.ros"),
    ],
)
def test_what_is_written_as_an_attribute_is_one_whatever_was_imported_before(name: str) -> None:
    run_python(f"import rsflow; rsflow.{name}")


def test_build_info_names_the_instructions():
    info = rsflow.build_info()
    assert info["version"] == rsflow.__version__
    assert info["cpu_level"] in info["cpu_levels"]
    assert info["threads"] == rsflow.get_num_threads()


def test_the_environment_can_lower_the_cpu_level():
    assert run_python("import rsflow; print(rsflow.build_info()['cpu_level'])", RSFLOW_CPU="baseline") == "baseline\n"


def test_number_of_threads_is_set_and_checked():
    before = rsflow.get_num_threads()
    try:
        rsflow.set_num_threads(3)
        assert rsflow.get_num_threads() == 3
        rsflow.set_num_threads(0)
        assert rsflow.get_num_threads() >= 1
        with pytest.raises(rsflow.OptionError, match="threads: got -1, expected 1 to 1024, or 0 for one for each CPU"):
            rsflow.set_num_threads(-1)
    finally:
        rsflow.set_num_threads(before)


def test_a_missing_extra_says_what_to_install():
    code = (
        "import sys; sys.modules['yaml'] = None\n"
        "from rsflow._extras import require\n"
        "import rsflow\n"
        "try:\n    require('yaml', extra='yaml', purpose='reading YAML')\n"
        "except rsflow.MissingExtraError as error:\n    print(error)"
    )
    assert run_python(code).strip() == (
        "reading YAML needs the package 'yaml', which is not installed: pip install 'rsflow-motion[yaml]'"
    )
