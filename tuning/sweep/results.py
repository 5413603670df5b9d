"""What a sweep found, as NumPy arrays; and as an xarray Dataset, netCDF or Parquet where these are installed."""

from __future__ import annotations

import json
import tomllib
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import agvjax
from agvjax.metric_table import OLD_NAMES

from ..config.load import resolve
from ..config.settings import Config
from . import shards
from .design import Design, design
from .rules import faults
from .shards import Manifest


class _Metrics(dict[str, np.ndarray]):
    """Metrics by name; an old name is known and said to be old."""

    def __missing__(self, name: str) -> np.ndarray:
        new = OLD_NAMES.get(name)
        if new not in self:
            raise KeyError(name)
        warnings.warn(f"metric {name!r} is now {new!r}", DeprecationWarning, stacklevel=2)
        return self[new]


class Results(NamedTuple):
    """A finished sweep: C controllers, N scenarios in the order of their numbers."""

    manifest: Manifest
    config: Config  # without `sweep.fails`, which may change afterwards
    design: Design
    ok: np.ndarray  # (C, N)
    metrics: dict[
        str, np.ndarray
    ]  # (C, N); infinite where a run diverged, the settling time also where it did not settle
    leaves: dict[str, np.ndarray]  # (N, ...), what varied

    @property
    def names(self) -> tuple[str, ...]:
        """Of the controllers."""
        return self.manifest.names

    def grid(self, metric: str) -> np.ndarray:
        """A metric by controller, place in the grid, and sample: (C, *shape, samples)."""
        return self.metrics[metric].reshape(-1, *self.design.shape, self.design.samples)

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with named dimensions; coordinates and metrics carry their unit in `attrs`.

        Raises:
            ImportError: xarray is not installed (pip install 'agvjax[sweep]').
        """
        import xarray

        plan, shape = self.design, (*self.design.shape, self.design.samples)
        dims = (*(axis.targets[0].name for axis in plan.grid), "sample")
        data = {
            name: (("controller", *dims), values.reshape(-1, *shape), {"units": self.manifest.metrics[name]})
            for name, values in self.metrics.items()
        }
        data["ok"] = (("controller", *dims), self.ok.reshape(-1, *shape), {"units": "1"})
        coordinates: dict[str, Any] = {"controller": list(self.names)}
        for (
            axis
        ) in plan.grid:  # a dimension has the name of its first leaf; what moves with it are coordinates along it
            for target in axis.targets:
                values = plan.value(target, axis.places)
                dim, units = axis.targets[0].name, {"units": plan.unit(target.leaf)}
                if values.ndim > 1:  # of an array leaf all elements, and the first to go by
                    coordinates[f"{target.name}_values"] = ((dim, f"{target.name}_element"), values, units)
                coordinates[target.name] = (dim, values.reshape(len(values), -1)[:, 0], units)
        for leaf in dict.fromkeys(target.leaf for axis in plan.sampled for target in axis.targets):
            values = self.leaves[leaf][: plan.samples]  # the same at every node
            units = {"units": plan.unit(leaf)}
            if leaf in {target.leaf for axis in plan.grid for target in axis.targets}:  # but for elements on the grid
                own = [t for axis in plan.sampled for t in axis.targets if t.leaf == leaf]
                coordinates |= {t.name: ("sample", values[:, t.element], units) for t in own}
                continue
            extra = [f"{leaf}_element"] if values.ndim > 1 else []
            coordinates[leaf] = (("sample", *extra), values, units)
        about = {"seed": self.manifest.seed, "digest": self.manifest.digest, "config": self.manifest.config}
        return xarray.Dataset(data, coordinates, about)

    def to_netcdf(self, path: Path) -> None:
        """The Dataset as netCDF 4, whole or not at all."""
        whole = self.to_xarray()
        _replaced(path, lambda part: whole.to_netcdf(part, engine="h5netcdf"))

    def to_parquet(self, path: Path) -> None:
        """A table with a row for each scenario and controller; elements of arrays get columns of their own."""
        import pyarrow
        from pyarrow import parquet

        columns: dict[str, Any] = {"controller": np.repeat(self.names, self.design.size)}
        columns["index"] = np.tile(np.arange(self.design.size), len(self.names))
        for name, values in self.leaves.items():
            flat = values.reshape(self.design.size, -1)
            for i in range(flat.shape[1]):
                columns[name if values.ndim == 1 else f"{name}[{i}]"] = np.tile(flat[:, i], len(self.names))
        columns |= {name: values.ravel() for name, values in self.metrics.items()} | {"ok": self.ok.ravel()}
        units = json.dumps(self.manifest.leaves | self.manifest.metrics)
        table = pyarrow.table(columns).replace_schema_metadata({"units": units, "digest": self.manifest.digest})
        _replaced(path, lambda part: parquet.write_table(table, part))


def load(folder: str | Path, imports: Sequence[str] = ()) -> Results:
    """The results of a finished sweep.

    Args:
        folder: of the sweep.
        imports: the files of one's own classes with which it was made.

    Raises:
        ValueError: the folder holds no sweep, or shards of it are missing or damaged; the message names them.
    """
    folder = Path(folder)
    made = shards.read_manifest(folder)
    config = config_of(made, imports)
    return collect(folder, made, config, design(config))


def collect(folder: Path, made: Manifest, config: Config, plan: Design) -> Results:
    """The results in a folder whose sweep is known; raises as `load`."""
    missing, whole = [], {}
    for i in range(made.count):
        arrays, (first, count) = shards.read_shard(folder, made, i), made.span(i)
        if arrays is None:
            missing.append(i)
            continue
        for name, part in arrays.items():  # filled as they are read, so that a large sweep is held once
            axis = 1 if name.startswith("result/") else 0
            if name not in whole:
                whole[name] = np.empty((*part.shape[:axis], made.size, *part.shape[axis + 1 :]), part.dtype)
            whole[name][(slice(None),) * axis + (slice(first, first + count),)] = part
    if missing:
        shown = ", ".join(map(str, missing[:5])) + (", ..." if len(missing) > 5 else "")
        raise ValueError(f"{folder}: {len(missing)} of {made.count} shards are missing or damaged ({shown})")
    return Results(
        manifest=made,
        config=config,
        design=plan,
        ok=whole["result/ok"],
        metrics=_Metrics({name: whole[f"result/{name}"] for name in made.metrics}),
        leaves={name: whole[f"leaf/{name}"] for name in made.leaves},
    )


def _replaced(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a file, and put it in its place when it is whole."""
    part = path.with_name(f".{path.name}.part")
    try:
        write(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def config_of(made: Manifest, imports: Sequence[str] = ()) -> Config:
    """The configuration that a manifest holds."""
    return resolve(tomllib.loads(made.config), faults, imports)


def controller_of(made: Manifest, which: int, imports: Sequence[str] = ()) -> agvjax.Law:
    """One of its controllers."""
    return resolve(tomllib.loads(made.controllers[which]), imports=imports).controller
