"""What the host can see of a call before JAX traces it; afterwards a number has no value any more."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np

F = TypeVar("F", bound=Callable[..., object])
JITTED = ("lower", "trace", "eval_shape", "clear_cache", "_cache_size")  # what a jitted function can do besides


def looked_at(function: F) -> F:
    """A jitted function of law, scenario and `dt` that first refuses what cannot be meant; tracers pass.

    Raises:
        ValueError: `dt` is a number and not above 0.
        TypeError: a string where the law or the scenario needs an object.
    """

    @functools.wraps(function)
    def called(*arguments: object, **options: object) -> object:
        dt = options.get("dt")
        if isinstance(dt, (int, float, np.number)) and not 0 < dt < np.inf:
            raise ValueError(f"dt must be finite and > 0 s; got {dt}")
        for name, tree in zip(("controller", "scenario"), arguments, strict=False):
            if not dataclasses.is_dataclass(tree) or isinstance(tree, type):
                continue
            for field in dataclasses.fields(tree):
                value = vars(tree)[field.name]
                if isinstance(value, str) and not field.metadata.get("static"):
                    rule = "names are for TOML; in Python it is an object, such as agvjax.Circle() for a path"
                    raise TypeError(f"{name}.{field.name} = {value!r}: {rule}")
        return function(*arguments, **options)

    for name in JITTED:
        setattr(called, name, getattr(function, name))
    return cast(F, called)
