"""C of our own, `c_loop.c`: as many scenarios at a time as a vector register holds."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from . import constants

SOURCE = Path(__file__).with_name("c_loop.c")
FLAGS = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
FLAGS += ["-mprefer-vector-width=512"]  # some processors default to half their registers
FLAGS += ["-nostartfiles"]  # with -ffast-math they would make the whole process flush subnormal numbers to zero
DEGREE = {"float32": 6, "float64": 11}  # of the polynomial for 2^r, |r| <= 1/2: below the rounding error


def contestant(
    values: Mapping[str, np.ndarray], *, dt: float, n_steps: int, dtype: str, scalar: bool = False
) -> Callable[[], np.ndarray]:
    """RK4; `scalar` builds for one scenario at a time, the yardstick of a single one."""
    library = _build(dtype, scalar)
    start, parameters = constants.start(values).astype(dtype), constants.parameters(values).astype(dtype)
    signals = constants.tabulate(dt, n_steps, dtype)
    total, final = np.empty(len(start), dtype), np.empty_like(start)
    # the final state is kept, else the compensator, which drives nothing, would be optimised away
    arrays = start, parameters, signals, total, final

    def run() -> np.ndarray:
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        library.batch(ctypes.c_long(len(start)), ctypes.c_long(n_steps), ctypes.c_double(dt), *pointers)
        return np.sqrt(total / n_steps)

    return run


def _build(dtype: str, scalar: bool) -> ctypes.CDLL:
    """Compile and load."""
    compiler = shutil.which("gcc")
    if compiler is None:
        raise RuntimeError("the C peer needs gcc on the PATH")
    single = dtype == "float32"
    powers = Chebyshev.interpolate(np.exp2, DEGREE[dtype], (-0.5, 0.5)).convert(kind=Polynomial).coef
    gains = {name: value for name, value in vars(constants).items() if isinstance(value, float) and name.isupper()}
    macros = gains | {
        "REAL": "float" if single else "double",
        "INTEGER": "int" if single else "long long",
        "EXP2": ",".join(map(repr, powers.tolist()[::-1])),
        "CENTERS": ",".join(map(repr, constants.CENTERS)),
        "STEEPNESS": -2 / constants.WIDTH * math.log2(math.e),
        "TURN": 2 * math.pi,
    }
    flags = [*FLAGS, *(f"-D{name}={value}" for name, value in macros.items())]
    flags += ["-fsingle-precision-constant"] * single + ["-DSCALAR"] * scalar
    with tempfile.TemporaryDirectory() as folder:  # a loaded library needs its file no more
        target = Path(folder) / "c_loop.so"
        done = subprocess.run(
            [compiler, *flags, SOURCE, "-o", target, "-lm"], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(f"gcc could not build {SOURCE.name}:\n{done.stderr}")
        return ctypes.CDLL(str(target))
