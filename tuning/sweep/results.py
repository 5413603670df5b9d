"""The results of a sweep, as NumPy arrays; and as an xarray Dataset where xarray is installed."""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agvjax.metric_table import OLD_NAMES
from agvjax.protocols import Law

from ..config.load import resolve
from ..config.settings import Config
from . import shards
from .design import Design, design, targets_of
from .laws import law_of
from .rules import faults
from .shards import Manifest

if TYPE_CHECKING:
    import xarray


class _Metrics(dict[str, np.ndarray]):
    """Metrics by name; an old name is known and said to be old."""

    def __missing__(self, name: str) -> np.ndarray:
        new = OLD_NAMES.get(name, name)
        if new == name or new not in self:
            raise KeyError(name)
        warnings.warn(f"metric {name!r} is now {new!r}", DeprecationWarning, stacklevel=2)
        return self[new]


class Results(NamedTuple):
    """A finished sweep: C controllers, N scenarios in the order of their numbers."""

    manifest: Manifest
    config: Config  # without `sweep.fails`, which may change afterwards
    design: Design
    ok: np.ndarray  # (C, N)
    metrics: dict[str, np.ndarray]  # (C, N); infinite where a run diverged; settling times also where it did not settle
    leaves: dict[str, np.ndarray]  # (N, ...), what varied

    @property
    def names(self) -> tuple[str, ...]:
        """Of the controllers."""
        return self.manifest.names

    def grid(self, metric: str) -> np.ndarray:
        """A metric by controller, place in the grid, and sample: (C, *shape, samples)."""
        return self.design.whole(self.metrics[metric])

    def to_xarray(self) -> xarray.Dataset:
        """An `xarray.Dataset` with named dimensions; coordinates and metrics carry their unit in `attrs`.

        Raises:
            ImportError: xarray is not installed (pip install 'agvjax[sweep]').
        """
        import xarray

        plan = self.design
        dims = (*(axis.targets[0].name for axis in plan.grid), "sample")
        data = {
            name: (("controller", *dims), plan.whole(values), {"units": self.manifest.metrics[name]})
            for name, values in self.metrics.items()
        }
        data["ok"] = (("controller", *dims), plan.whole(self.ok), {"units": "1"})
        coordinates: dict[str, Any] = {"controller": list(self.names)}
        # a dimension has the name of its first leaf; what moves with it are coordinates along it
        for axis, target in targets_of(plan.grid):
            values = plan.value(target, axis.places)
            dim, units = axis.targets[0].name, {"units": plan.unit(target.leaf)}
            if values.ndim > 1:  # of an array leaf all elements, and the first to go by
                coordinates[f"{target.name}_values"] = ((dim, f"{target.name}_element"), values, units)
            coordinates[target.name] = (dim, values.reshape(len(values), -1)[:, 0], units)
        on_grid = {target.leaf for _, target in targets_of(plan.grid)}
        for _, target in targets_of(plan.sampled):
            values, units = self.leaves[target.leaf][: plan.samples], {"units": plan.unit(target.leaf)}
            if target.leaf in on_grid:  # with another element: this one alone is the same at every node
                coordinates[target.name] = ("sample", values[:, target.element], units)
            else:
                coordinates[target.leaf] = (("sample", f"{target.leaf}_element")[: values.ndim], values, units)
        about = {"seed": self.manifest.seed, "digest": self.manifest.digest, "config": self.manifest.config}
        return xarray.Dataset(data, coordinates, about)


def load(folder: str | Path, imports: Sequence[str] = ()) -> Results:
    """The results of a finished sweep.

    Args:
        folder: of the sweep.
        imports: files of the classes of one's own that it names; they are executed.

    Raises:
        ValueError: the folder holds no whole manifest, or shards of it are missing or damaged; the message names them.
    """
    folder = Path(folder)
    manifest = shards.read_manifest(folder)
    config = config_of(manifest, imports)
    return collect(folder, manifest, config, plan_of(manifest, config))


def collect(folder: Path, manifest: Manifest, config: Config, plan: Design) -> Results:
    """The results in a folder whose sweep is known; raises as `load`."""
    missing, whole, shapes = [], {}, plan.leaf_shapes
    for i in range(manifest.shards):
        arrays, (first, count) = shards.read_shard(folder, manifest, i, shapes), manifest.span(i)
        if arrays is None:
            missing.append(i)
            continue
        for name, part in arrays.items():  # filled as they are read, so that a large sweep is held once
            axis = 1 if name.startswith("result/") else 0
            if name not in whole:
                whole[name] = np.empty((*part.shape[:axis], manifest.size, *part.shape[axis + 1 :]), part.dtype)
            whole[name][(slice(None),) * axis + (slice(first, first + count),)] = part
    if missing:
        shown = ", ".join(map(str, missing[:5])) + (", ..." if len(missing) > 5 else "")
        raise ValueError(f"{folder}: {len(missing)} of {manifest.shards} shards are missing or damaged ({shown})")
    return Results(
        manifest=manifest,
        config=config,
        design=plan,
        ok=whole["result/ok"],
        metrics=_Metrics({name: whole[f"result/{name}"] for name in manifest.metrics}),
        leaves={name: whole[f"leaf/{name}"] for name in manifest.leaves},
    )


def plan_of(manifest: Manifest, config: Config) -> Design:
    """The scenarios of a manifest whose configuration is `config`.

    Raises:
        ValueError: size or leaves of the manifest are not those of the configuration.
    """
    plan = design(config)
    if manifest.size != plan.size or set(manifest.leaves) != set(plan.names):
        raise ValueError(f"{shards.MANIFEST}: its size or leaves are not those of its own configuration: damaged")
    return plan


def config_of(manifest: Manifest, imports: Sequence[str] = ()) -> Config:
    """The configuration that a manifest holds."""
    return resolve(tomllib.loads(manifest.config), faults, imports)


def controller_of(manifest: Manifest, which: int, imports: Sequence[str] = ()) -> Law:
    """One of its controllers."""
    return law_of(tomllib.loads(manifest.controllers[which]), tomllib.loads(manifest.config), imports)
