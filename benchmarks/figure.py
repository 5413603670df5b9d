"""The plots of the benchmarks that README and docs show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

NAMES = {"c": "C, hand-written", "plain": "plain vmapped scan", "numba": "numba", "diffrax": "diffrax"}
NAMES |= {"numpy": "NumPy over the batch", "scipy": "SciPy", "casadi": "CasADi"}


def draw(kept: dict[str, Any], path: Path) -> None:
    """Speed of every contestant at 1 and at 1024 scenarios, relative to `evaluate` in the same turns."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained", sharex=True)
    for axis, (batch, dtype) in zip(axes, ((1024, "float32"), (1, "float64")), strict=True):
        rows = [r for r in kept["rows"] if (r["batch"], r["dtype"], r["integrator"]) == (batch, dtype, "rk4")]
        rows = [r for r in rows if r["peer"] in NAMES]
        rows.sort(key=lambda r: -r["ratio"])
        shown = [(NAMES[r["peer"]], 1 / r["ratio"], r) for r in rows]
        shown.append(("agvjax evaluate", 1.0, None))
        shown.sort(key=lambda entry: entry[1])
        bars = axis.barh([s[0] for s in shown], [s[1] for s in shown], color="0.7")
        bars[[s[0] for s in shown].index("agvjax evaluate")].set_color("tab:blue")
        for i, (_, speed, row) in enumerate(shown):
            text = "1" if row is None else f"{speed:.2g}"
            axis.text(speed * 1.1, i, text, va="center", fontsize=9)
        axis.set_xscale("log")
        axis.set_title(f"{batch} scenario{'s' if batch > 1 else ''}, {dtype}, one core", fontsize=10)
        axis.spines[["top", "right"]].set_visible(False)
    low, high = axes[0].get_xlim()
    axes[0].set_xlim(low, high * 2)
    _keep(figure, path, "speed relative to evaluate, same loop and accuracy, taking turns ", kept["machine"])


METHODS = {
    "sqp": "agvjax, sqp",
    "adam": "agvjax, Adam",
    "cma": "CMA-ES",
    "tpe": "Optuna TPE",
    "random": "random search",
}
METHODS |= {"nelder-mead": "SciPy Nelder-Mead", "l-bfgs-b": "SciPy L-BFGS-B, differences"}


def draw_tuning(kept: dict[str, Any], path: Path) -> None:
    """Cost above the best that any method found, against rollouts and seconds: median and range of the starts."""
    import matplotlib.pyplot as plt
    import numpy as np

    figure, axes = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained", sharey=True)
    best = kept["rows"][0]["best_of_all"]
    for k, row in enumerate(kept["rows"]):
        for axis, column in zip(axes, (0, 1), strict=True):
            curves = [np.array(curve) for curve in row["curves"]]
            grid = np.geomspace(min(c[0, column] for c in curves), max(c[-1, column] for c in curves), 200)
            levels = np.array([_stairs(curve[:, column], curve[:, 2], grid) for curve in curves]) / best - 1
            middle = np.median(levels, axis=0)
            axis.loglog(grid, np.maximum(middle, 1e-5), color=f"C{k}", label=METHODS[row["method"]])
            low, high = (np.maximum(edge(axis=0), 1e-5) for edge in (levels.min, levels.max))
            axis.fill_between(grid, low, high, color=f"C{k}", alpha=0.12)
    for axis, name in zip(axes, ("rollouts of the ensemble", "seconds of one core"), strict=True):
        axis.axhline(0.01, color="0.6", lw=0.8, ls="--")
        axis.set(xlabel=name, ylim=(5e-5, 10))
        axis.grid(alpha=0.3, which="both")
    axes[0].set_ylabel("cost above the best found")
    axes[1].legend(fontsize=8)
    _keep(figure, path, f"default problem, {len(kept['rows'][0]['curves'])} starts", kept["machine"])


def _keep(figure: Any, path: Path, text: str, facts: dict[str, Any]) -> None:
    """Say what was measured where, and write the picture."""
    import matplotlib.pyplot as plt

    where = f"{facts['processor']}, jaxlib {facts['versions']['jaxlib']}, {facts['date']}"
    figure.supxlabel(f"{text} ({where})", fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _stairs(x: Any, y: Any, grid: Any) -> Any:
    """The last y up to each place of the grid; before the first, the first."""
    import numpy as np

    return np.asarray(y)[np.maximum(np.searchsorted(x, grid, side="right") - 1, 0)]
