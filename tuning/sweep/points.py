"""Vehicles that are kept in a folder one by one, to be rolled out again: no shards, no design behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..config.load import resolve
from ..config.settings import Config
from ..io import files, plain
from .rules import faults

FILE = "points.json"


def there(folder: Path) -> bool:
    """Whether a folder holds such vehicles."""
    return (folder / FILE).exists()


def write(folder: Path, points: Sequence[Mapping[str, np.ndarray]]) -> None:
    """Keep the leaves of some vehicles, by name; `config.toml` is in the folder already."""
    files.write_json(folder / FILE, [{name: np.asarray(x).tolist() for name, x in point.items()} for point in points])


def read(folder: Path, imports: Sequence[str] = ()) -> tuple[Config, list[dict[str, np.ndarray]]]:
    """The configuration of a folder, and the leaves of every vehicle in it.

    Raises:
        ValueError: a file is damaged.
    """
    try:
        table: list[dict[str, list[float] | float]] = plain.from_json(files.text(folder / FILE))
        points = [{name: np.asarray(x, float) for name, x in point.items()} for point in table]
        config = resolve(plain.toml(files.text(folder / "config.toml")), faults, imports)
    except (OSError, TypeError, AttributeError) as error:
        raise ValueError(f"{folder / FILE} or config.toml beside it is damaged ({error})") from error
    return config, points
