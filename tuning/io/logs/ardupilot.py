"""Dataflash logs of ArduPilot, through the library pymavlink."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .recording import Gathered, Recording


def read(path: Path, tick: Callable[[int], object]) -> Recording:
    """The messages of a .bin or .log file, a stream for each type and instance; by the autopilot's clock.

    Raises:
        ValueError: it is no such log.
    """
    from pymavlink.DFReader import DFReader_binary, DFReader_text

    known: dict[str, Gathered] = {}
    lost, log = "no message with a time in it", None
    try:
        log = (DFReader_text if path.suffix.lower() == ".log" else DFReader_binary)(str(path), zero_time_base=True)
        while (message := log.recv_msg()) is not None:
            values = message.to_dict()
            if "TimeUS" not in values:
                continue
            kind = message.get_type()
            topic = f"{kind}[{values['I']}]" if values.get("I") else kind
            numbers = {n: float(x) for n, x in values.items() if n != "TimeUS" and isinstance(x, (int, float))}
            known.setdefault(topic, Gathered(topic, kind)).add(int(values["TimeUS"]) * 1000, None, numbers)
        lost = lost if not known else ""
    except Exception as error:  # the library ends in whatever damaged bytes lead it to
        lost = f"it ends too early or is damaged ({str(error) or type(error).__name__})"
    finally:
        if log is not None:  # the library leaves its file open
            log.data_map.close()
            log.filehandle.close()
    if not known:
        raise ValueError(f"no dataflash log that can be read ({lost})")
    streams = tuple(one.stream() for one in known.values())
    tick(sum(stream.size for stream in streams))
    return Recording(path.name, streams, {}, (lost,) if lost else ())
