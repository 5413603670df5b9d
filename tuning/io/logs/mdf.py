"""Measurement data of cars, MDF 3 and 4, through the library asammdf."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from .recording import Recording, Stream


def read(path: Path, tick: Callable[[int], object]) -> Recording:
    """The channel groups of an .mf4 or .mdf file, a stream for each; channels that are no numbers are left out.

    Raises:
        ValueError: it is no such file.
    """
    from asammdf import MDF

    try:
        with MDF(path) as log:
            streams = []
            for number, group in enumerate(log.groups):
                signals = [s for s in log.select([(None, number, i) for i in range(len(group.channels))])]
                numbers = {
                    s.name: s for s in signals if np.issubdtype(s.samples.dtype, np.number) and s.samples.ndim == 1
                }
                times = next((s.timestamps for s in numbers.values()), np.zeros(0))
                fields = {n: s.samples.astype(float) for n, s in numbers.items() if len(s.samples) == len(times)}
                fields = {n: x for n, x in fields.items() if not np.array_equal(x, times)}  # the time channel itself
                streams.append(Stream(f"group{number}", "MDF", np.round(times * 1e9).astype(np.int64), None, fields))
    except Exception as error:  # the library ends in whatever damaged bytes lead it to
        raise ValueError(f"no MDF file that can be read ({str(error) or type(error).__name__})") from error
    tick(sum(stream.size for stream in streams))
    return Recording(path.name, tuple(s for s in streams if s.fields), {}, ())
