"""What every call of the command line must keep, whatever it was given."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tuning import config


class Answer(NamedTuple):
    """What a call came to; `code` None: none within the time, or its process was lost."""

    code: int | None
    said: str
    before: list[str]  # files of the folder before
    folder: Path


def ends(answer: Answer) -> str:
    """An end within the time, with one of the codes that there are."""
    return "" if answer.code in (0, 1, 2, 130) else f"exit code {answer.code}"


def no_traceback(answer: Answer) -> str:
    """Messages, no tracebacks."""
    return "a traceback" if "Traceback (most recent call last)" in answer.said else ""


def nothing_left(answer: Answer) -> str:
    """Bad input leaves nothing behind."""
    left = sorted(set(_files(answer.folder)) - set(answer.before))
    return f"exit code 2 left {left}" if answer.code == 2 and left else ""


def names_what_is_wrong(answer: Answer) -> str:
    """Bad input is named: key, value and rule of each, or the usage of the command."""
    if answer.code != 2 or "usage: agvjax" in answer.said:
        return ""
    lines = re.findall(r"^  \S.* = .*: must be .+", answer.said, re.MULTILINE)
    return "" if lines else "exit code 2 and no `key = value: must be`"


def short(answer: Answer) -> str:
    """A message is for a person."""
    return f"{len(answer.said)} characters" if answer.code == 2 and len(answer.said) > 20_000 else ""


def finite(answer: Answer) -> str:
    """Success writes finite numbers, and settings that can be used again."""
    if answer.code != 0:
        return ""
    for path in answer.folder.rglob("*.json"):
        json.loads(
            path.read_text(), parse_constant=_refuse
        )  # what there is none of is null: late errors of a short run
    for path in answer.folder.rglob("trajectory.npz"):
        with np.load(path, allow_pickle=False) as file:
            if bad := [name for name in file if not np.all(np.isfinite(file[name]))]:
                return f"{path.name} holds what is not finite: {bad}"
    for path in answer.folder.rglob("gains.toml"):
        if str(path.relative_to(answer.folder)) not in answer.before:
            beside = [str(path.with_name("config.toml"))] if path.with_name("config.toml").exists() else []
            config.load([*beside, str(path)])  # raises where agvjax.faults has something against it
    return ""


def comes_back(answer: Answer) -> str:
    """What a run says it was given is read again, and written to the same."""
    path = answer.folder / "out" / "config.toml"
    if answer.code not in (0, 1) or not path.exists() or "out/config.toml" in answer.before:
        return ""
    text = path.read_text()
    return "" if config.dump(config.load([str(path)])) == text else "config.toml is read to something else"


RULES: list[Callable[[Answer], str]] = [
    ends,
    no_traceback,
    nothing_left,
    names_what_is_wrong,
    short,
    finite,
    comes_back,
]


def broken(answer: Answer) -> list[str]:
    """What of the rules an answer breaks."""
    wrong = []
    for rule in RULES:
        try:
            wrong.append(rule(answer))
        except Exception as error:  # what was written cannot be read again
            wrong.append(f"{rule.__name__}: {type(error).__name__}: {error}")
    return [text for text in wrong if text]


def _files(folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in folder.rglob("*")]


def _refuse(word: str) -> None:
    raise ValueError(f"{word} is no number of JSON")
