"""`agvjax completion`: a script with which a shell completes commands and options, without starting Python."""

from __future__ import annotations

import argparse

import shtab

from .main import parser


def run(arguments: argparse.Namespace) -> int:
    """Print the script for a shell; --quiet does not silence it, for it is all that there is."""
    top = parser()
    for one in _all(top):
        for action in one._actions:
            if action.metavar and any(end in str(action.metavar) for end in (".toml", ".csv", ".py", ".yaml")):
                vars(action)["complete"] = shtab.FILE
            elif action.metavar == "DIR":
                vars(action)["complete"] = shtab.DIRECTORY
    print(shtab.complete(top, arguments.shell))
    return 0


def _all(top: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """A parser and those of its commands."""
    commands = [action for action in top._actions if isinstance(action, argparse._SubParsersAction)]
    return [top, *(one for action in commands for one in action.choices.values())]
