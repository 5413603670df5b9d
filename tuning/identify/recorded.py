"""What a recording holds and can serve for: a table, a picture of the drive, what was driven, what is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..io.logs.recording import Recording, Stream
from ..io.logs.roles import Role, missing, roles_of
from ..io.logs.rows import Rows
from ..io.pages import grid, picture, publish
from ..io.panels import panels
from ..io.pictures import write_figures
from .coverage import motions
from .log import LEAST_ROWS, POSE, Log
from .plain import twists

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNITS = {"cmd_v": "m/s", "cmd_w": "rad/s", "speed_cmd": "m/s", "steering_angle_cmd": "rad"}
COMMANDS = tuple(UNITS)
UNITS |= {"speed": "m/s", "yaw_rate": "rad/s"}  # of what is drawn over time
BY_NAME = (
    "A quantity that stands in another topic is named in [identify.columns], as TOPIC.FIELD:"
    ' cmd_v = "/drive_command.data[0]".'
)
STILL = 0.02  # m/s, and rad/s, below which a vehicle stands and does not turn
SMALL = 0.25  # of the largest command: what is less is small, where a deadzone shows
STANDS = (0.05, 0.05)  # m and rad, within which nearly all poses are of a vehicle that never moves
FAR = 1.0  # s from message to message, from which on no control loop is seen
LEAST = 20.0  # s of a kind of driving, from which on something can be learned of it


class Share(NamedTuple):
    """For how long something was done."""

    what: str
    seconds: float


def shares(rows: Rows) -> list[Share]:
    """For how long the vehicle drove each way, by its poses, and was told little; of the rows there are."""
    t = rows.columns["t"] - rows.columns["t"][0]
    pose = {name: rows.columns[name] for name in POSE}
    moved = twists(Log("", 0.0, t, np.zeros((len(t), 0)), (), pose))
    driven = motions(moved[:, 0], moved[:, 2], STILL, STILL) if len(moved) else {}
    found = [Share(what, float(np.mean(when) * t[-1])) for what, when in driven.items()]
    for name in COMMANDS:
        if name in rows.columns and np.isfinite(rows.columns[name]).any():
            size = np.abs(rows.columns[name])
            most = float(np.nanmax(size))
            little = np.mean((size > 0) & (size < SMALL * most))
            found.append(Share(f"small {name}, up to {SMALL * most:.3g}", float(little * t[-1])))
    return found


def table(recording: Recording, stamps: str) -> str:
    """The streams, a row each, then what is not read."""
    header = ("topic", "type", "messages", "rate [Hz]", "gaps", "jitter [ms]", "stamps", "can serve as")
    lines = [_line(stream, stamps) for stream in sorted(recording.streams, key=lambda s: s.topic)]
    lines += [
        (topic, kind.rpartition("/")[2], count, "", "", "", "", "nothing here")
        for topic, (kind, count) in sorted(recording.unread.items())
    ]
    return grid(header, lines)


def _line(stream: Stream, stamps: str) -> tuple[object, ...]:
    usual, gaps, jitter = stream.regularity(stamps)
    roles = ", ".join(f"{role.name} ({', '.join(role.tells)})" for role in roles_of(stream))
    roles = roles or f"columns by name: {', '.join(list(stream.fields)[:3])}{' ...' * (len(stream.fields) > 3)}"
    whose = "sender" if stamps == "header" and stream.header is not None else "arrival"
    rate = f"{1 / usual:.4g}" if usual > 0 else ""
    told = f"{round(1e3 * jitter, 3):.3g}" if np.isfinite(jitter) else ""
    return (stream.topic, stream.kind.rpartition("/")[2], stream.size, rate, gaps, told, whose, roles)


def unfit(rows: Rows) -> list[str]:
    """Why nothing can be identified from these rows, though every topic is there."""
    table = rows.columns
    commands = [table[name] for name in COMMANDS if name in table]
    known = np.logical_and.reduce([np.isfinite(one) for one in commands]) if commands else np.zeros(0, bool)
    if not commands or "x" not in table:
        return []
    step = float(np.median(np.diff(table["t"])))
    if step >= FAR:
        mended = 'of a table, times in ms stand in a column "timestamp [ms]"'
        return [f"messages are {step:.3g} s apart, too far for a control loop; {mended}"]
    if known.sum() < LEAST_ROWS:
        return [f"every command is known in {known.sum()} rows, fewer than {LEAST_ROWS}"]
    if not any(np.any(one[known] != 0) for one in commands):
        return ["nothing was commanded"]
    pose = [table[name][np.isfinite(table[name])] for name in POSE]
    moved = [float(np.ptp(np.quantile(one, (0.02, 0.98)))) if one.size else 0.0 for one in pose]
    told = float(np.nansum(np.abs(table["cmd_v"])) * step) if "cmd_v" in table else 0.0
    if max(moved[:2]) < STANDS[0] and moved[2] < STANDS[1]:
        return ["the pose never changes" + f", though {told:.3g} m were asked for" * (told > 0)]
    return []


def verdict(
    found: Mapping[str, tuple[Stream, Role]], driven: list[Share], doubts: Sequence[str], against: Sequence[str] = ()
) -> list[str]:
    """What the recording is good for, a sentence each, the first one first."""
    if lacks := missing(found):
        return [f"Not good for identification: {'; '.join([*lacks, *doubts])}.", BY_NAME]
    if against:
        return [f"Not good for identification: {'; '.join([*against, *doubts])}."]
    if doubts:
        taken = ", ".join(stream.topic for name, (stream, _) in found.items() if name in ("pose", "command"))
        return [f"Good for identification once this is said: {'; '.join(doubts)}.", f"Looked at here: {taken}."]
    parts = ", ".join(f"{name} from {stream.topic}" for name, (stream, _) in found.items())
    thin = [share for share in driven if share.seconds < LEAST]
    if not thin:
        return [f"Good for identification: {parts}."]
    listed = "; ".join(f"{share.what}, {share.seconds:.0f} s" for share in thin)
    return [
        f"It can be read for identification: {parts}.",
        f"Little was driven of some things: {listed}. Half a minute of each would complete it.",
    ]


def drive_figure(rows: Rows) -> Figure:
    """Where the vehicle was, coloured by time, and what was told and measured over time."""
    c = rows.columns
    t = c["t"] - c["t"][0]
    told = [name for name in UNITS if name in c]
    figure, axes = panels(1 + len(told), 1, (8.0, 4.5 + 1.4 * len(told)), height_ratios=[3.0, *[1.0] * len(told)])
    place, fine = axes[0, 0], np.isfinite(c["x"])
    dots = place.scatter(c["x"][fine], c["y"][fine], c=t[fine], s=3, cmap="viridis")
    figure.colorbar(dots, ax=place, label="time [s]")
    place.set_aspect("equal", adjustable="datalim")
    place.set(xlabel="x [m]", ylabel="y [m]", title="where the vehicle was")
    for row, name in zip(axes[1:, 0], told, strict=True):
        row.plot(t, c[name], ".", ms=1.5, color="0.2")
        row.set_ylabel(f"{name}\n[{UNITS[name]}]")
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def write(
    recording: Recording,
    found: Mapping[str, tuple[Stream, Role]],
    rows: Rows | None,
    folder: Path,
    doubts: Sequence[str] = (),
    against: Sequence[str] = (),
) -> str:
    """Report and figure into a folder, with what `chosen` doubts and `unfit` says; returns what a terminal shows."""
    stamps = rows.stamps if rows is not None else "arrival"
    drive = rows if rows is not None and "x" in rows.columns else None
    driven = shares(drive) if drive is not None else []
    said = verdict(found, driven, doubts, against)
    topics = table(recording, stamps)
    notes = [*(f"Missing: {line}." for line in recording.lost), *(rows.notes if rows is not None else ())]
    sections = [f"# What {recording.name} holds", *said]
    if drive is not None:
        write_figures(folder, {"drive": lambda: drive_figure(drive)})
        caption = f"The drive of {recording.name}: where the vehicle was, what it was told, what was measured"
        sections.append(picture("drive.png", caption))
    sections += ["## Topics", topics]
    if driven:
        sections += ["## What was driven", grid(("what", "seconds"), [(s.what, f"{s.seconds:.0f}") for s in driven])]
    if notes:
        sections += ["## How it was read", "\n".join(f"* {line}" for line in notes)]
    publish(folder, "\n\n".join(sections))
    return "\n\n".join([said[0], topics, *said[1:], *notes])
