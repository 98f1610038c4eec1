"""The parts of which the page is made, each of which gives its HTML: text, plots, tables, videos, the slider."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Protocol

from ..slides import Slide, when
from .drawing import Drawing

__all__ = ["EMBED_BYTES", "Clip", "Commands", "Folded", "Part", "Plot", "Slider", "Table", "Text", "data_url", "marked"]

# A video is put into the page up to this size in bytes: three of them stay below what a mail takes.
EMBED_BYTES = 4_000_000
# So many pictures of the slider stand on paper.
_PRINTED = 6


class Part(Protocol):
    """Something that stands on the page."""

    def html(self) -> str:
        """Give its HTML."""
        ...


def data_url(data: bytes, kind: str = "image/jpeg") -> str:
    """Write data as the address of itself."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def marked(kind: str, lines: Sequence[str]) -> str:
    """Write lines as a list in a box of a kind; nothing without any."""
    if not lines:
        return ""
    return f'<div class="{kind}"><ul>{"".join(f"<li>{escape(line)}</li>" for line in lines)}</ul></div>'


def _heading(title: str, caption: str) -> str:
    said = f'<p class="sub">{escape(caption)}</p>' if caption else ""
    return f"<h3>{escape(title)}</h3>{said}" if title else said


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str

    def html(self) -> str:
        """Give its HTML."""
        return f"<p>{escape(self.text)}</p>"


@dataclass(frozen=True)
class Plot:
    """A drawing with its heading and a sentence that says how to read it."""

    title: str
    drawing: Drawing
    caption: str = ""

    def html(self) -> str:
        """Give its HTML."""
        return f'<section class="plot">{_heading(self.title, self.caption)}{self.drawing.inline()}</section>'


@dataclass(frozen=True)
class Link:
    """A cell that leads to another page."""

    text: str
    target: str

    def html(self) -> str:
        """Give its HTML."""
        return f'<a href="{escape(self.target, quote=True)}">{escape(self.text)}</a>'


@dataclass(frozen=True)
class Badge:
    """A cell that says whether something is whole."""

    text: str
    complete: bool

    def html(self) -> str:
        """Give its HTML."""
        return f'<span class="badge {"complete" if self.complete else "partial"}">{escape(self.text)}</span>'


