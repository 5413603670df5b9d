"""`agvjax explain`: what a setting, a metric, a command or an exit code means."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable

from agvjax import Fault, InputError
from agvjax.metric_table import METRICS

from ..config.described import Described, described, every_key
from .console import Console
from .main import COMMANDS, EXIT_CODES

FEW = 60  # keys that are listed each; of a larger table those of its next level are


def run(arguments: argparse.Namespace) -> int:
    """Print what is known of each key; nothing of any where one is unknown."""
    pages, wrong = [], []
    for key in arguments.keys:
        try:
            pages += [page for of in ABOUT for page in of(key)] or _below_or_key(key)
        except InputError as error:
            wrong += [Fault("explain", repr(key), fault.rule) for fault in error.faults]
    if wrong:
        raise InputError(wrong)
    Console(arguments.quiet).say("\n\n".join(pages))
    return 0


def _of_metric(key: str) -> list[str]:
    row = METRICS.get(key)
    if row is None:
        return []
    where = {"heading": "the heading can be commanded", "route": "the path is a route"}
    only = [words for name, words in where.items() if getattr(row, name)]
    lines = [f"a metric [{row.unit}]", row.text]
    lines += [f"only if {only[0]}"] if only else []
    use = "tune.limits" if row.loop else "tune.goals, tune.limits, sweep.metrics"
    return [_page(key, [*lines, f"for {use}; docs/tuning.md"])]


def _of_command(key: str) -> list[str]:
    command = COMMANDS.get(key)
    if command is None:
        return []
    page = _page(f"agvjax {key}", [command.help, f"e.g. agvjax {key} {command.example}", f"agvjax {key} --help"])
    return [page, *(_below_or_key(key) if key in every_key() else [])]


def _of_exit_code(key: str) -> list[str]:
    words = {str(code): words for code, words in EXIT_CODES.items()}
    return [_page(f"exit code {key}", [words[key]])] if key in words else []


ABOUT: tuple[Callable[[str], list[str]], ...] = (_of_metric, _of_command, _of_exit_code)


def _below_or_key(key: str) -> list[str]:
    """A key, and of a table what stands in it; of a name that many keys end with, those."""
    bare = key.strip().strip(".").replace('"', "")
    ends = [name for name in every_key() if name.endswith(f".{bare}")]
    if bare not in every_key() and 0 < len(ends) <= FEW:  # as gains are named in a report
        alike: dict[str, list[str]] = {}
        for name in ends:
            alike.setdefault("\n".join(_lines(described(name))), []).append(name)
        return [_page(", ".join(names), text.split("\n")) for text, names in alike.items()]
    row = described(bare)
    below = [name for name in every_key() if name.startswith(f"{row.key}.")]
    if len(below) > FEW:
        below = [name for name in below if "." not in name.removeprefix(f"{row.key}.")]
    lines = []
    for name in below:
        other = described(name)
        more = ", ".join(filter(None, [other.unit, f"default {other.default}" if other.default else ""]))
        lines += [f"{name}{f'  [{more}]' if more and len(more) < 60 else ''}", f"    {_short(other.text)}"]
    pages = [_page(bare, _lines(row))]
    if row.key == "ensemble.draws.<leaf>" and (leaf := _leaf(bare)):
        pages.append(leaf)
    return [*pages, "\n".join(lines)] if lines else pages


def _leaf(key: str) -> str:
    """What the leaf is that a draw is of; empty where nothing is known."""
    leaf = key.removeprefix("ensemble.draws.")
    try:
        row = described(f"scenario.{leaf}")
    except InputError:
        return ""
    return _page(f"scenario.{leaf}", _lines(row))


def _lines(row: Described) -> list[str]:
    default = f"default: {row.default}" if row.default else ""
    kind = f"{row.kind} [{row.unit}]" if row.unit else row.kind
    rule = f"must be {row.rule}" if row.rule else ""
    return [line for line in (row.text, kind, default, rule, row.page) if line]


def _short(text: str) -> str:
    return textwrap.shorten(text, 110, placeholder=" ...")


def _page(title: str, lines: list[str]) -> str:
    wrapped = [part for line in lines for part in textwrap.wrap(line, 116, break_on_hyphens=False)]
    return "\n".join([title, *(f"  {line}" for line in wrapped)])
