"""What the page shows and what its buttons do; one `Page` for each browser tab."""

from __future__ import annotations

import dataclasses
import html
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import Button, ColumnDataSource, CustomJSTickFormatter, Div, RadioButtonGroup, Range1d
from bokeh.models import Slider as Handle

from agvjax import InputError

from ...config import check, load
from ...config.ends import LAW
from ...io import closer
from ...io.curves import columns
from ...tune.rules import faults
from . import drawing, table
from .background import Desk, Tuning
from .rollout import Judged, Rollouts
from .sliders import Slider, held

STEPS = 400  # of a slider, from end to end
PAUSE = 8  # ms, in which further moves are awaited before one redraws: a hand is faster than a rollout
SOON = 0.1  # s after a redraw, in which a move is taken for one of many
LOOK = 500  # ms between looks at a tuning
READ = "return (Math.abs(x) < 1e-12 ? 0 : x).toPrecision(4).replace(/\\.?0+$/, '')"
PLAIN, POWER = f"const x = tick; {READ}", f"const x = 10 ** tick; {READ}"


class Page:
    """The page: sliders, figures, the table, buttons.

    Attributes:
        values: where each slider stands, by `Slider.key`.
        handles: the sliders on the page, by `Slider.key`.
        source: the curves as they are drawn, by column.
        shown: what stands in the table.
    """

    def __init__(self, rollouts: Rollouts, desk: Desk, document: Document | None = None) -> None:
        """Make the page; without a document, for a script, each move redraws before it returns."""
        self.rollouts, self.desk, self.document = rollouts, desk, document
        self.config, self.moving = rollouts.config, rollouts.moving
        self.values = {s.key: s.value for s in self.moving.sliders}
        self.handles = {s.key: self._handle(s) for s in self.moving.sliders}
        self.tuning: Tuning | None = None
        self._setting, self._waiting, self._serial = False, False, 0
        self._judging, self._asked, self._drawn = False, self.config, 0.0
        self.first = self.shown = rollouts.judged(self.config)
        drawn = columns(rollouts.curves(self.config))
        self.source, self._before = (ColumnDataSource(data=drawn) for _ in range(2))
        self.table, self.banner = Div(), Div(text="", styles={"min-height": "22px"}, sizing_mode="stretch_width")
        self.buttons = {name: Button(label=label) for name, label in drawing.BUTTONS.items()}
        for name, action in {"tune": self.tune, "save": self.save, "reset": self.reset}.items():
            self.buttons[name].on_click(action)
        self._write()
        if document is not None:
            self._fill(document)

    def _fill(self, document: Document) -> None:
        document.title = "agvjax explore"
        end, late = self.config.simulate.horizon, min(self.config.criteria.late, self.config.simulate.horizon / 2)
        time = Range1d(start=0, end=end)
        part = RadioButtonGroup(labels=["whole run", f"after {late:g} s"], active=0, margin=(0, 0, 4, 40))
        part.on_change("active", lambda attr, old, new: time.update(start=late if new else 0, end=end))
        paths, errors, actuators = closer.figures(self.config.scenario, time, self.source, self._before)
        left = [drawing.heading("Gains"), *(self.handles[s.key] for s in self.moving.sliders if s.of_law)]
        others = [self.handles[s.key] for s in self.moving.sliders if not s.of_law]
        left += [drawing.heading("Vehicle"), *others] if others else []
        left.append(drawing.fixed(self.moving.fixed))
        sides: Any = {"sizing_mode": "stretch_width"}
        middle = column(paths, self.table, **sides)
        curves = column(part, *errors, *actuators, **sides)
        sliders = column(row(*self.buttons.values()), *left, width=drawing.LEFT, styles=drawing.SCROLLS)
        document.add_root(column(self.banner, row(sliders, middle, curves, **sides), **sides))
        document.add_periodic_callback(self.look, LOOK)
        document.on_session_destroyed(lambda context: self.close())

    def _handle(self, slider: Slider) -> Handle:
        ends = [_place(slider, x) for x in (slider.low, slider.high, slider.value)]
        unit = f" [{slider.unit}]" if slider.unit not in ("", "1") else ""
        handle = Handle(
            name=slider.key,
            title=f"{slider.label}{unit}",
            start=ends[0],
            end=ends[1],
            value=ends[2],
            step=(ends[1] - ends[0]) / STEPS,
            format=CustomJSTickFormatter(code=POWER if slider.log else PLAIN),
            bar_color=closer.NOW,
            width=drawing.LEFT - 60,
            margin=(1, 12, 1, 8),
            stylesheets=[drawing.SMALL],
        )
        handle.on_change("value", partial(self._moved, slider))
        return handle

    def _moved(self, slider: Slider, attr: str, old: float, new: float) -> None:
        if self._setting:
            return
        self.values[slider.key] = 10.0**new if slider.log else float(new)
        if self.document is None:
            self.redraw()
        elif not self._waiting:
            self._waiting = True
            moving = time.monotonic() - self._drawn < SOON
            self.document.add_timeout_callback(self.redraw, PAUSE if moving else 0)

    def redraw(self) -> None:
        """Roll out where the sliders stand and show it: the curves, and while a browser draws them, the table."""
        self._waiting = False
        config = self._asked = self.moving.placed(self.config, self.values)
        if self.document is None:
            self._judged(self.rollouts.judged(config))
        elif not self._judging:
            self._judge(self.document)
        self.source.data.update(columns(self.rollouts.curves(config)))
        self._drawn = time.monotonic()

    def _judge(self, document: Document) -> None:
        """Judge what the sliders ask for, in another thread; once more if they have moved meanwhile."""
        self._judging, config = True, self._asked

        def done(future: Future[Judged]) -> None:
            self._judging = False
            if config is not self._asked:
                self._judge(document)
            self._judged(future.result())

        future = self.rollouts.judging(config)
        future.add_done_callback(lambda f: document.add_next_tick_callback(partial(done, f)))

    def _judged(self, judged: Judged) -> None:
        self.shown = judged
        self._serial += 1
        self._write()

    def _write(self) -> None:
        self.table.text = table.table(self.config, self.shown, self.first, self._serial)

    def set(self, values: dict[str, float]) -> None:
        """Move sliders, by `Slider.key`, and redraw; one that must goes beyond its end, which moves."""
        self._setting = True
        for slider in self.moving.sliders:
            if slider.key not in values:
                continue
            value, handle = values[slider.key], self.handles[slider.key]
            place = _place(slider, value)
            handle.update(start=min(handle.start, place), end=max(handle.end, place))
            handle.value = place
            self.values[slider.key] = value
        self._setting = False
        self.redraw()

    def reset(self) -> None:
        """Back to the configuration."""
        self.set({s.key: s.value for s in self.moving.sliders})
        self.say("")

    def say(self, text: str, bad: bool = False) -> None:
        """A sentence at the top of the page."""
        self.banner.text = f'<span style="{drawing.BAD if bad else drawing.GOOD}">{html.escape(text)}</span>'

    def _trying(self, action: Callable[[], None]) -> None:
        """Do what may be refused, or find no room on the disk, and say so on the page."""
        try:
            action()
        except (InputError, OSError) as error:
            self.say(str(error), bad=True)

    def _settled(self) -> Any:
        """The configuration of the sliders, checked as `agvjax tune` checks it."""
        return check(self.moving.placed(self.config, self.values), faults)

    def save(self) -> None:
        """Write gains and configuration."""

        def write() -> None:
            file = self.desk.save(self._settled())
            self.say(f"saved: agvjax simulate --config {file}")

        self._trying(write)

    def tune(self) -> None:
        """Tune from the gains shown; where that runs already, stop it."""
        if self.tuning is not None:
            self.tuning.stop()
            return

        def begin() -> None:
            self.tuning = Tuning(self.desk, self._settled())
            self.buttons["tune"].label = "Stop tuning"
            self.look()

        self._trying(begin)

    def look(self) -> None:
        """Show how the tuning stands; once it has ended well, move the sliders to what it found."""
        if self.tuning is None:
            return
        tuning, code, said = self.tuning, self.tuning.code(), self.tuning.said()
        if code is None:
            self.say(f"tuning for {tuning.seconds:.0f} s; {said}")
            return
        self.tuning = None
        self.buttons["tune"].label = drawing.BUTTONS["tune"]
        if code not in (0, 1) or not tuning.gains.exists():
            why = "was stopped" if code in (130, -2) else "failed"
            self.say(f"the tuning {why}, the sliders stay: {said}", bad=why == "failed")
            return

        def take() -> None:
            law = load([str(tuning.gains)], imports=list(self.config.imports), note=lambda text: None).controller
            found = dataclasses.replace(self.config, controller=law)
            self.set({s.key: held(found, s.key) for s in self.moving.sliders if s.key.startswith(LAW)})
            verdict = f"; {said}" if code else ""
            self.say(f"tuned in {tuning.seconds:.0f} s: {tuning.folder / 'report.html'}{verdict}", bad=bool(code))

        self._trying(take)

    def close(self) -> None:
        """The tab was closed: nobody waits for its tuning."""
        if self.tuning is not None:
            self.tuning.stop()


def _place(slider: Slider, value: float) -> float:
    """Where a value stands on a slider."""
    return float(np.log10(value)) if slider.log else float(value)
