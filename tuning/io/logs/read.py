"""Which library reads a recording, by the end of its name."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path

from .recording import Recording

READERS = {  # by the end of a name: what reads it, and the libraries that this needs
    ".bag": ("ros", ("rosbags",)),
    ".db3": ("ros", ("rosbags",)),
    ".mcap": ("ros", ("rosbags", "mcap")),
    ".ulg": ("px4", ("pyulog",)),
    ".bin": ("ardupilot", ("pymavlink",)),
    ".log": ("ardupilot", ("pymavlink",)),
    ".mf4": ("mdf", ("asammdf",)),
    ".mdf": ("mdf", ("asammdf",)),
}
FOLDER = ("ros", ("rosbags", "mcap"))  # of a bag of ROS 2


def is_recording(file: str) -> bool:
    """Whether a name is of a folder, or ends as those of recordings do."""
    return Path(file).is_dir() or Path(file).suffix.lower() in READERS


def read(file: str, tick: Callable[[int, int], None] = lambda count, total: None) -> Recording:
    """The streams of a recording.

    Args:
        file: its name; the folder of a bag of ROS 2.
        tick: told how much was read, of how much; 0 where nobody knows.

    Raises:
        ValueError: it cannot be read; it says why, or what has to be installed.
    """
    path = Path(file)
    if not path.exists():
        raise ValueError(f"{file} is not there")
    module, libraries = FOLDER if path.is_dir() else READERS[path.suffix.lower()]
    if missing := [name for name in libraries if importlib.util.find_spec(name) is None]:
        raise ValueError(f"{', '.join(missing)} must be installed to read {path.name}: pip install 'agvjax[logs]'")
    recording: Recording = importlib.import_module(f".{module}", __package__).read(path, tick)
    if not any(stream.size for stream in recording.streams):
        kinds = ", ".join(sorted({kind for kind, _ in recording.unread.values()})) or "nothing"
        raise ValueError(f"no stream of it can be used: it holds {kinds}")
    return recording
