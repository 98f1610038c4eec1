"""The report page: one HTML file that opens from disk without a network and says what was measured and what not."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

__all__ = ["Figure", "Plot", "Report", "Table", "page"]

# A video is put into the page up to this size in bytes: three of them stay below what a mail takes.
EMBED_BYTES = 4_000_000

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fff; margin: 0 auto; max-width: 1000px;
       padding: 24px 20px 60px; }
h1 { font-size: 26px; margin: 0 0 2px; overflow-wrap: anywhere; } h2 { font-size: 19px; margin: 36px 0 8px;
     border-bottom: 1px solid #ddd; padding-bottom: 4px; } h3 { font-size: 15px; margin: 18px 0 2px; }
p { margin: 6px 0; } .sub { color: #666; }
.badge { display: inline-block; border-radius: 4px; padding: 1px 9px; font-size: 13px; font-weight: 600; }
.complete { background: #dff0e4; color: #145c2e; } .partial { background: #fbe1d6; color: #8a2b06; }
.notes { background: #fff6e0; border-left: 4px solid #e0a500; padding: 8px 14px; margin: 14px 0; }
.notes.bad { background: #fdeae2; border-color: #d55e00; } .notes ul { margin: 0; padding-left: 18px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); gap: 10px; margin: 14px 0; }
.tile { border: 1px solid #ddd; border-radius: 6px; padding: 8px 12px; } .tile b { display: block; font-size: 20px; }
.tile span { color: #555; font-size: 13px; }
.views { display: grid; grid-template-columns: repeat(auto-fill, minmax(300px, 1fr)); gap: 14px; }
figure { margin: 0; } figcaption { font-size: 13px; color: #444; margin-top: 4px; }
figure img, figure video { width: 100%; display: block; border: 1px solid #ccc; background: #eee; }
svg { width: 100%; height: auto; display: block; }
table { border-collapse: collapse; font-size: 14px; margin: 8px 0; } th, td { text-align: left; padding: 3px 14px 3px 0;
        border-bottom: 1px solid #eee; vertical-align: top; } th { color: #555; font-weight: 600; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; } .scroll { overflow-x: auto; }
code { font: 13px ui-monospace, monospace; background: #f4f4f4; padding: 1px 4px; border-radius: 3px; }
"""


@dataclass(frozen=True)
class Figure:
    """A video with its poster, or a picture alone.

    `poster` is PNG or JPEG data. `video` is a file beside the page; it is put into the page where it is small, else
    linked. `playable` says whether browsers play its codec.
    """

    title: str
    caption: str
    poster: bytes | None = None
    video: Path | None = None
    playable: bool = True


@dataclass(frozen=True)
class Plot:
    """A drawing with its heading and one sentence that says how to read it."""

    title: str
    svg: str
    caption: str = ""


@dataclass(frozen=True)
class Table:
    """Rows under a header; columns named in `numbers` are set flush right."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    numbers: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Report:
    """Everything the page shows, from top to bottom."""

    title: str
    subtitle: str
    complete: bool
    summary: Sequence[str]
    tiles: Sequence[tuple[str, str]] = ()
    problems: Sequence[str] = ()
    notes: Sequence[str] = ()
    figures: Sequence[Figure] = ()
    plots: Sequence[Plot] = ()
    tables: Sequence[Table] = ()
    settings: Mapping[str, str] = field(default_factory=dict)


def _data_url(data: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _picture_kind(data: bytes) -> str:
    return "image/png" if data.startswith(b"\x89PNG") else "image/jpeg"


def _figure(figure: Figure) -> str:
    poster = _data_url(figure.poster, _picture_kind(figure.poster)) if figure.poster else ""
    still = f'<img src="{poster}" alt="{escape(figure.title, quote=True)}">' if poster else ""
    link = ""
    shown = still
    if figure.video is not None and figure.video.is_file():
        name = escape(figure.video.name, quote=True)
        link = f' <a href="{name}">{name}</a>'
        if figure.playable:
            small = figure.video.stat().st_size <= EMBED_BYTES
            source = _data_url(figure.video.read_bytes(), "video/mp4") if small else name
            image = f' poster="{poster}"' if poster else ""
            shown = f'<video controls loop muted playsinline preload="metadata"{image} src="{source}">{still}</video>'
        else:
            shown = f'<a href="{name}">{still}</a>'
            link += " (open it in a player; browsers do not play its codec)"
    caption = f"<b>{escape(figure.title)}.</b> {escape(figure.caption)}{link}"
    return f"<figure>{shown}<figcaption>{caption}</figcaption></figure>"


def _table(table: Table) -> str:
    def cells(row: Sequence[str], tag: str) -> str:
        return "".join(
            f"<{tag}{' class=n' if index in table.numbers else ''}>{escape(text)}</{tag}>"
            for index, text in enumerate(row)
        )

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in table.rows)
    caption = f'<p class="sub">{escape(table.caption)}</p>' if table.caption else ""
    return (
        f"<h2>{escape(table.title)}</h2>{caption}<div class=scroll><table><thead><tr>{cells(table.header, 'th')}</tr>"
        f"</thead><tbody>{body}</tbody></table></div>"
    )


def _list(lines: Sequence[str], kind: str) -> str:
    if not lines:
        return ""
    return f'<div class="{kind}"><ul>{"".join(f"<li>{escape(line)}</li>" for line in lines)}</ul></div>'


def page(report: Report) -> str:
    """Give the HTML text of `report`: one file, styles, pictures and drawings inside."""
    state = '<span class="badge complete">complete</span>'
    if not report.complete:
        state = '<span class="badge partial">partial: the run ended early</span>'
    tiles = "".join(
        f"<div class=tile><b>{escape(value)}</b><span>{escape(name)}</span></div>" for name, value in report.tiles
    )
    plots = "".join(
        f"<h3>{escape(plot.title)}</h3>"
        + (f'<p class="sub">{escape(plot.caption)}</p>' if plot.caption else "")
        + plot.svg
        for plot in report.plots
    )
    settings = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in report.settings.items()
    )
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(report.title)}: motion</title><style>{_STYLE}</style></head><body>",
        f'<h1>{escape(report.title)}</h1><p class="sub">{escape(report.subtitle)} {state}</p>',
        _list(report.problems, "notes bad"),
        "".join(f"<p>{escape(line)}</p>" for line in report.summary),
        f"<div class=tiles>{tiles}</div>" if tiles else "",
        _list(report.notes, "notes"),
        f"<h2>Views</h2><div class=views>{''.join(map(_figure, report.figures))}</div>" if report.figures else "",
        f"<h2>Over time</h2>{plots}" if plots else "",
        "".join(map(_table, report.tables)),
        f"<h2>Settings</h2><div class=scroll><table><tbody>{settings}</tbody></table></div>" if settings else "",
        "</body></html>\n",
    ]
    return "\n".join(part for part in parts if part)
