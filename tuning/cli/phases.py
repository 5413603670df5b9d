"""What a command is doing and how far it is: a bar for whoever watches, one line a phase for a file."""

from __future__ import annotations

import sys
import time

from tqdm import tqdm

COUNTED = "{desc}: {n_fmt}/{total_fmt} {unit} |{bar:20}| {elapsed}{postfix}"
ESTIMATED = "{desc}: {n_fmt}/{total_fmt} {unit} |{bar:20}| {elapsed}, {remaining} left{postfix}"
OPEN = "{desc}: {n_fmt} {unit}, {elapsed}{postfix}"
UNCOUNTED = "{desc}: {elapsed}{postfix}"
SURE = 3  # units after which a time left is more than a guess: the first compile


class Phase:
    """One phase. On a terminal a bar that goes when the phase ends; then, and elsewhere only, a line.

    Attributes:
        name: of the phase.
        done: units that are done.
    """

    def __init__(self, name: str, total: int | None, unit: str, initial: int, scale: bool, quiet: bool) -> None:
        self.name, self.done, self._begun, self._first = name, initial, time.monotonic(), initial
        self._unit, self._quiet, self._total = unit, quiet, total
        form = (UNCOUNTED if not unit else OPEN) if total is None else COUNTED
        shown = not quiet and sys.stderr.isatty()
        self._bar = tqdm(
            total=total, initial=initial, desc=name, unit=unit, unit_scale=scale, bar_format=form,
            disable=not shown, leave=False, mininterval=0.2, file=sys.stderr, dynamic_ncols=True
        )  # fmt: skip
        if not shown and not quiet:
            print(f"{name} ...", end="", file=sys.stderr, flush=True)

    def advance(self, units: int = 1, before: bool = False) -> None:
        """So many units more are done; those of an earlier start, `before` this one, say nothing of the rate."""
        self.done += units
        if before:
            self._bar.initial = self._first = self.done
        if self._total is not None and self.done - self._first >= SURE:
            self._bar.bar_format = ESTIMATED
        self._bar.update(units)

    def note(self, text: str) -> None:
        """Show beside the bar what is being done now, or how well."""
        self._bar.set_postfix_str(text, refresh=False)
        self._bar.refresh()

    def end(self, how: str = "") -> None:
        """Print the phase's line."""
        shown = not self._bar.disable
        self._bar.close()
        if self._quiet:
            return
        count = f" {_number(self.done)} {self._unit}," if self._unit else ""
        line = f"{count} {time.monotonic() - self._begun:.0f} s{', ' if how else ''}{how}"
        print(f"{self.name}:{line}" if shown else line, file=sys.stderr, flush=True)


class Phases:
    """The phases of a command, one after another."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._now: Phase | None = None

    def begin(
        self, name: str, total: int | None = None, unit: str = "", initial: int = 0, scale: bool = False
    ) -> Phase:
        """End the present phase and begin another; the present one where it has this name already.

        Args:
            name: of the phase.
            total: units in all; None where nobody knows, and then no time left is promised.
            unit: what is counted, in the plural; empty: nothing.
            initial: units that were done before.
            scale: whether numbers are shown as 1.2k or 3.4M.
        """
        if self._now is None or self._now.name != name:
            self.end()
            self._now = Phase(name, total, unit, initial, scale, self._quiet)
        return self._now

    def end(self, how: str = "") -> None:
        """End the present phase, if there is one."""
        if self._now is not None:
            self._now.end(how)
        self._now = None


def _number(count: int) -> str:
    return f"{count:,}".replace(",", " ")
