"""What commands and their options are made with."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..io.numbers import integer


class Option(NamedTuple):
    """An option as `argparse` takes it: its names and keywords."""

    names: tuple[str, ...]
    keywords: dict[str, Any]


def option(*names: str, **keywords: Any) -> Option:
    """An option with a value, or what is no option."""
    return Option(names, keywords)


def many(name: str, metavar: str, help: str, **keywords: Any) -> Option:
    """An option that may be given several times."""
    return option(name, action="append", metavar=metavar, help=help, **{"default": []} | keywords)


def flag(name: str, help: str) -> Option:
    """An option without a value."""
    return option(name, action="store_true", help=help)


QUIET = flag("--quiet", "print nothing but errors")
COMMON = (
    many(
        "--config", "FILE.toml", "settings; may be repeated; built in: unicycle, car, robot, base, ackermann, forklift"
    ),
    many("--set", "KEY=VALUE", "one setting, e.g. controller.k1=25; may be repeated"),
    many("--import", "FILE.py", "a file with classes of your own, which TOML then knows by name", dest="imports"),
    option("--out", metavar="DIR", help="where to write; a new folder (default: runs/COMMAND-TIME)"),
    option("--seed", type=integer, help="seed of every random number (default: 0)"),
    option("--precision", type=integer, choices=(32, 64), help="bits of a floating-point number (default: 64)"),
    QUIET,
)


class Command(NamedTuple):
    """One command.

    Attributes:
        help: a line of help.
        options: those that the other commands do not have.
        example: what may follow its name.
        common: options that it shares with others.
    """

    help: str
    options: tuple[Option, ...] = ()
    example: str = "--out mine"
    common: tuple[Option, ...] = COMMON
