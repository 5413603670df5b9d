"""The plot of the rollout benchmark that the README shows."""

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
    facts = kept["machine"]
    figure.supxlabel(
        f"speed relative to evaluate, same loop and accuracy, taking turns"
        f"  ({facts['processor']}, jaxlib {facts['versions']['jaxlib']}, {facts['date']})",
        fontsize=8,
    )
    figure.savefig(path, dpi=110)
    plt.close(figure)
