"""`agvjax tune --params nav2_params.yaml`: a Nav2 parameter file as where the tuning starts, and the tuned one."""

from __future__ import annotations

import argparse
from pathlib import Path

import agvjax
from agvjax import Fault, InputError

from ..config import Config
from ..config.codecs import Toml
from ..io import files, nav2

TUNED = "nav2_params.tuned.yaml"
NOT_DRIVEN = "The simulated law has no such manoeuvre: unchanged."


class ParameterFile:
    """What a file says, as settings; and where the tuned gains go."""

    def __init__(self, found: nav2.Parameters):
        self.found = found
        self.values = {name: value for name, value in found.values.items() if name in nav2.SIMULATED}
        left = {name: NOT_DRIVEN for name in found.values if name not in self.values}
        self.left = found.ignored | left | dict.fromkeys(found.unknown, "Nav2 has no parameter of that name.")

    @classmethod
    def given(cls, arguments: argparse.Namespace) -> ParameterFile | None:
        """Of the option `--params`, if it is given.

        Raises:
            InputError: the file, its section, or options that do not go together.
        """
        if arguments.params is None:
            if arguments.controller is not None:
                raise InputError([Fault("--controller", arguments.controller, "used only with --params")])
            return None
        try:
            return cls(nav2.read(arguments.params, arguments.controller))
        except InputError as error:
            named = {"controller": "--controller"}
            raise InputError([f._replace(key=named.get(f.key, f.key)) for f in error.faults]) from None

    def settings(self) -> dict[str, Toml]:
        """By dotted key; the law and its clock are the file's."""
        law = {"type": "regulated_pure_pursuit"} | self.values
        return {"controller.inner": law, "controller.period": self.found.period}

    def lines(self) -> list[str]:
        """What a person should know of it."""
        where = f"{self.found.file}: {self.found.controller}, every {self.found.period:g} s"
        said = [f"{where}; {len(self.values)} parameters of the law read", *self.found.remarks]
        return said + [f"{name}: {why}" for name, why in self.left.items()]

    def write(self, tuned: agvjax.Law, config: Config, out: Path) -> str:
        """The tuned file beside the others; returns what the report says of it."""
        leaves, prefix = agvjax.leaves(tuned), "inner."
        names = [
            n.removeprefix(prefix) for n in (*(config.tune.gains or ()), *config.tune.tied) if n.startswith(prefix)
        ]
        least, before = "min_lookahead_dist", agvjax.leaves(config.controller)
        if float(leaves[prefix + least]) < (1 - 1e-6) * float(before[prefix + least]):
            names.append(least)  # it was above the largest: `RegulatedPurePursuit.canonical`
        values = {name: float(leaves[prefix + name]) for name in names}
        text = nav2.write(self.found.text, values, self.found.controller)
        files.write(out / TUNED, text)
        changed = nav2.diff(self.found.text, text, Path(self.found.file).name)
        left = "\n".join(f"* `{name}`: {why}" for name, why in self.left.items())
        listed = f"\nNot simulated, and unchanged:\n\n{left}\n" if left else ""
        return f"\n## The parameter file\n\nIn `{TUNED}`, all else unchanged:\n\n```diff\n{changed}```\n{listed}"
