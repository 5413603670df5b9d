"""MCAP, record by record: a file without its end, or larger than memory, is read as far as it goes."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from .recording import Part, Sent


def messages(path: Path, lost: list[str]) -> Iterator[Sent]:
    """Messages of ROS 1 and 2 in a file.

    Args:
        path: the file.
        lost: told what is missing.

    Raises:
        ValueError: it is no MCAP file.
    """
    from mcap.exceptions import McapError

    count = 0
    with path.open("rb") as file:
        try:
            for message in _whole(file):
                count += 1
                yield message
        except (McapError, OSError, EOFError, KeyError, ValueError, AssertionError) as error:
            words = f"{path.name}: {str(error) or type(error).__name__}"
            if not count:
                raise ValueError(f"no MCAP file that can be read ({words})") from error
            lost.append(f"{words}: it ends too early; {count} messages were read")


def _whole(file: BinaryIO) -> Iterator[Sent]:
    """Messages up to where a record is not whole."""
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, str, Callable[[bytes], Part]]] = {}
    for record in StreamReader(file).records:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            schema = schemas.get(record.schema_id)
            kind = schema.name if schema else record.message_encoding
            channels[record.id] = record.topic, _full(kind), _decoder(record.message_encoding, schema)
        elif isinstance(record, Message):
            topic, kind, decode = channels[record.channel_id]
            yield topic, kind, record.log_time, functools.partial(decode, record.data)


def _full(kind: str) -> str:
    """The name of a type as ROS 2 has it; ROS 1 leaves out what it is."""
    package, _, name = kind.partition("/")
    return kind if "/" in name or not name else f"{package}/msg/{name}"


def _decoder(encoding: str, schema: Part) -> Callable[[bytes], Part]:
    """What makes messages of bytes, by the definition that the file brings."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if schema is None or encoding not in ("cdr", "ros1"):
        return _unknown(encoding)
    kind, text = _full(schema.name), schema.data.decode("utf-8", "replace")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_idl(text) if schema.encoding == "ros2idl" else get_types_from_msg(text, kind))
    if encoding == "ros1":
        return lambda raw: store.deserialize_ros1(raw, kind)
    return lambda raw: store.deserialize_cdr(raw, kind)


def _unknown(encoding: str) -> Callable[[bytes], Part]:
    """Of what is no message of ROS."""

    def refused(raw: bytes) -> Part:
        raise ValueError(f"messages encoded as {encoding}")

    return refused
