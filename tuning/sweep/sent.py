"""Settings and laws as they are sent to another process: as TOML, with the files of classes of one's own."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from agvjax.protocols import Law

from .. import config as configuration
from ..config.settings import Config
from ..io import files

Files = tuple[tuple[str, bytes], ...]  # name and content


def packed(imports: Sequence[str]) -> Files:
    """The files that classes of one's own are in."""
    return tuple((Path(name).name, files.content(Path(name))) for name in imports)


@contextlib.contextmanager
def unpacked(own: Files) -> Iterator[list[str]]:
    """Where they lie while they are read."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, name) for name, _ in own]
        for path, (_, content) in zip(paths, own, strict=True):
            path.write_bytes(content)
        yield [str(path) for path in paths]


def texts(config: Config, laws: Sequence[Law]) -> tuple[str, ...]:
    """The settings, and each law, as TOML."""
    return configuration.dump(config, strict=False), *map(configuration.gains_table, laws)


def same(config: Config, laws: Sequence[Law], written: Sequence[str]) -> None:
    """Refuse what was read to something else than it was written of.

    Raises:
        ValueError: it was, as where a law is known to Python alone.
    """
    if texts(config, laws) != tuple(written):
        raise ValueError("what was sent is read to other settings than it was written of")
