"""Dataflash logs of ArduPilot, through the library pymavlink."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .recording import Gathered, Recording


def read(path: Path, tick: Callable[[int, int], None]) -> Recording:
    """The messages of a .bin or .log file, a stream for each type and instance; by the autopilot's clock.

    Raises:
        ValueError: it is no such log.
    """
    from pymavlink.DFReader import DFReader_binary, DFReader_text

    known: dict[str, Gathered] = {}
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
    except Exception as error:  # the library ends in whatever damaged bytes lead it to
        if not known:
            raise ValueError(f"no dataflash log that can be read ({str(error) or type(error).__name__})") from error
        lost = (f"it ends too early or is damaged ({str(error) or type(error).__name__})",)
        return Recording(path.name, tuple(one.stream() for one in known.values()), {}, lost)
    if not known:
        raise ValueError("no dataflash log that can be read (no message with a time in it)")
    return Recording(path.name, tuple(one.stream() for one in known.values()), {}, ())
