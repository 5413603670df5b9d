"""ULog of PX4, through the library pyulog."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from .recording import Recording, Stream


def read(path: Path, tick: Callable[[int], object]) -> Recording:
    """The topics of a .ulg file, a stream for each instance; their time is that of the autopilot's clock.

    Raises:
        ValueError: it is no ULog.
    """
    from pyulog import ULog

    try:
        with path.open("rb") as file:  # the library leaves a file open that it cannot read
            log = ULog(file)
    except Exception as error:  # the library ends in whatever damaged bytes lead it to
        raise ValueError(f"no ULog of PX4 that can be read ({str(error) or type(error).__name__})") from error
    streams = []
    for data in log.data_list:
        topic = data.name + (f"[{data.multi_id}]" if data.multi_id else "")
        times = np.asarray(data.data["timestamp"], np.int64) * 1000
        fields = {name: np.asarray(x, float) for name, x in data.data.items() if name != "timestamp"}
        streams.append(Stream(topic, data.name, times, None, fields))
    tick(sum(stream.size for stream in streams))
    lost = [f"{len(log.dropouts)} times the logger was too slow: messages are missing"] if log.dropouts else []
    if log.file_corruption:
        lost.append("the file is damaged or ends too early: what could be read was read")
    return Recording(path.name, tuple(streams), {}, tuple(lost))
