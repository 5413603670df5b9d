"""How JAX runs under these tests: float64, no silent promotion, and compiled programs kept between sessions."""

import tempfile
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_compilation_cache_dir", str(Path(tempfile.gettempdir()) / "agvjax-test-cache"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
