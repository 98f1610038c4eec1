"""What is published is whole: licences, links that stay within the package, versions that agree."""

from __future__ import annotations

import re
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
