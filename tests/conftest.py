"""How JAX runs under these tests: float64, no silent promotion, and compiled programs kept between sessions."""

import os
import tempfile
from pathlib import Path

import jax

KEPT = Path(tempfile.gettempdir()) / "agvjax-test-cache"
os.environ["XDG_CACHE_HOME"] = str(KEPT)  # of every command that a test runs
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_compilation_cache_dir", str(KEPT))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
