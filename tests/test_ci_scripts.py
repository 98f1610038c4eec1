"""What `.ci` holds beside the checks themselves: seeds of the fuzz targets, and the tools that a target needs."""

from __future__ import annotations

import doctest
import hashlib
import os
import runpy
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SEEDS = ROOT / "fuzz" / "seeds"


def test_each_fuzz_target_has_seeds_and_they_are_few() -> None:
    targets = {path.stem for path in (ROOT / "fuzz" / "fuzz_targets").glob("*.rs")}
    assert {path.name for path in SEEDS.iterdir()} == targets
    sizes = []
    for target in targets:
        cases = [path.read_bytes() for path in (SEEDS / target).iterdir()]
        assert 4 <= len(cases) <= 40
        assert {path.name for path in (SEEDS / target).iterdir()} == {
            hashlib.sha256(case).hexdigest()[:12] for case in cases
        }
        sizes += map(len, cases)
    assert max(sizes) <= 96
    assert sum(sizes) < 10_000


def test_seeds_are_chosen_by_what_they_add() -> None:
    made = runpy.run_path(str(ROOT / ".ci" / "fuzz_seeds.py"))
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner()
    for name in ("chosen", "reached"):
        for test in finder.find(made[name], name, globs=made):
            assert test.examples
            assert runner.run(test).failed == 0
    # What adds nothing is not kept, however many may be.
    assert made["chosen"]({b"a": frozenset({1}), b"b": frozenset({1})}, 5) == [b"a"]


def run_test_memory(folder: Path, *arguments: str, **scripts: str) -> subprocess.CompletedProcess[str]:
    """Run the script where there is nothing but what a shell needs, a compiler and programs with these bodies."""
    for tool in ("bash", "sed", "dirname", "env", "tr"):
        (folder / tool).symlink_to(shutil.which(tool) or tool)
    host = '[ "$1" = -vV ] && echo "host: a-b" || echo "$RUST_LIB"'
    for name, body in ({"rustc": host} | scripts).items():
        (folder / name).write_text(f"#!/usr/bin/env bash\n{body}\n")
        (folder / name).chmod(0o755)
    env = {"PATH": str(folder), "RUST_LIB": str(folder)}
    script = [str(ROOT / ".ci" / "test_memory"), *arguments]
    return subprocess.run(script, env=env, capture_output=True, text=True, check=False)


bash_alone = pytest.mark.skipif(os.name != "posix" or shutil.which("bash") is None, reason="a script for bash")


@bash_alone
def test_memory_says_what_it_needs_where_it_is_missing(tmp_path: Path) -> None:
    done = run_test_memory(tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    assert "needs valgrind (apt-get install valgrind), or a Rust toolchain with AddressSanitizer" in done.stderr


@bash_alone
@pytest.mark.parametrize("tool", ["valgrind", "address"])
def test_memory_takes_the_tool_that_is_there(tmp_path: Path, tool: str) -> None:
    cargo = 'echo "$@"; echo "$CARGO_TARGET_A_B_RUNNER;$RUSTFLAGS;$PROPTEST_CASES"'
    if tool == "address":
        (tmp_path / "librustc-stable_rt.asan.a").touch()
        done = run_test_memory(tmp_path, "simd::", cargo=cargo)
    else:
        done = run_test_memory(tmp_path, cargo=cargo, valgrind="")
    assert done.returncode == 0, done.stderr
    build, first, said, run, second = done.stdout.splitlines()
    assert build.endswith(" --no-run")
    assert said.startswith(f"test_memory: {tool}, ")
    assert first == second
    assert "test -p lk-core --locked --lib" in run
    if tool == "address":
        assert run.endswith(" -- simd::")
        assert first == ";-Zsanitizer=address ;4"
    else:
        assert " -- --test-threads=1 --skip dense::tests::scenes " in run
        assert first.startswith("valgrind --quiet --error-exitcode=1 --leak-check=no;")


@bash_alone
def test_memory_fails_with_the_tests(tmp_path: Path) -> None:
    cargo = 'case "$*" in *--no-run) ;; *) exit 101 ;; esac'
    assert run_test_memory(tmp_path, cargo=cargo, valgrind="").returncode == 101
