"""`agvjax log`: what a recorded drive holds, what it can serve for, and what is missing."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from agvjax import Fault, InputError

from ..identify import recorded
from ..io.logs import READERS, is_recording, read
from ..io.logs.roles import chosen
from ..io.logs.rows import table
from .console import Console
from .folders import new_folder

KINDS = f"{', '.join(READERS)}, or the folder of a bag of ROS 2 or of text tables"


def run(arguments: argparse.Namespace) -> int:
    """Read, say, draw; 1 where nothing can be identified from it as it is."""
    console, asked, doubts = Console(arguments.quiet), topics(arguments.topics), list[str]()
    if not is_recording(arguments.file):
        rule = f"a recording: {KINDS}; a CSV file is handed to agvjax identify as it is"
        raise InputError([Fault("FILE", arguments.file, rule)])
    try:
        with console.phases() as phases:
            phase = phases.begin("reading", unit="messages")
            recording = read(arguments.file, phase.advance)
            found = chosen(recording, asked, doubts=doubts)
            rows = table(recording, found, asked=arguments.stamps or "auto") if found else None
    except ValueError as error:
        raise InputError([Fault("FILE", arguments.file, f"a recording that can be read: {error}")]) from error
    out = new_folder(arguments.out, arguments.command)
    against = recorded.unfit(rows) if rows is not None else []
    text = recorded.write(recording, found, rows, out, doubts, against)
    console.conclude(text, f"written to {out}; begin with {out}/report.html")
    return 0 if {"pose", "command"} <= set(found) and not doubts and not against else 1


def reading(arguments: argparse.Namespace) -> dict[str, object]:
    """What `--fit`, `--topics` and `--stamps` set, of commands that identify a vehicle from a recording."""
    given: dict[str, object] = {}
    if arguments.fit is not None:
        given["identify.fit"] = arguments.fit.split(",")
    if arguments.topics:
        given["identify.topics"] = topics(arguments.topics)
    if arguments.stamps:
        given["identify.stamps"] = arguments.stamps
    return given


def topics(given: Sequence[str]) -> dict[str, str]:
    """By role a topic, of ROLE=TOPIC each.

    Raises:
        agvjax.InputError: one is not written so.
    """
    wrong = [text for text in given if "=" not in text]
    if wrong:
        raise InputError([Fault("--topics", wrong[0], "ROLE=TOPIC, as pose=/odom or command=/cmd_vel")])
    return {role.strip(): topic.strip() for role, _, topic in (text.partition("=") for text in given)}
