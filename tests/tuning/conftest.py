"""What tests of the tools share."""

import jax
import pytest


@pytest.fixture(scope="module")
def promotion_as_optax_has_it():
    """Optax mixes float64 and int32, and the objective ranks, which the rules of `tests/conftest.py` forbid."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield
