"""Bags of ROS 1 and ROS 2 and MCAP, through the library rosbags: no ROS, and no code of a message is executed."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import sqlite3
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from . import mcap_file, sqlite_file
from .recording import Gathered, Part, Recording, Sent
from .roles import ROLES

BY_NAME = ("sensor_msgs/msg/JointState", "sensor_msgs/msg/NavSatFix")  # types whose numbers serve where they are named
BY_NAME += tuple(f"std_msgs/msg/Float{bits}{many}" for bits in (32, 64) for many in ("", "MultiArray"))
KINDS = {*ROLES, *BY_NAME}  # what is read of a bag: all that a drive can be told by
TOGETHER = 4096  # messages between two words of how far it is
LONGEST = 64  # numbers of a list that are taken
BEYOND = ("covariance", "effort")  # of no use here


def read(path: Path, tick: Callable[[int], object]) -> Recording:
    """The streams of a bag: a .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.

    A bag that ends too early gives what it holds, but one of ROS 1, which has its index at its end.

    Args:
        path: the file or folder.
        tick: told how many more messages were read.

    Raises:
        ValueError: it is no such bag.
    """
    lost: list[str] = []
    return _gathered(path, messages(path, lost), lost, tick)


def messages(path: Path, lost: list[str]) -> Iterator[Sent]:
    """The messages of a bag, one by one; `lost` is told what is missing. Raises as `read` does."""
    parts = sorted(p for p in path.iterdir() if p.suffix in (".mcap", ".db3")) if path.is_dir() else [path]
    if not parts:
        raise ValueError("a folder without a .mcap or .db3 file in it")
    return itertools.chain(*(_messages(part, lost) for part in parts))


def _messages(path: Path, lost: list[str]) -> Iterator[Sent]:
    """The messages of one file, as far as it can be read.

    Raises:
        ValueError: nothing of it can be.
    """
    if path.suffix == ".mcap":
        yield from mcap_file.messages(path, lost)
        return
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    count, failures = 0, (AnyReaderError, sqlite3.DatabaseError, OSError, LookupError, AssertionError, ValueError)
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            for one, arrival, raw in bag.messages():
                count += 1
                yield one.topic, one.msgtype, arrival, functools.partial(bag.deserialize, raw, one.msgtype)
    except (*failures, struct.error) as error:
        words = f"{path.name}: {str(error) or type(error).__name__}"
        if count == 0 and path.suffix == ".db3":
            yield from sqlite_file.messages(path, lost)
            return
        if count == 0:
            raise ValueError(f"no bag of ROS that can be read ({words})") from error
        lost.append(f"{words}; {count} messages before that were read")


def _gathered(path: Path, sent: Iterator[Sent], lost: list[str], tick: Callable[[int], object]) -> Recording:
    """The streams of messages."""
    known: dict[str, Gathered] = {}
    unread: dict[str, tuple[str, int]] = {}
    damaged: dict[str, int] = {}
    count = 0
    for count, (topic, kind, arrival, message) in enumerate(sent, 1):
        if count % TOGETHER == 0:
            tick(TOGETHER)
        if kind not in KINDS:
            unread[topic] = kind, unread.get(topic, (kind, 0))[1] + 1
            continue
        try:
            parts = list(_parts(topic, message()))
        except Exception as error:  # of a library that meets damaged bytes anything may come
            damaged[topic] = damaged.get(topic, 0) + 1
            if damaged[topic] == 1:
                lost.append(f"{topic}: a message is damaged ({type(error).__name__})")
            continue
        for name, stamp, numbers in parts:
            known.setdefault(name, Gathered(name, kind)).add(arrival, stamp, numbers)
    tick(count % TOGETHER)
    lost += [f"{topic}: {times} messages are damaged in all" for topic, times in damaged.items() if times > 1]
    return Recording(path.name, tuple(one.stream() for one in known.values()), unread, tuple(lost))


def _parts(topic: str, message: Part) -> Iterator[tuple[str, int | None, dict[str, float]]]:
    """The streams that a message belongs to: itself, or each of the transforms in it."""
    if hasattr(message, "transforms"):
        for one in message.transforms:
            name = f"{topic}:{one.header.frame_id.lstrip('/')}->{one.child_frame_id.lstrip('/')}"
            yield name, _stamp(one), dict(_numbers("", one))
        return
    yield topic, _stamp(message), dict(_numbers("", message))


def _stamp(message: Part) -> int | None:
    """When its sender stamped it [ns], None where it does not."""
    stamp = getattr(getattr(message, "header", message), "stamp", None)
    return None if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _numbers(prefix: str, part: Part) -> Iterator[tuple[str, float]]:
    """Its numbers by dotted name; of joints by their names."""
    labels = getattr(part, "name", None)
    labels = labels if isinstance(labels, (list, tuple)) else None
    for field in dataclasses.fields(part):
        name, value = field.name, getattr(part, field.name)
        if name.startswith("__") or name in ("header", "stamp") or any(word in name for word in BEYOND):
            continue
        full = f"{prefix}{name}"
        if isinstance(value, (bool, int, float, np.number)):
            yield full, float(value)
        elif isinstance(value, (list, tuple, np.ndarray)):
            if len(value) and len(value) <= LONGEST and isinstance(value[0], (int, float, np.number)):
                keys = labels if labels is not None and len(labels) == len(value) else range(len(value))
                yield from ((f"{full}[{key}]", float(x)) for key, x in zip(keys, value, strict=True))
        elif dataclasses.is_dataclass(value):
            yield from _numbers(f"{full}.", value)
