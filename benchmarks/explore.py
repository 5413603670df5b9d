"""From a key on a slider of `agvjax explore` to the last stroke of the curves and the new table, the later of both."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import statistics
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

from . import browser

MOVES = 20  # of which the median counts
PROBLEMS = {"the paper's": (), "base": ("--config", "base"), "robot": ("--config", "robot"), "car": ("--config", "car")}
READY = "window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle"
WATCH = """(() => {
  window.drawn = 0
  const context = CanvasRenderingContext2D.prototype, stroke = context.stroke
  context.stroke = function (...x) { window.drawn = performance.now(); stroke.apply(this, x) }
  document.addEventListener("keydown", e => { window.pressed = e.timeStamp }, true)
})()"""
FOCUS = """(() => {
  const all = root => [...root.querySelectorAll("*")].flatMap(e => [e, ...(e.shadowRoot ? all(e.shadowRoot) : [])])
  const every = all(document)
  window.table = every.find(e => e.dataset && e.dataset.serial).getRootNode()  // asked often: found once
  const changed = new MutationObserver(() => { window.drawn = performance.now() })
  changed.observe(window.table, { childList: true, subtree: true, characterData: true })
  every.find(e => e.classList.contains("noUi-handle")).focus()
})()"""
SERIAL = "+window.table.querySelector('[data-serial]').dataset.serial"


@contextlib.contextmanager
def served(*options: str) -> Iterator[str]:
    """`agvjax explore` with these options; its address."""
    command = [sys.executable, "-m", "tuning.cli", "explore", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "JAX_PLATFORMS": "cpu"})
    assert process.stdout is not None
    try:
        yield next(match[0] for line in process.stdout if (match := re.search(r"http://\S+/", line)))
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate()


async def moves(tab: browser.Tab, count: int = MOVES) -> list[float]:
    """Seconds from each key press on the first slider until all curves are drawn and the table is new."""
    await tab.until(READY)
    await tab.value(f"{WATCH}; {FOCUS}")
    found = []
    for i in range(count + 1):
        before = await tab.value(SERIAL)
        await tab.key("ArrowRight" if i % 2 else "ArrowLeft")
        await tab.until(f"{SERIAL} > {before} && performance.now() - window.drawn > 150")
        found.append(1e-3 * await tab.value("window.drawn - window.pressed"))
    return found[1:]  # the first is that of a page that was just opened


def measure(turns: int) -> list[dict[str, Any]]:
    """Each problem's page, opened once; `turns` is not asked for."""
    rows = []
    for name, options in PROBLEMS.items():
        with served(*options) as address:
            seconds = browser.visit(address, moves)
        row = {"problem": name, "moves": len(seconds), "median ms": 1e3 * statistics.median(seconds)}
        rows.append(row | {"fastest ms": 1e3 * min(seconds), "slowest ms": 1e3 * max(seconds)})
    return rows
