"""What `agvjax new` is told: by options, by a person at a terminal, or by defaults, which are said."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from agvjax import Fault, InputError

from .console import Console
from .questions import BY_CLOCK, LEFT, QUESTIONS, Question, spelled


def answer(words: str) -> str:
    """A line from the terminal.

    Raises:
        KeyboardInterrupt: there is none (Ctrl-D).
    """
    try:
        return input(words).strip()
    except EOFError:
        print()
        raise KeyboardInterrupt from None


def unfit(arguments: argparse.Namespace, kind: str) -> None:
    """Refuse options that the kind of vehicle does not have, and numbers that break their rule."""
    wrong = []
    for name, question in QUESTIONS.items():
        if (value := getattr(arguments, name)) is None:
            continue
        if kind not in question.default:
            wrong.append(Fault(spelled(name), value, f"left out for {kind}"))
        elif not question.fits(value):
            wrong.append(Fault(spelled(name), value, question.rule))
    if arguments.within is not None and not 0 < arguments.within < 1e3:
        wrong.append(Fault("--within", arguments.within, "a number > 0 and below 1000 m"))
    given = {
        "--law": arguments.law,
        "--path": arguments.path,
        "--closed": arguments.closed,
        "--within": arguments.within,
    }
    if kind in BY_CLOCK:
        more = f"left out for {kind}, whose law goes by the clock: its path is set in the file, see docs/vehicles.md"
        wrong += [Fault(name, value, more) for name, value in given.items() if value]
    if wrong:
        raise InputError(wrong)


def numbers_of(arguments: argparse.Namespace, kind: str, asks: bool, console: Console) -> dict[str, float]:
    """The numbers of a vehicle: given, asked for, or their defaults, which are said."""
    numbers, usual = {}, []
    for name, question in QUESTIONS.items():
        if kind not in question.default:
            continue
        value, default = getattr(arguments, name), question.default[kind]
        if value is None and asks and name not in LEFT:
            value = _asked(question, default)
        elif value is None:
            usual.append(f"{spelled(name)} {default:g}{' ' if question.unit else ''}{question.unit}")
        numbers[name] = default if value is None else value
    if usual:
        console.note(f"not given, so {', '.join(usual)}")
    return numbers


def _asked(question: Question, default: float) -> float:
    """A number from the terminal."""
    unit = f" [{question.unit}]" if question.unit else ""
    words = f"{question.words[0].upper()}{question.words[1:]}{unit} (Enter: {default:g}): "

    def number(text: str) -> float | None:
        try:
            value = float(text) if text else default
        except ValueError:
            return None
        return value if question.fits(value) else None

    return _until(words, number, question.rule)


def _until(words: str, read: Callable[[str], float | None], rule: str) -> float:
    while (value := read(answer(words))) is None:
        print(f"must be {rule}")
    return value


def chosen(asks: bool, name: str, words: str, of: dict[str, str]) -> str:
    """One of some words from the terminal."""
    if not asks:
        raise InputError([Fault(name, "none", f"given: one of {', '.join(of)}")])
    print(words, *(f"  {word}: {meaning}" for word, meaning in of.items()), sep="\n")
    while (word := answer("> ")) not in of:
        print(f"one of {', '.join(of)}")
    return word
