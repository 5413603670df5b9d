"""What tests of the tools share."""

import jax
import pytest


@pytest.fixture(scope="module")
def promotion_as_optax_has_it():
    """Optax mixes float64 and int32, and the objective ranks, which the rules of `tests/conftest.py` forbid.

    Not by contexts, which hold in one thread: commands compile in others.
    """
    rules = {"jax_numpy_dtype_promotion": "standard", "jax_numpy_rank_promotion": "allow"}
    before = {name: getattr(jax.config, name) for name in rules}
    for name, value in rules.items():
        jax.config.update(name, value)
    yield
    for name, value in before.items():
        jax.config.update(name, value)
