"""Markdown tables, and a report as one self-contained page."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from html import escape
from pathlib import Path

from markdown_it import MarkdownIt

STYLE = (
    "body{font:15px/1.5 Georgia,serif;max-width:62em;margin:2em auto;padding:0 1em;color:#111}"
    "h1,h2,h3{line-height:1.2;margin-top:1.6em}"
    "table{border-collapse:collapse;font:13px/1.35 sans-serif;margin:1em 0;display:block;overflow-x:auto}"
    "th,td{border-bottom:1px solid #ccc;padding:.25em .6em;text-align:left;vertical-align:top}"
    "th{border-bottom:2px solid #555}"
    "img{max-width:100%;height:auto;display:block;margin:.5em auto}code{background:#f2f2f2;padding:0 .2em}"
)


def grid(header: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    """A Markdown table; numbers with four digits."""
    text = [[f"{x:.4g}" if isinstance(x, float) else str(x) for x in line] for line in (header, *lines)]
    rows = ["| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in text]
    return "\n".join([rows[0], "|" + "---|" * len(header), *rows[1:]])


def html(text: str, folder: Path, title: str) -> str:
    """A page of HTML that needs no other file: the Markdown `text` with its figures, which lie in `folder`, inside."""
    # names in the data (files, columns, folders) must not become tags
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)

    def inside(match: re.Match[str]) -> str:
        picture = base64.b64encode((folder / match.group(1)).read_bytes()).decode()
        return f'src="data:image/{match.group(2)};base64,{picture}"'

    body = re.sub(r'src="([\w.]+\.(png|gif))"', inside, body)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style></head>
<body>
{body}</body></html>
"""
