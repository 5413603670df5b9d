"""Which library reads a recording, by the end of its name."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path

from . import tables
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
FORMATS = b"FMT,"
FOLDER = ("ros", ("rosbags", "mcap"))  # of a bag of ROS 2
TABLES = ("tables", ())  # a folder of text tables


def is_recording(file: str) -> bool:
    """Whether a file is a recording, by its name: of a folder, or as those of recordings end.

    Many text files are called .log: that of a dataflash begins with its formats.
    """
    path = Path(file)
    if path.suffix.lower() == ".log" and path.is_file():
        with path.open("rb") as opened:
            return opened.read(len(FORMATS)) == FORMATS
    return path.is_dir() or path.suffix.lower() in READERS


def read(file: str, tick: Callable[[int], object] = lambda count: None) -> Recording:
    """The streams of a recording.

    Args:
        file: its name; the folder of a bag of ROS 2, or of text tables.
        tick: told how many more messages were read.

    Raises:
        ValueError: it cannot be read; it says why, or what has to be installed.
    """
    path = Path(file)
    recording: Recording = importlib.import_module(f".{_reader(path)}", __package__).read(path, tick)
    if not any(stream.size for stream in recording.streams):
        kinds = ", ".join(sorted({kind for kind, _ in recording.unread.values()})) or "nothing"
        raise ValueError("; ".join([f"no stream of it can be used: it holds {kinds}", *recording.lost]))
    return recording


def of_bag(file: str) -> bool:
    """Whether a recording is of ROS; raises as `read` where nothing can read it."""
    return _reader(Path(file)) == "ros"


def _reader(path: Path) -> str:
    """The module that reads a recording; a folder is one of text tables, unless there is the file of a bag in it.

    Raises:
        ValueError: it is not there, or a library is not.
    """
    if not path.exists():
        raise ValueError(f"{path} is not there")
    module, libraries = READERS.get(path.suffix.lower(), FOLDER)
    if path.is_dir():
        packed = sorted(part.name for part in path.iterdir() if part.suffix in (".zst", ".gz", ".lz4"))
        bag = any(part.suffix in (".mcap", ".db3") for part in path.iterdir())
        module, libraries = TABLES if not bag and tables.files(path) else FOLDER
        if packed and not bag and module == FOLDER[0]:
            raise ValueError(f"its file is compressed: unpack {packed[0]} first")
    if missing := [name for name in libraries if importlib.util.find_spec(name) is None]:
        raise ValueError(f"{', '.join(missing)} must be installed to read {path.name}: pip install 'agvjax[logs]'")
    return module
