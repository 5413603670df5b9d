"""The methods of tuning, one a file: `sqp`, `cma`, and every optimiser of optax by its name."""

from .method import Method as Method


def method(optimizer: str) -> type[Method]:
    """The method that `tune.optimizer` names; a name that nobody knows is one of optax's, whose faults say so."""
    if optimizer == "sqp":
        from .sqp import Sqp

        return Sqp
    if optimizer == "cma":
        from .cma import Cma

        return Cma
    from .optax import Optax  # late: nobody waits for optax who does not use it

    return Optax
