"""Make the README's links absolute, so that they also hold on the package index: where its picture would be missing.

python .ci/absolute_links.py        in a workflow, which says where the repository is
"""

from __future__ import annotations

import os
import re
from pathlib import Path

README = Path(__file__).resolve().parent.parent / "README.md"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^)\s]+)\)")


def absolute(text: str, repository: str, commit: str) -> str:
    """Give Markdown whose links to files lead into the `repository` (a URL) at a `commit`; pictures to their bytes."""

    def led(match: re.Match[str]) -> str:
        picture, words, target = match.groups()
        if re.match(r"[a-z]+:|#", target):
            return match[0]
        return f"{picture}[{words}]({repository}/{'raw' if picture else 'blob'}/{commit}/{target})"

    return LINK.sub(led, text)


if __name__ == "__main__":
    where = f"{os.environ['GITHUB_SERVER_URL']}/{os.environ['GITHUB_REPOSITORY']}"
    README.write_text(absolute(README.read_text(encoding="utf-8"), where, os.environ["GITHUB_SHA"]), encoding="utf-8")
