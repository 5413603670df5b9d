"""The controllers of a sweep: the configured one, and others by a file of gains or by the name of a law."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import agvjax
from agvjax import Fault, InputError
from agvjax.protocols import Law

from ..config.codecs import Toml
from ..config.ends import LAW
from ..config.load import parsed, resolve
from ..config.settings import Config
from ..config.write import table_of
from .rules import faults

CONFIGURED = "configured"  # name of the law of the configuration
Laws = dict[str, Law]  # by name, the configured one first


def law_of(table: Mapping[str, Toml], around: Mapping[str, Toml], imports: Sequence[str] = ()) -> Law:
    """The law of a table of TOML, for the vehicle and the timing of the sweep's own table `around` it."""
    law = {key: table[key] for key in ("version", "controller", "imports") if key in table}
    rest = {key: around[key] for key in ("scenario", "simulate") if key in around}
    return resolve(rest | law, lambda config: [], imports).controller


def named(config: Config, imports: Sequence[str] = ()) -> Laws:
    """The configured controller and those of `sweep.controllers`; a gain that is swept is the same in all of them.

    Args:
        config: of the sweep.
        imports: files of classes of one's own that the controllers may be of.

    Raises:
        agvjax.InputError: a name means no law, is there twice, or its law does not suit the sweep.
    """
    laws: Laws = {CONFIGURED: config.controller}
    swept = {name.removeprefix(LAW) for table in config.sweep.over for name in table if name.startswith(LAW)}
    gains = {gain: agvjax.leaves(config.controller)[gain] for gain in swept}
    for name in config.sweep.controllers:
        label = str(Path(name).with_suffix("")) if Path(name).suffix == ".toml" else name
        law = _read(name, config, imports)
        if missing := swept - set(agvjax.leaves(law)):
            raise _wrong(name, f"a law that has the swept gains {', '.join(sorted(missing))}")
        if label in laws:
            raise _wrong(name, "named once")
        laws[label] = law = agvjax.replace(law, gains)
        if wrong := faults(dataclasses.replace(config, controller=law)):
            raise InputError([fault._replace(key=f"{fault.key}, with {name}") for fault in wrong])
    return laws


def _read(name: str, config: Config, imports: Sequence[str]) -> Law:
    """The law that a name means, what is wrong with it said of the name."""
    try:
        table = parsed(name) if Path(name).suffix == ".toml" else {"controller": name}
        return law_of(table, table_of(config)[0], imports)
    except InputError as error:
        wrong = "; ".join(map(str, error.faults))
        raise _wrong(name, f"a file of gains or the name of a law ({wrong})") from error


def _wrong(name: str, rule: str) -> InputError:
    return InputError([Fault("sweep.controllers", name, rule)])
