"""Markdown tables, and a report as Markdown and as one self-contained page: the same template for every command."""

from __future__ import annotations

import base64
import importlib.util
import re
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from markdown_it import MarkdownIt

import agvjax

from .files import write

if TYPE_CHECKING:
    from .curves import Track

CONTENTS = 5  # sections from which on a page begins with a list of them

# Colours of text on ground have a contrast of 7 and more, in light and in dark. Figures are drawn on white.
STYLE = (
    ":root{color-scheme:light dark;--text:#1a1a1a;--ground:#fff;--soft:#4d4d4d;--line:#d0d0d0;--shade:#f3f3f3;"
    "--link:#0b4f9e}"
    "@media(prefers-color-scheme:dark){:root{--text:#e8e8e8;--ground:#161616;--soft:#b8b8b8;--line:#444;"
    "--shade:#262626;--link:#9cc4ff}}"
    "body{font:16px/1.55 system-ui,sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:var(--text);"
    "background:var(--ground)}"
    "h1,h2,h3{line-height:1.25;margin:1.6em 0 .5em}h1{margin-top:0}a{color:var(--link)}"
    ".made{color:var(--soft);font-size:14px;margin-top:-.4em;overflow-wrap:anywhere}"
    "nav{font-size:14px}nav ul{columns:2;padding-left:1.2em}"
    "table{border-collapse:collapse;font-size:14px;line-height:1.4;margin:1em 0;display:block;overflow-x:auto;"
    "font-variant-numeric:tabular-nums}"
    "th,td{border-bottom:1px solid var(--line);padding:.25em .7em;text-align:left;vertical-align:top}"
    "th{border-bottom:2px solid var(--soft)}"
    "figure{margin:1.2em 0}img{max-width:100%;height:auto;display:block;background:#fff;border-radius:4px}"
    "figcaption{color:var(--soft);font-size:14px;margin-top:.4em}"
    "code{background:var(--shade);padding:0 .25em;border-radius:3px}"
    "details{border-top:1px solid var(--line);padding:.5em 0}summary{cursor:pointer}"
    "summary h2{display:inline;font-size:1.15em}"
    "@media print{body{max-width:none}details{break-inside:avoid}}"
)


def grid(header: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    """A Markdown table; numbers with four digits."""
    text = [[f"{x:.4g}" if isinstance(x, float) else str(x) for x in line] for line in (header, *lines)]
    rows = ["| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in text]
    return "\n".join([rows[0], "|" + "---|" * len(header), *rows[1:]])


def meanings(texts: Mapping[str, str]) -> str:
    """A list of names, each with what it means."""
    return "\n".join(f"* `{name}`: {text}" for name, text in texts.items() if text)


def picture(file: str, caption: str) -> str:
    """A figure of the run folder, and below it a `caption` that can be understood alone."""
    caption = caption.replace('"', "'")
    return f'![{caption.rstrip(".")}]({file} "{caption}")'


def look_closer(folder: Path, scenes: Mapping[str, tuple[agvjax.Scenario, Sequence[agvjax.Trajectory]]]) -> str:
    """Write `runs.html`, interactive figures of runs, and return a link to it; nothing where Bokeh is not installed.

    Args:
        folder: of the report.
        scenes: by title, a scenario and its runs with the starting and with the tuned gains.
    """
    if importlib.util.find_spec("bokeh") is None:
        return ""
    from .closer import write_page  # late: takes half a second to import

    write_page(folder / "runs.html", scenes)
    return "[Look closer](runs.html): path, errors and commands of the runs in this report, to zoom into."


def look_at_logs(folder: Path, logs: Sequence[tuple[str, Track, Track]]) -> str:
    """The same of recordings, `logs.html`: the name of each, what was measured and what the model makes of it."""
    if importlib.util.find_spec("bokeh") is None:
        return ""
    from .closer import write_logs  # late, as above

    write_logs(folder / "logs.html", logs)
    return "[Look closer](logs.html): each recording and what the model makes of it, to zoom into."


def made() -> str:
    """What made a report: the command, where there was one, version and date."""
    day = time.strftime("%Y-%m-%d")
    if Path(sys.argv[0]).name not in ("agvjax", "agvjax.exe", "agvjax-script.py"):
        return f"Made by agvjax {agvjax.__version__} on {day}."
    command = shlex.join(["agvjax", *sys.argv[1:]]).replace("`", "'")
    return f"Made by `{command}`, agvjax {agvjax.__version__}, on {day}."


def publish(folder: Path, text: str, folded: Sequence[str] = ()) -> None:
    """Write a report as `report.md` and `report.html`; the second needs no other file.

    Args:
        folder: where to; the figures lie there.
        text: Markdown that begins with the title, a line of its own; then what was asked, the verdict, the picture,
            the tables, the fine print.
        folded: sections, by their headings, that the page shows when they are opened.
    """
    title, _, rest = text.partition("\n")
    text = f"{title}\n\n{made()}\n{rest}"
    write(folder / "report.md", text)
    write(folder / "report.html", html(text, folder, title.lstrip("# "), folded))


def html(text: str, folder: Path, title: str, folded: Sequence[str] = ()) -> str:
    """A page of HTML that needs no other file: the Markdown `text` with its figures, which lie in `folder`, inside."""
    # names in the data (files, columns, folders) must not become tags
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    body = re.sub(r"<p>(Made by [^\n]*)</p>", r'<p class="made">\1</p>', body, count=1)
    body = re.sub(r"<p>(<img [^>]*>)</p>", _figure, body)

    def inside(match: re.Match[str]) -> str:
        picture = base64.b64encode((folder / match.group(1)).read_bytes()).decode()
        return f'src="data:image/{match.group(2)};base64,{picture}"'

    body = _sections(re.sub(r'src="([\w.-]+\.(png|gif))"', inside, body), folded)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{escape(title)}</title><style>{STYLE}</style></head>
<body><main>
{body}</main></body></html>
"""


def _figure(match: re.Match[str]) -> str:
    """A picture, and its title as the caption below."""
    said = re.search(r' title="([^"]*)"', match[1])
    if not said:
        return f"<figure>{match[1]}</figure>"
    return f"<figure>{match[1].replace(said[0], '')}<figcaption>{said[1]}</figcaption></figure>"


def _sections(body: str, folded: Sequence[str]) -> str:
    """The page with a list of its sections, where there are many, and some of them folded."""
    head, *sections = re.split(r"(?=<h2>)", body)
    names = [re.sub(r"<[^>]+>", "", section[: section.index("</h2>")]) for section in sections]
    made = []
    for i, (name, section) in enumerate(zip(names, sections, strict=True)):
        heading, rest = section.replace("<h2>", f'<h2 id="section-{i + 1}">', 1).split("</h2>", 1)
        hidden = name in map(escape, folded)
        made.append(
            f"<details><summary>{heading}</h2></summary>{rest}</details>" if hidden else heading + "</h2>" + rest
        )
    if len(sections) >= CONTENTS:
        entries = "".join(f'<li><a href="#section-{i + 1}">{name}</a></li>' for i, name in enumerate(names))
        made.insert(0, f'<nav aria-label="Sections"><ul>{entries}</ul></nav>\n')
    return head + "".join(made)
