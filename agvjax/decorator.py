"""`agvjax.pytree`: the decorator for classes outside the package, also for those that name no base class."""

from __future__ import annotations

import dataclasses
import inspect
import warnings
from collections.abc import Callable
from typing import Any, TypeVar, dataclass_transform

from . import _pytree, protocols

T = TypeVar("T")
CONTRACTS = (
    protocols.Law,
    protocols.Plant,
    protocols.Path,
    protocols.Heading,
    protocols.Disturbance,
    protocols.Element,
    protocols.Sensor,
)
BY_METHOD = {"law": (protocols.Law,), "allocate": (protocols.Plant,), "deliver": (protocols.Element,)}
BY_ARGUMENTS = {  # of `__call__`
    ("t",): (protocols.Path, protocols.Disturbance),
    ("u",): (protocols.Element,),
    ("path", "t"): (protocols.Heading,),
    ("held", "measurement"): (protocols.Sensor,),
}


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(dataclasses.field,))
def pytree(cls: type[T]) -> type[T]:
    """Make a class a frozen keyword-only dataclass that JAX treats as a tree of its fields.

    A law, plant, path, heading, disturbance, element or sensor derives from the base class of that name. One that does
    not is given it by the names of its methods and arguments, with a DeprecationWarning.
    """
    bases = () if issubclass(cls, CONTRACTS) else _bases(cls)
    if not bases:
        return _pytree.pytree(cls)
    names = " or ".join(f"class {cls.__name__}(agvjax.{base.__name__})" for base in bases)
    warnings.warn(f"{cls.__name__} needs a base class: {names}", DeprecationWarning, stacklevel=2)
    about: dict[str, Any] = {"__module__": cls.__module__, "__qualname__": cls.__qualname__, "__doc__": cls.__doc__}
    made: Any = type(cls.__name__, (_pytree.pytree(cls), *bases), about | _renamed(cls))
    return _pytree.pytree(made)


def _bases(cls: type) -> tuple[type, ...]:
    for method, bases in BY_METHOD.items():
        if hasattr(cls, method):
            return bases
    call = vars(cls).get("__call__")
    return BY_ARGUMENTS.get(tuple(inspect.signature(call).parameters)[1:], ()) if call else ()


def _renamed(cls: type) -> dict[str, Any]:
    """What had another name or other arguments before there were base classes."""
    old: dict[str, Callable[[Any], dict[str, Any]]] = {
        "of_heading": lambda names: {"heading_gains": names},
        "step": lambda step: {"advance": step},
        "relieved": lambda _: {"relieves": True},
        "period": lambda _: {"control_period": lambda self: self.period},
        "L": lambda _: {"lever": lambda self: self.L},
        "needs": lambda needs: {"needs": lambda self, motion: needs(self, *motion[:4])},
    }
    if not hasattr(cls, "law"):
        old["limited"] = lambda limited: {"limited": lambda self, flow, memory, u: limited(self, u)}
    defined = vars(cls) | {name: None for name in cls.__annotations__}
    return {new: x for name, of in old.items() if name in defined for new, x in of(defined[name]).items()}
