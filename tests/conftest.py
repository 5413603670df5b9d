"""How JAX runs under these tests: float64, no silent promotion, and compiled programs kept between sessions."""

import os
import tempfile
from importlib.metadata import version
from pathlib import Path

import jax
import pytest

os.environ["AGVJAX_XLA"] = "0"  # tests that want compiler options set them, in a process of their own
KEPT = Path(tempfile.gettempdir()) / "agvjax-test-cache"
os.environ["XDG_CACHE_HOME"] = str(KEPT)  # of every command that a test runs
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_compilation_cache_dir", str(KEPT))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)

PLAIN = "--xla_cpu_use_fusion_emitters=false"  # the compiler's older and quicker way; known to jaxlib 0.8 to 0.10
OLDER = (0, 8) <= tuple(map(int, version("jaxlib").split(".")[:2])) <= (0, 10)


def pytest_configure(config):
    """Quick tests mostly wait for the compiler: it optimises little. Those of `make slow` are compiled as ever."""
    if config.option.markexpr != "not slow" or "XLA_FLAGS" in os.environ:
        return
    if OLDER:
        os.environ["XLA_FLAGS"] = PLAIN
    jax.config.update("jax_disable_most_optimizations", True)


MAPS = Path("/proc/self/maps")
MANY = 8_000  # pieces of memory; Linux lets a process have 65 530, and Python slows down long before


@pytest.fixture(scope="module", autouse=True)
def _compiled_programs_are_let_go():
    """Those of all tests together are more than a process may hold, and each of them makes Python collect longer."""
    yield
    if MAPS.exists() and len(MAPS.read_bytes().splitlines()) > MANY:
        jax.clear_caches()
