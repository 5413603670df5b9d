"""Nav2's parameter files: the section of a Regulated Pure Pursuit read, and tuned values written back into the text.

Written are the values that were tuned and no other character. A number is written with six significant digits and a
point, for ROS takes `1` for a whole number and refuses it where a double belongs.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from agvjax import Fault, InputError

from .. import files
from ..yaml_text import Document, parse, plain
from .names import FREQUENCY, PARAMETERS
from .rules import crossed, malformed, untold, wrong
from .section import KEY, found_in, frequency_of, ignored, remarks, section_of, spelled
from .splice import spliced

LARGEST_FILE = 1_000_000  # bytes
GIVEN = "the text"  # what messages call a file of which only the text is known
OWN = ("plugin", "primary_controller")  # what says which plugin a section is of


class Parameters(NamedTuple):
    """What a file says of one controller."""

    file: str
    controller: str  # node and controller: what `write` takes
    text: str  # of the whole file, its line ends as they are
    values: dict[str, float | bool]  # of the law, by its names; what the file leaves to Nav2's defaults is not there
    ignored: dict[str, str]  # name: why it means nothing here
    unknown: tuple[str, ...]
    remarks: tuple[str, ...]  # sentences for a person
    period: float  # s, of the server; Nav2's default where the file does not say
    lines: dict[str, int]  # of every parameter by its name in the file, and of controller_frequency; counted from 1


def read(path: str | Path, controller: str | None = None) -> Parameters:
    """The parameters of a Regulated Pure Pursuit in a file.

    Args:
        path: the file.
        controller: its name, `FollowPath`, or with its node, `controller_server.FollowPath`; None: the only one.

    Raises:
        agvjax.InputError: lists everything that is wrong with the file or the section.
    """
    file, text = str(path), _text(path)
    document = _document(text, file)
    section = section_of(document, controller, file)
    found, frequency = found_in(document, section), frequency_of(document, section)
    if faults := wrong(document, section, found, frequency, file):
        raise InputError(faults)
    hertz = FREQUENCY.default if frequency is None else plain(frequency.node)
    names, without = spelled(found), ignored(found, section)
    values = {law: plain(found[name].node) for name, law in names.items()}
    stated = {} if frequency is None else {"controller_frequency": frequency.line}
    return Parameters(
        file=file,
        controller=section.name,
        text=text,
        values={law: value for law, value in values.items() if isinstance(value, (bool, float))},
        ignored=without,
        unknown=tuple(name for name in found if name not in {*names, *without, *OWN}),
        remarks=remarks(document, section, found),
        period=1.0 / float(str(hertz)),
        lines={name: leaf.line for name, leaf in found.items()} | stated,
    )


def write(source_text: str, tuned: Mapping[str, float | bool], controller: str | None = None) -> str:
    """The text with the tuned values in the controller's section, and no other character of it changed.

    A value that already reads the same to six digits is left as it stands. A parameter that the section does not have,
    or has from a table that others share, gets a line of its own below the plugin's.

    Args:
        source_text: of the file, `Parameters.text`.
        tuned: values by the names of the law.
        controller: as in `read`.

    Raises:
        agvjax.InputError: a name or a value that cannot be written, or one that would change another controller too; a
            least look-ahead above the largest.
    """
    document = _document(source_text, GIVEN)
    section = section_of(document, controller, GIVEN)
    found = found_in(document, section)
    if faults := untold(tuned) + malformed(document, section, found, GIVEN):
        raise InputError(faults)
    names = {law: name for name, law in spelled(found).items()}
    wanted = {names.get(law, law): tuned[law] for law in PARAMETERS if law in tuned}
    text = spliced(document, section.plugin, found, wanted, section.name)
    again = _document(text, GIVEN)
    if faults := crossed(section, found_in(again, section_of(again, controller, GIVEN)), GIVEN):
        raise InputError(faults)
    return text


def diff(before: str, after: str, name: str = "nav2_params.yaml") -> str:
    """What changed from one text to the other, as a unified diff; empty where nothing did."""
    old, new = (re.findall(r"[^\n]*\n|[^\n]+$", text) for text in (before, after))
    end = "\n\\ No newline at end of file\n"
    found = difflib.unified_diff(old, new, f"a/{name}", f"b/{name}")
    return "".join(line if line.endswith("\n") else line + end for line in found)


def _text(path: str | Path) -> str:
    """The text of a file, its line ends and its byte order mark as they are."""
    try:
        return files.content(Path(path), LARGEST_FILE).decode("utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError([Fault(KEY, str(path), f"a readable file in UTF-8 ({reason})")]) from error


def _document(text: str, file: str) -> Document:
    try:
        return parse(text)
    except ValueError as error:
        raise InputError([Fault(KEY, file, f"YAML of one document ({error})")]) from error
