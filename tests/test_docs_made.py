"""What the documentation makes by itself: the claim, the page of commands, the gallery's pictures, the notebooks."""

from __future__ import annotations

import ast
import re
import runpy
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from browser import opened_browser
from rsflow.cli import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.relative_to(DOCS).parts)
SCRIPTS = sorted((DOCS / "gallery").glob("*.py"))


def test_the_claim_is_what_the_table_says() -> None:
    claim = runpy.run_path(str(DOCS / "claim.py"))
    page = (DOCS / "explanation" / "accuracy.md").read_text(encoding="utf-8")
    assert claim["with_claim"](README, page) == README, "python docs/claim.py"
    ours, dis = (claim["figures"](page)[name][0] for name in ("rsflow dense_flow, fast", "OpenCV DIS, medium"))
    assert ours < dis


def test_the_page_of_commands_is_made_from_the_parsers() -> None:
    made = runpy.run_path(str(DOCS / "command_line.py"))
    page = (DOCS / "reference" / "command-line.md").read_text(encoding="utf-8")
    assert made["with_commands"](page) == page, "python docs/command_line.py"
    for command in COMMANDS:
        assert f"\n### rsflow {command}\n" in page
        parser, _ = made["parser_of"](command)
        text = made["section"](command)
        assert [name for name in parser._option_string_actions if f"`{name}" not in text] == ["-h", "--help"]


def test_the_first_picture_is_small_and_shown() -> None:
    picture = re.search(r"!\[[^\]]{40,}\]\(([^)]+)\)", README)
    assert picture is not None
    assert README.index(picture[0]) < README.index("## ")
    assert 50_000 < (ROOT / picture[1]).stat().st_size < 300_000


def test_links_of_the_published_readme_are_absolute() -> None:
    absolute = runpy.run_path(str(ROOT / ".ci" / "absolute_links.py"))["absolute"]
    made = absolute(README, "https://host/owner/name", "v1")
    links = re.findall(r"\]\(([^)]+)\)", made)
    assert len(links) > 20
    assert [link for link in links if not re.match(r"https?:|#", link)] == []
    assert "](https://host/owner/name/raw/v1/docs/gallery/overview.jpg)" in made
    assert "](https://host/owner/name/blob/v1/docs/explanation/accuracy.md)" in made
    assert len(re.findall(r"absolute_links.py$", (ROOT / ".github/workflows/wheels.yml").read_text(), re.M)) == 2


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_picture_of_the_gallery_is_drawn(script: Path) -> None:
    figure = runpy.run_path(str(script))["draw"](small=True)
    assert figure.get_axes()
    page = (DOCS / "gallery" / "index.md").read_text(encoding="utf-8")
    assert f"(pictures/{script.stem}.png)" in page
    assert f"{{literalinclude}} {script.name}\n" in page


@pytest.mark.parametrize("name", ["report", "live"])
def test_a_screenshot_is_kept_and_shown(name: str) -> None:
    picture = DOCS / "gallery" / f"{name}.jpg"
    assert cv2.imread(str(picture)).shape[1] >= 1000
    assert picture.stat().st_size < 300_000
    page = (DOCS / "gallery" / "index.md").read_text(encoding="utf-8")
    assert f"({name}.jpg)" in page
    assert "{literalinclude} ../screenshots.py\n" in page


def test_screenshots_are_made_anew_by_a_browser_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = runpy.run_path(str(DOCS / "screenshots.py"))
    with monkeypatch.context() as without:
        without.setenv("PATH", "")
        assert made["main"](tmp_path) == 1
    assert "the pictures are kept" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    with opened_browser() as browser:
        picture = made["report"](browser, made["flown"](8), tmp_path)
    assert picture.shape == (1000, 1200, 3)
    # The page is white, and its first frame stands in the lower half.
    assert (picture[:, :90] > 250).mean() > 0.99
    assert np.ptp(picture[700:950, 150:700], axis=(0, 1)).min() > 100


@pytest.mark.parametrize("program", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_a_notebook_runs(program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = runpy.run_path(str(DOCS / "make_notebooks.py"))["notebook"](program)
    cells = made["cells"]
    assert cells[0]["source"][0].startswith("# ")
    assert len({cell["id"] for cell in cells}) == len(cells) >= 5
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["kernel", "-f", "kernel.json"])
    namespace: dict[str, object] = {"__name__": "__main__"}
    shown = 0
    for cell in cells:
        if cell["cell_type"] == "code":
            tree = ast.parse("".join(cell["source"]))
            last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
            exec(compile(tree, program.name, "exec"), namespace)
            if last is not None:
                value = eval(compile(ast.Expression(last.value), program.name, "eval"), namespace)
                shown += len(getattr(value, "_repr_html_", value.__repr__)()) > 40
    assert shown >= 1 or program.stem == "autopilot"


def test_every_page_is_in_a_table_of_contents() -> None:
    trees = "".join(
        block
        for page in PAGES
        for block in re.findall(r"^```\{toctree\}\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.DOTALL)
    )
    listed = {Path(line.strip()).name for line in trees.splitlines()}
    missing = [
        page.relative_to(DOCS).as_posix()
        for page in PAGES
        if page.stem not in listed and f"{page.parent.name}/index" not in trees and page.parent.name != "explanation"
    ]
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_a_page_lead_to_files(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.DOTALL))
    files = [link.partition("#")[0] for link in links if not re.match(r"https?:|#", link)]
    made = ("pictures/", ".ipynb")
    lost = [file for file in files if not (page.parent / file).is_file() and not any(part in file for part in made)]
    assert lost == []
