"""The report page: one HTML file that opens from disk without a network and says what was measured and what not."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

from ..answers import Answer
from .parts import Clip, Part, Slider, marked

__all__ = ["Report", "Section", "page"]


@dataclass(frozen=True)
class Section:
    """Parts under a heading, to which `name` leads."""

    name: str
    title: str
    parts: Sequence[Part]


@dataclass(frozen=True)
class Report:
    """Everything the page shows, from top to bottom."""

    title: str
    subtitle: str
    complete: bool
    answers: Sequence[Answer] = ()
    problems: Sequence[str] = ()
    notes: Sequence[str] = ()
    sections: Sequence[Section] = ()
    #: What it means not to be complete.
    ended_early: str = "the run ended early"

    def bare(self) -> Report:
        """Give it without what takes most room: the videos and the pictures."""
        kept = [
            Section(one.name, one.title, [part for part in one.parts if not isinstance(part, (Clip, Slider))])
            for one in self.sections
        ]
        return dataclasses.replace(self, sections=kept)


def page(report: Report) -> str:
    """Give the HTML text of `report`: one file, styles, pictures and drawings inside."""
    here = files(__package__)
    style, script = ((here / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    state = '<span class="badge complete">complete</span>'
    if not report.complete:
        state = f'<span class="badge partial">partial: {escape(report.ended_early)}</span>'
    shown = [section for section in report.sections if section.parts]
    names = {section.name for section in shown}
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<meta name="color-scheme" content="light dark">',
        f"<title>{escape(report.title)}: motion</title><style>{style}</style></head><body><main>",
        f'<h1>{escape(report.title)}</h1><p class="sub">{escape(report.subtitle)} {state}</p>',
        marked("notes bad", report.problems),
        f'<div class="answers">{"".join(_answer(one, names) for one in report.answers)}</div>',
        marked("notes", report.notes),
        _contents(shown),
        "".join(map(_section, shown)),
        f"</main><script>{script}</script></body></html>\n",
    ]
    return "\n".join(part for part in parts if part)


def _answer(answer: Answer, names: set[str]) -> str:
    facts = "".join(
        f"<p class=fact><b>{escape(_kept_together(fact.value))}</b> <span>{escape(fact.what)}</span></p>"
        for fact in answer.facts
    )
    more = "".join(f'<p class="more">{escape(sentence)}</p>' for sentence in answer.more)
    name = answer.question.rstrip("?").lower().replace(" ", "-")
    title = escape(answer.question)
    if name in names:
        title = f'<a href="#{name}">{title}</a>'
    return f'<section class="answer"><h2>{title}</h2>{facts}{more}</section>'


def _kept_together(value: str) -> str:
    """Let no line break between a number and its unit."""
    return re.sub(r"(?<=[\d±]) (?!±)", "\u00a0", value)


def _contents(sections: Sequence[Section]) -> str:
    links = "".join(f'<a href="#{section.name}">{escape(section.title)}</a>' for section in sections)
    return f'<nav aria-label="contents">{links}</nav>' if links else ""


def _section(section: Section) -> str:
    clips = [part.html() for part in section.parts if isinstance(part, Clip)]
    others = [part.html() for part in section.parts if not isinstance(part, Clip)]
    views = f'<div class="clips">{"".join(clips)}</div>' if clips else ""
    return f'<section id="{section.name}"><h2>{escape(section.title)}</h2>{views}{"".join(others)}</section>'
