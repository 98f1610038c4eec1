"""What is published is whole: licences, links that stay within the package, versions that agree."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CRATE = ROOT / "crates" / "lk-core"
LINK = re.compile(r"\]\(([^)]+)\)")


def toml(path: str) -> dict:
    return tomllib.loads((ROOT / path).read_text(encoding="utf-8"))


@pytest.mark.parametrize(("name", "begins"), [("LICENSE-MIT", "MIT License"), ("LICENSE-APACHE", "Apache License\n")])
def test_each_package_has_the_licences(name, begins):
    text = (ROOT / name).read_text(encoding="utf-8")
    assert text.lstrip().startswith(begins)
    assert (CRATE / name).read_text(encoding="utf-8") == text
    project = toml("pyproject.toml")
    assert name in project["project"]["license-files"]
    assert {"path": name, "format": "sdist"} in project["tool"]["maturin"]["include"]
    assert project["project"]["license"] == toml("Cargo.toml")["workspace"]["package"]["license"]


def test_links_of_the_crates_readme_lead_out_of_no_archive():
    links = LINK.findall((CRATE / "README.md").read_text(encoding="utf-8"))
    assert [link for link in links if not link.startswith(("https://", "#"))] == []


@pytest.mark.parametrize("page", ["README.md", "SECURITY.md"])
def test_links_of_a_page_lead_to_files(page):
    links = LINK.findall((ROOT / page).read_text(encoding="utf-8"))
    files = [link.partition("#")[0] for link in links if not link.startswith(("https://", "#"))]
    assert files
    assert [file for file in files if not (ROOT / file).exists()] == []


@pytest.mark.parametrize(
    "item",
    [
        "fn dense_flow",
        "fn track_points",
        "fn detect_corners",
        "fn estimate_shift",
        "struct Pyramid",
        "struct FlowField",
    ],
)
def test_the_main_items_of_the_crate_have_an_example(item):
    text = "".join(path.read_text(encoding="utf-8") for path in sorted((CRATE / "src").rglob("*.rs")))
    # The comment that stands above it, with attributes in between.
    found = re.findall(rf"((?:^///.*\n|^#\[.*\n)+)^pub {item}\b", text, flags=re.MULTILINE)
    assert len(found) == 1
    assert found[0].count("/// ```") == 2


def test_the_crate_runs_without_its_features():
    crate = toml("crates/lk-core/Cargo.toml")
    assert crate["features"]["default"] == ["rayon"]
    for feature in crate["features"]["rayon"]:
        assert crate["dependencies"][feature.removeprefix("dep:")]["optional"] is True


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def jobs(workflow: Path) -> dict[str, dict]:
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"]


def commands(workflow: Path) -> list[list[str]]:
    """The words of every command that a step runs, those within `docker run ... sh -c` too."""
    found = []
    for job in jobs(workflow).values():
        for step in job["steps"]:
            assert ("run" in step) != ("uses" in step)
            words = shlex.split(step.get("run", ""))
            if words[-2:-1] == ["-c"]:
                found += [shlex.split(part) for part in words[-1].split("&&")]
                words = words[:-2]
            found += [words] if words else []
    return found


def test_there_are_workflows():
    assert [path.name for path in WORKFLOWS] == ["ci.yml", "wheels.yml"]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_what_a_workflow_runs_is_there(workflow):
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    run = commands(workflow)
    assert len(run) >= 5
    for words in run:
        match words:
            case ["make", target, *_]:
                assert target in targets
            case ["python", "-m", module, *_]:
                assert module in ("pip", "pytest")
            case ["python", script]:
                assert (ROOT / script).is_file()
            case ["cargo", command, "-p", crate, *_]:
                assert command in ("test", "check", "clippy", "publish")
                assert (ROOT / "crates" / crate).is_dir()
                assert "--locked" in words
            case [command, *_]:
                assert command in ("rustup", "docker", "pip", "apk", "grep")
        assert [word for word in words if word.startswith("tests/") and not (ROOT / word).is_file()] == []


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_is_bounded_and_needs_what_is_there(workflow):
    found = jobs(workflow)
    for job in found.values():
        assert job["timeout-minutes"] <= 90
        needs = job.get("needs", [])
        assert set([needs] if isinstance(needs, str) else needs) <= set(found)
        for step in job["steps"]:
            assert re.fullmatch(r"[\w-]+/[\w-]+@(v\d+|release/v\d+)", step.get("uses", "actions/checkout@v6"))


def test_wheels_are_tested_where_they_are_built_for():
    wheels = jobs(ROOT / ".github" / "workflows" / "wheels.yml")
    built = {entry["name"] for entry in wheels["build"]["strategy"]["matrix"]["include"]}
    tested = [entry["name"] for job in ("test", "test-musl") for entry in wheels[job]["strategy"]["matrix"]["include"]]
    assert sorted(tested) == sorted(built)
    assert len(built) == 7
    for job in ("publish-wheels", "publish-crate"):
        assert set(wheels[job]["needs"]) == {"test", "test-musl", "sdist", "tag"}
        assert wheels[job]["permissions"]["id-token"] == "write"


def test_workflows_test_the_oldest_that_is_promised():
    ci = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    oldest_rust = toml("Cargo.toml")["workspace"]["package"]["rust-version"]
    oldest_python = toml("pyproject.toml")["project"]["requires-python"].removeprefix(">=")
    assert f'{{ python: "{oldest_python}", rust: "{oldest_rust}" }}' in ci
    assert set(re.findall(r"rustup (?:toolchain install|default) ([\d.]+)", ci)) == {oldest_rust}
