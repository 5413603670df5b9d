"""`python -m benchmarks [PART ...]`: measure, print, keep in benchmarks/results/."""

from __future__ import annotations

import argparse
import datetime
import importlib.metadata
import json
import multiprocessing
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

from agvjax import InputError

from . import (
    accuracy,
    certify,
    days,
    drives,
    explore,
    figure,
    following,
    gradient,
    history,
    inside,
    problems,
    python,
    rollout,
    sampled,
    startup,
    sweep,
    tuning,
    wheels,
)

RESULTS = Path(__file__).parent / "results"
PARTS: dict[str, Callable[[int], list[dict[str, Any]]]] = {
    "rollout": rollout.measure,
    "following": following.measure,
    "cores": rollout.measure_cores,
    "gradient": gradient.measure,
    "memory": lambda turns: gradient.measure_memory(),
    "startup": startup.measure,
    "python": python.measure,
    "accuracy": lambda turns: _alone(accuracy.measure),
    "tuning": tuning.measure,
    "sampled": sampled.measure,
    "problems": lambda turns: problems.measure(),
    "sweep": sweep.measure,
    "explore": explore.measure,
    "drives": lambda turns: drives.measure(),
    "days": lambda turns: days.measure(),
    "wheels": lambda turns: wheels.measure(),
    "certify": lambda turns: _alone(certify.measure),
    "inside": lambda turns: _alone(certify.measure_inside),
}
DRIFTING = {"days": days.measure, "wheels": wheels.measure}
LIBRARIES = ("jax", "jaxlib", "numpy", "numba", "scipy", "diffrax", "casadi", "cma", "optuna", "clarabel", "bokeh")


def main() -> None:
    """Run the parts asked for; each is kept beside what earlier runs on this machine found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"default: all of {', '.join(PARTS)}")
    parser.add_argument("--turns", type=int, default=9, help="runs of each contestant")
    parser.add_argument("--seeds", type=count, default=1, help="of our searches on a problem")
    parser.add_argument("--most", type=count, default=problems.MOST, help="rollouts of CMA-ES on a problem")
    parser.add_argument("--only", nargs="+", choices=list(problems.POSED), metavar="PROBLEM", help="default: all")
    parser.add_argument("--scheduler", metavar="WHERE", help="workers that share the problems, as of `agvjax sweep`")
    parser.add_argument("--days", type=int, default=days.DAYS, help="that a robot drifts, of days and wheels")
    parser.add_argument("--samples", type=int, default=inside.SAMPLES, help="runs inside what is proved")
    parser.add_argument("--hours", type=float, default=float("inf"), help="after which days, wheels and inside end")
    given = parser.parse_args()
    PARTS["problems"] = lambda turns: _beside_others(
        problems.measure(given.seeds, given.most, given.only or (), given.scheduler),
        f"{given.seeds} seeds, {given.most} rollouts of CMA-ES",
    )
    PARTS["inside"] = lambda turns: _alone(certify.measure_inside, given.samples, given.hours)
    PARTS.update({name: lambda turns, m=m: m(given.days, given.hours) for name, m in DRIFTING.items()})
    if unknown := set(given.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    RESULTS.mkdir(exist_ok=True)
    for name in given.parts or PARTS:
        try:
            rows = PARTS[name](given.turns)
        except InputError as error:
            parser.error(str(error))
        kept = {"part": name, "machine": machine(), "rows": rows}
        (RESULTS / f"{name}.json").write_text(json.dumps(kept, indent=1) + "\n")
        (RESULTS / f"{name}.md").write_text(table(kept))
        print(table(kept))
        row = history.kept(kept, history.commit())
        print(history.change(row, history.append(row)))
    for name, draw in (("rollout", figure.draw), ("tuning", figure.draw_tuning)):
        if (RESULTS / f"{name}.json").exists():
            draw(json.loads((RESULTS / f"{name}.json").read_text()), RESULTS / f"{name}.png")


def count(text: str) -> int:
    """A number of at least 1, as an option."""
    if (number := int(text)) < 1:
        raise argparse.ArgumentTypeError(f"{number} is less than 1")
    return number


def _beside_others(rows: list[dict[str, Any]], how: str) -> list[dict[str, Any]]:
    """Rows of problems, with what they were measured with, and those of the file for problems that were not asked."""
    facts, path = machine(), RESULTS / "problems.json"
    measured = {"measured": f"{facts['date']}, {history.commit()}, {facts['processor']}: {how}"}
    found = {row["problem"]: row for row in json.loads(path.read_text())["rows"]} if path.exists() else {}
    found |= {row["problem"]: row | measured for row in rows}
    return [found[name] for name in problems.POSED if name in found]


def _alone(function: Callable[..., Any], *given: object) -> Any:
    """In a process of its own: compiler options are one process's."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, given)


def machine() -> dict[str, Any]:
    """What was measured on, when, with which versions."""
    versions = {}
    for library in LIBRARIES:
        try:
            versions[library] = importlib.metadata.version(library)
        except importlib.metadata.PackageNotFoundError:
            versions[library] = None
    return {
        "date": datetime.date.today().isoformat(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),  # how many programs wanted a core, over the last minute
        "python": platform.python_version(),
        "versions": versions,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        facts = dict(line.split(":", 1) for line in reversed(lines) if ":" in line)
        facts = {key.strip(): value.strip() for key, value in facts.items()}
        wide = [name for name in ("avx512f", "avx2", "avx") if name in facts.get("flags", "").split()]
        return f"{facts['model name']} ({', '.join(wide[:1])})"
    except (OSError, KeyError):
        return platform.processor() or platform.machine()


def table(kept: dict[str, Any]) -> str:
    """A part as Markdown."""
    facts, rows = kept["machine"], kept["rows"]
    versions = ", ".join(f"{k} {v}" for k, v in facts["versions"].items() if v)
    load = f", load {facts['load']}" if "load" in facts else ""
    columns = [key for key in dict.fromkeys(key for row in rows for key in row) if key != "curves"]
    lines = [
        f"# {kept['part']}",
        "",
        f"{facts['date']}, {facts['processor']}, {facts['cores']} cores{load}; {versions}",
        "",
    ]
    lines += [kept["note"], ""] if "note" in kept else []
    lines += ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for row in rows:
        cells = [row.get(column, "") for column in columns]
        lines.append("| " + " | ".join(_cell(c) for c in cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_cell(v) for v in value)
    return "never" if value is None else f"{value:.5g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