@dataclass(frozen=True)
class Table:
    """Rows under a header.

    Attributes
    ----------
    title, caption : str
    header : sequence of str
    rows : sequence of sequences of str, Link or Badge
    numbers : frozenset of int
        Columns that are set flush right.
    name : str, optional
        What it is called where it has no title.
    marks : sequence of (colour, drawing, name), optional
        For each row: what stands before it, and of which thing it is.
    stacks : bool
        Whether its cells stand below each other, each with its header, where the page is narrow: of words, which would
        be cut there. Without it the table is moved sideways.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str | Link | Badge]]
    caption: str = ""
    numbers: frozenset[int] = frozenset()
    marks: Sequence[tuple[str, str, str]] = ()
    stacks: bool = False
    name: str = ""

    def html(self) -> str:
        """Give its HTML."""
        header = "".join(f"<th{self._kind(index)}>{escape(text)}</th>" for index, text in enumerate(self.header))
        before = "<th>path</th>" if self.marks else ""
        body = "".join(map(self._row, range(len(self.rows))))
        name = escape(self.title or self.name or "table", quote=True)
        kind = ' class="stacks"' if self.stacks else ""
        return (
            f'{_heading(self.title, self.caption)}<div class="scroll" tabindex="0" role="region" aria-label="{name}">'
            f"<table{kind}><thead><tr>{before}{header}</tr></thead><tbody>{body}</tbody></table></div>"
        )

    def _kind(self, index: int) -> str:
        return ' class="n"' if index in self.numbers else ""

    def _label(self, index: int) -> str:
        return f' data-label="{escape(self.header[index], quote=True)}"' if self.stacks else ""

    def _row(self, number: int) -> str:
        cells = "".join(
            f"<td{self._kind(index)}{self._label(index)}>{escape(cell) if isinstance(cell, str) else cell.html()}</td>"
            for index, cell in enumerate(self.rows[number])
        )
        if not self.marks:
            return f"<tr>{cells}</tr>"
        colour, drawing, name = self.marks[number]
        mark = f'<td class="mark"><i style="background:{colour}"></i>{drawing}</td>'
        return f'<tr data-thing="{escape(name, quote=True)}">{mark}{cells}</tr>'


@dataclass(frozen=True)
class Clip:
    """A video with its poster, or a picture alone.

    `poster` is JPEG data. `video` is a file beside the page; it is put into the page where it is small, else linked.
    `playable` says whether browsers play its codec.
    """

    title: str
    caption: str
    poster: bytes | None = None
    video: Path | None = None
    playable: bool = True

    def html(self) -> str:
        """Give its HTML."""
        poster = data_url(self.poster) if self.poster else ""
        shown = f'<img src="{poster}" alt="{escape(self.title, quote=True)}">' if poster else ""
        said = ""
        size = self.video.stat().st_size if self.video is not None and self.video.is_file() else 0
        if self.video is not None and size:
            said = f" {Link(self.video.name, self.video.name).html()}"
            if not self.playable:
                said += " (open it in a player; browsers do not play its codec)"
            elif size > EMBED_BYTES:
                said += (
                    f" is beside this page: with {size / 1e6:.1f} MB it is too large to be inside, where "
                    f"{EMBED_BYTES / 1e6:.0f} MB have room; this is one picture of it."
                )
            else:
                image = f' poster="{poster}"' if poster else ""
                name = escape(self.title, quote=True)
                shown = (
                    f'<video controls loop muted playsinline preload="metadata" aria-label="{name}"{image} '
                    f'src="{data_url(self.video.read_bytes(), "video/mp4")}">{shown}</video>'
                )
        caption = f"<b>{escape(self.title)}.</b> {escape(self.caption)}{said}"
        return f'<figure class="clip">{shown}<figcaption>{caption}</figcaption></figure>'


@dataclass(frozen=True)
class Slider:
    """Pictures to slide through; without a script they stand beside each other."""

    slides: Sequence[Slide]
    caption: str

    def html(self) -> str:
        """Give its HTML."""
        figures = []
        # What is printed of them, evenly spread.
        printed = {round(share * (len(self.slides) - 1) / max(_PRINTED - 1, 1)) for share in range(_PRINTED)}
        for number, slide in enumerate(self.slides):
            things = f"{slide.things} thing{'' if slide.things == 1 else 's'}"
            text = escape(f"{when(slide)}: {things}")
            figures.append(
                f'<figure{" class=print" if number in printed else ""} data-t="{slide.t_s!r}" '
                f'data-frame="{slide.frame}" data-things="{slide.things}"><img loading="lazy" decoding="async" '
                f'src="{data_url(slide.jpeg)}" alt="{text}"><figcaption>{text}</figcaption></figure>'
            )
        return (
            f'<p class="sub">{escape(self.caption)}</p><div class="slider"><div class="strip" tabindex="0" '
            f'role="region" aria-label="pictures of the run">{"".join(figures)}</div></div>'
        )


@dataclass(frozen=True)
class Commands:
    """Text to be copied into a terminal or a program."""

    caption: str
    text: str

    def html(self) -> str:
        """Give its HTML."""
        return f'<p class="sub">{escape(self.caption)}</p><pre tabindex="0"><code>{escape(self.text)}</code></pre>'


@dataclass(frozen=True)
class Folded:
    """Parts that are looked up, not read: folded away at first."""

    title: str
    parts: Sequence[Part]

    def html(self) -> str:
        """Give its HTML."""
        inner = "".join(part.html() for part in self.parts)
        return f"<details><summary>{escape(self.title)}</summary>{inner}</details>"
