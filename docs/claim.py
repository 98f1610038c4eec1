"""The first claim of the README, made of the table that `rsflow bench --update` wrote into the page on accuracy.

python docs/claim.py
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "explanation" / "accuracy.md"
README = ROOT / "README.md"
BEGIN, END = "<!-- claim-start -->\n", "<!-- claim-end -->"
SCENE = "640 x 480, gain 0.7, plus 20"


def figures(page: str) -> dict[str, tuple[float, float]]:
    """Give the median error in pixels and the time in ms of each method of dense flow on the scene of the claim."""
    found: dict[str, tuple[float, float]] = {}
    table = page[page.index("| dense flow: scene") : page.index("| points: scene")]
    scene = ""
    for line in table.splitlines()[2:]:
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if cells:
            scene = cells[0] or scene
            if scene == SCENE:
                found[cells[1]] = float(cells[2].removesuffix(" px")), float(cells[5].removesuffix(" ms"))
    return found


def claim(page: str) -> str:
    """Give the claim, as Markdown."""
    found = figures(page)
    (ours, ours_ms), (dis, dis_ms) = found["rsflow dense_flow, fast"], found["OpenCV DIS, medium"]
    farneback, farneback_ms = found["OpenCV Farneback"]
    conditions = re.findall(r"^CPU level .*; rsflow .*$", page, flags=re.MULTILINE)[0].rstrip(".")
    text = (
        "**Where the light changes between two frames** (640 x 480, gain 0.7, plus 20 grey levels) dense flow is off "
        f"by {ours:.3f} px at the median and takes {ours_ms:.0f} ms; OpenCV's DIS (medium) is off by {dis:.3f} px and "
        f"takes {dis_ms:.0f} ms, Farneback by {farneback:.3f} px and {farneback_ms:.0f} ms. What cannot be measured "
        "says so, and what can says how sure it is. [All tables, with what to distrust](docs/explanation/accuracy.md): "
        f"`rsflow bench` makes them ({conditions})."
    )
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False) + "\n"


def with_claim(readme: str, page: str) -> str:
    """Give the README with the claim between its two lines."""
    begin, end = readme.index(BEGIN) + len(BEGIN), readme.index(END)
    return f"{readme[:begin]}\n{claim(page)}\n{readme[end:]}"


if __name__ == "__main__":
    made = with_claim(README.read_text(encoding="utf-8"), PAGE.read_text(encoding="utf-8"))
    README.write_text(made, encoding="utf-8")
