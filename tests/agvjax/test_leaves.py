"""Names of leaves, and structures that JAX can tell apart."""

import dataclasses

import jax
import numpy as np
import pytest

import agvjax
from agvjax import Bearing, NeuroBackstepping, Scenario, Tangent, TurnedVelocity, leaves, replace
from agvjax.readings import ForwardSpeed, KinematicYawRate


def test_dotted_names_reach_every_leaf():
    names = leaves(Scenario())
    assert names["deadzone.position.threshold_right"] == 0.5 and names["plant.L"] == 0.5 and "sensor" not in names
    new = replace(Scenario(), {"deadzone.position.threshold_right": 0.7, "limit": 5.0})
    changed = {name for name, value in leaves(new).items() if np.any(value != names[name])}
    assert changed == {"deadzone.position.threshold_right", "limit"}
    assert leaves(Scenario())["limit"] == 1e3
    with pytest.raises(KeyError, match="did you mean Lam_psi or Lam"):
        replace(NeuroBackstepping(), {"Lam_ps": 1.0})


def test_no_two_classes_have_the_same_structure():
    """Else `jit` may run on one what was compiled for the other: empty choices of a form differ in their type alone."""
    classes = {
        c
        for c in (*vars(agvjax).values(), *vars(agvjax.readings).values())
        if isinstance(c, type) and hasattr(c, "__dataclass_fields__")
    }
    empty = [c for c in classes if not jax.tree.leaves(made(c))]
    assert {KinematicYawRate, ForwardSpeed, TurnedVelocity, Bearing, Tangent} <= set(empty)
    structures = [jax.tree.structure(made(c)) for c in classes]
    assert len(structures) > 20
    assert all(a != b for i, a in enumerate(structures) for b in structures[:i])


def made(kind):
    """An object of a class, its fields without default filled with nothing."""
    fields = kind.__dataclass_fields__.values()
    missing = [f.name for f in fields if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING]
    return kind(**dict.fromkeys(missing, ()))
