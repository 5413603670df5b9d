"""What the page of sliders looks like."""

from __future__ import annotations

import html
from collections.abc import Sequence

from bokeh.models import Div

LEFT = 330  # px, of the sliders
GOOD, BAD = "font-size: 14px; color: #1c5c2e", "font-size: 14px; color: #a11212; font-weight: bold"
SMALL = ":host { font-size: 12px }"
SCROLLS = {"max-height": "calc(100vh - 60px)", "overflow-y": "auto", "overflow-x": "hidden", "padding-right": "6px"}
BUTTONS = {"tune": "Tune from here", "save": "Save", "reset": "Reset"}


def heading(text: str) -> Div:
    """A heading above sliders."""
    return Div(text=f"<b style='font-size: 15px'>{text}</b>", margin=(8, 8, 2, 8))


def fixed(sentences: Sequence[str]) -> Div:
    """What cannot be moved here."""
    lines = "".join(f"<li>{html.escape(text)}</li>" for text in sentences)
    style = "font-size: 12px; color: #444; padding-left: 16px; margin: 2px 0"
    return Div(text=f"<b>Fixed here</b><ul style='{style}'>{lines}</ul>", width=LEFT - 50, margin=(10, 8, 8, 8))
