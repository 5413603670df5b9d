"""`make compilers`: the same rollouts, gradients and a short search on several releases of jaxlib and of Python.

The oldest release that the project declares, the one installed here, and the newest that pip finds, for this Python and
for the newest on this machine; each in an environment of its own below build/compilers, with the compiler options and
without. Results must agree; what each release makes of the options stands in a table, and in results/compilers.json.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
HOME = ROOT / "build" / "compilers"
PYTHONS = [f"python3.{minor}" for minor in range(20, 11, -1)]  # newer than the oldest that is declared, newest first
AGREE = {"rollouts": 1e-9, "gradient": 1e-6, "search": 1e-4}  # largest relative difference, in float64
PROGRAM = """
import json, sys, time
import agvjax
said = agvjax.tune_xla(devices=1) if {on} else "left alone"
import jax, jaxlib, numpy as np
jax.config.update("jax_enable_x64", True)
import tuning
from tuning.config.settings import Ensemble, Limit, Search, Simulate, Tune
from tuning.tune.rounds import solve
law = agvjax.NeuroBackstepping()
many = agvjax.batch(agvjax.Scenario(), {{"disturbance.amplitude": np.linspace(0.0, 0.4, 64)}})
gains = {{name: float(agvjax.leaves(law)[name]) for name in ("k1", "k2", "k3", "Lam", "Lam_psi")}}
def errors(gains):
    return agvjax.evaluate(agvjax.replace(law, gains), many, dt=5e-3, n_steps=1200).total_rmse
def best(function):
    compiled, times = jax.jit(function), []
    value = jax.block_until_ready(compiled(gains))
    for _ in range(5):
        begin = time.perf_counter()
        jax.block_until_ready(compiled(gains))
        times.append(time.perf_counter() - begin)
    return value, 1e3 * min(times)
rollouts, evaluate_ms = best(errors)
slopes, gradient_ms = best(jax.jacfwd(lambda gains: errors(gains).mean()))
small = Search(scouts=8, starts=1, iterations=1, checks=0)
found = solve(tuning.pose(tuning.Config(
    simulate=Simulate(horizon=2.0, dt=0.005), ensemble=Ensemble(size=8, validation_size=4),
    tune=Tune(
        dt=0.01, gains=("k1", "k3"), limits={{"effort": Limit(mean=1.1)}}, iterations=4, screen=0, search=small,
    ),
)))
print(json.dumps(dict(
    said=said, python=sys.version.split()[0], jax=jax.__version__, jaxlib=jaxlib.__version__,
    evaluate_ms=evaluate_ms, gradient_ms=gradient_ms, rollouts=np.asarray(rollouts).tolist(),
    gradient=[float(x) for x in slopes.values()],
    search=np.nan_to_num(np.array(found.run.history, float)).ravel().tolist(),  # all that it looked at
)))
"""


def main() -> None:
    """Build what is missing, run everything, print the table; exit code 1 where results differ."""
    found: list[dict[str, Any]] = []
    for name, python, asked in wanted():
        release = prepared(name, python, asked)
        if release not in [one["release"] for one in found]:  # the newest may be the one installed
            found += [{"release": release} | one for one in both(name)]
    lines, wrong = table(found)
    print("\n".join(lines))
    kept = [{key: value for key, value in one.items() if key not in AGREE} for one in found]
    (ROOT / "benchmarks" / "results" / "compilers.json").write_text(json.dumps(kept, indent=1) + "\n")
    sys.exit(1 if wrong else 0)


def wanted() -> list[tuple[str, str, list[str]]]:
    """Environments: name, Python, and what pip is asked for besides the project."""
    oldest = re.search(r'"jaxlib>=([\d.]+)', (ROOT / "pyproject.toml").read_text())
    assert oldest is not None
    here = sys.executable
    asked = [(f"oldest-{oldest[1]}", here, _exactly(oldest[1])), ("installed", here, _exactly(version("jaxlib")))]
    asked.append(("newest", here, ["--upgrade", "jax", "jaxlib"]))
    if newer := next(filter(_runs, PYTHONS), None):
        asked.append((f"newest-{newer}", newer, ["--upgrade", "jax", "jaxlib"]))
    return asked


def _runs(python: str) -> bool:
    """Whether there is such a Python, and not only a name that stands for it."""
    path = shutil.which(python)
    return path is not None and subprocess.run([path, "--version"], capture_output=True).returncode == 0


def _exactly(release: str) -> list[str]:
    return [f"jax=={release}", f"jaxlib=={release}"]


def prepared(name: str, python: str, asked: list[str]) -> str:
    """Its environment made; returns which Python and jaxlib it has."""
    folder = HOME / name
    interpreter = folder / "bin" / "python"
    if not interpreter.exists():
        subprocess.run([python, "-m", "venv", folder], check=True)
    print(f"{name}: {' '.join(asked)}", file=sys.stderr, flush=True)
    pip = [interpreter, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-compile"]
    subprocess.run([*pip, *asked, ROOT], check=True)
    which = "import platform, jaxlib; print(platform.python_version(), jaxlib.__version__)"
    return subprocess.run([interpreter, "-c", which], check=True, capture_output=True, text=True).stdout.strip()


def both(name: str) -> list[dict[str, Any]]:
    """What a release finds with the options and without."""
    interpreter = HOME / name / "bin" / "python"
    own = {key: value for key, value in os.environ.items() if key not in ("XLA_FLAGS", "PYTHONPATH")}
    found = []
    for on in (True, False):
        done = subprocess.run(
            [interpreter, "-c", PROGRAM.format(on=on)],
            env=own | {"AGVJAX_XLA": "0", "JAX_PLATFORMS": "cpu"}, cwd=HOME, capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            raise SystemExit(f"{name}, options {'on' if on else 'off'}:\n{done.stderr[-2000:]}")
        found.append({"name": name, "options": on} | json.loads(done.stdout.splitlines()[-1]))
    return found


def difference(ours: list[float], theirs: list[float]) -> float:
    """The largest difference, relative to the largest number; infinite where one has more numbers."""
    if len(ours) != len(theirs):
        return float("inf")
    size = max(map(abs, theirs))
    return max(abs(a - b) for a, b in zip(ours, theirs, strict=True)) / (size or 1.0)


def table(found: list[dict[str, Any]]) -> tuple[list[str], list[str]]:
    """Lines of Markdown, and what differs from the first row by more than it may."""
    columns = ("name", "python", "jaxlib", "options", "evaluate_ms", "gradient_ms", *AGREE, "said")
    lines, wrong = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)], []
    for one in found:
        apart = {key: difference(one[key], found[0][key]) for key in AGREE}
        wrong += [f"{one['name']}: {key}" for key, most in AGREE.items() if not apart[key] <= most]
        shown = one | {key: f"{x:.1e}" for key, x in apart.items()} | {"options": "on" if one["options"] else "off"}
        shown |= {key: f"{one[key]:.3g}" for key in ("evaluate_ms", "gradient_ms")}
        lines.append(f"| {' | '.join(str(shown[column]) for column in columns)} |")
    return lines + [f"differs: {one}" for one in wrong], wrong


if __name__ == "__main__":
    main()
