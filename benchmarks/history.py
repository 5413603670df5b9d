"""Every run of `make bench` in a row of `results/history.csv`, and how it compares with the one before it."""

from __future__ import annotations

import csv
import json
import subprocess
from pathlib import Path
from typing import Any

HISTORY = Path(__file__).parent / "results" / "history.csv"
COLUMNS = ("date", "commit", "part", "processor", "cores", "load", "python", "versions", "figures")
FELT = 0.05  # of a figure: smaller changes are not listed


def figures(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Every number of a part that was measured, named by what its row is about and its column.

    What a row is about are its first texts and counts, as many as tell it from every other row: what stands behind them
    may be a result, and be another one next time.
    """
    texts = [[str(value) for value in row.values() if isinstance(value, (str, int))] for row in rows]
    most = max(map(len, texts), default=0)
    enough = (n for n in range(1, most + 1) if len({tuple(text[:n]) for text in texts}) == len(rows))
    n, named = next(enough, most), {}
    for row, text in zip(rows, texts, strict=True):
        about = " ".join(text[:n])
        named |= {f"{about}: {key}": float(f"{x:.5g}") for key, x in row.items() if isinstance(x, float)}
    return named


def kept(kept: dict[str, Any], commit: str) -> dict[str, str]:
    """A row of the history."""
    machine = kept["machine"]
    texts = {key: str(machine.get(key, "")) for key in ("date", "processor", "cores", "load", "python")}
    versions = " ".join(f"{name}={version}" for name, version in machine["versions"].items() if version)
    numbers = json.dumps(figures(kept["rows"]))
    return texts | {"commit": commit, "part": kept["part"], "versions": versions, "figures": numbers}


def append(row: dict[str, str], path: Path = HISTORY) -> dict[str, str] | None:
    """Add a row; returns the last one before it of the same part and machine."""
    before = list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []
    same = [old for old in before if all(old[key] == row[key] for key in ("part", "processor", "cores"))]
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if not before:
            writer.writeheader()
        writer.writerow(row)
    return same[-1] if same else None


def change(row: dict[str, str], old: dict[str, str] | None) -> str:
    """What became of each figure since the last run on this machine, in lines."""
    if old is None:
        return f"{row['part']}: no earlier run on {row['processor']}, {row['cores']} cores"
    now, then = json.loads(row["figures"]), json.loads(old["figures"])
    both = {name: (then[name], x) for name, x in now.items() if then.get(name)}
    felt = {name: (a, b) for name, (a, b) in both.items() if abs(b / a - 1) >= FELT}
    since = f"since {old['commit']}, {old['date']}, load {old['load'] or 'unknown'}"
    lines = [f"{row['part']}: {len(felt)} of {len(both)} figures changed by {FELT:.0%} and more {since}"]
    return "\n".join(lines + [f"  {name}: {a:.5g} -> {b:.5g} ({b / a - 1:+.0%})" for name, (a, b) in felt.items()])


def commit() -> str:
    """The commit that was measured; with a plus where files differ from it."""
    asked = ["git", "describe", "--always", "--dirty=+", "--exclude", "*"]
    done = subprocess.run(asked, cwd=HISTORY.parent, capture_output=True, text=True)
    return done.stdout.strip() or "unknown"
