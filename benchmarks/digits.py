"""`python -m benchmarks.digits collect REPO OUT`, and `compare OLD NEW`: whether two commits say the same numbers."""

from __future__ import annotations

import argparse
import csv
import json
import re
import subprocess
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

LOGS = "notebooks/logs/robot-excited.csv notebooks/logs/robot-lemniscate.csv --unseen notebooks/logs/robot-spline.csv"
COMMANDS = {name: name for name in "tune simulate sweep vehicles compare reproduce pareto doctor".split()}
COMMANDS["identify"] = f"identify {LOGS} --config robot"
SAMPLED = "{here}/tests/data/before-rooms/configs/gains-sampled/gains.toml --config unicycle"
for form in "c numpy ros2 stablehlo".split():  # the first is refused, being of a law without a period
    COMMANDS[f"export-{form}"] = f"export {{out}}/tune/gains.toml --format {form}"
    COMMANDS[f"export-sampled-{form}"] = f"export {SAMPLED} --format {form}"
KINDS = {".json", ".jsonl", ".csv", ".toml", ".md", ".npz"}  # in which numbers are looked for
IGNORED = set("version versions sha sha256 digest hash machine date seconds wall elapsed rate generator".split())
NUMBER = re.compile(r"(?<![\w./-])[+-]?(?:\d+\.?\d*(?:[eE][+-]?\d+)?|inf|nan)(?![\w/]|\.\d)")
PASSING = re.compile(r"\b[0-9a-f]{32,64}\b|\b\d{4}-\d\d-\d\d\b|version|agvjax \d", re.IGNORECASE)  # lines left out


def collect(repo: Path, out: Path, only: list[str]) -> None:
    """Run commands of a repository's own environment into folders of their names; `times.txt` has what they took."""
    repo, out, here = repo.resolve(), out.resolve(), Path(__file__).resolve().parents[1]
    out.mkdir(parents=True, exist_ok=True)
    for name in only or COMMANDS:
        words, began = f"{COMMANDS[name]} --out {{out}}/{name}".format(out=out, here=here).split(), time.perf_counter()
        with (out / f"log-{name}.txt").open("w") as log, (out / "times.txt").open("a") as times:
            done = subprocess.run([repo / ".venv/bin/agvjax", *words], cwd=repo, stdout=log, stderr=log)
            print(name, f"rc={done.returncode} {time.perf_counter() - began:.3f}", file=times)


def leaves(value: object, key: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """The leaves of tables and lists by dotted key, each an array of numbers; of text an empty one."""
    if isinstance(value, (dict, list)):
        for name, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(part, f"{key}.{name}")
        return
    array = np.asarray(np.nan if value is None else value)
    yield key[1:].replace("/", "."), array.astype(float) if array.dtype.kind in "fiub" else np.zeros(0)


def content(path: Path) -> object:
    """What a file holds, as tables and lists."""
    if path.suffix == ".npz":
        return dict(np.load(path, allow_pickle=False))
    text = path.read_bytes().decode("utf-8" if path.suffix in KINDS else "latin-1")
    lasting = [line for line in text.splitlines() if not PASSING.search(line)]
    if path.suffix == ".md":  # by heading, so that a row more under one shifts no other
        return [[float(x) for x in NUMBER.findall(part)] for part in "\n".join(lasting).split("\n#")]
    if path.suffix == ".csv":
        header, *rows = csv.reader(text.splitlines())
        return [{k: float(x) if NUMBER.fullmatch(x) else x for k, x in zip(header, row, strict=True)} for row in rows]
    if path.suffix in KINDS:
        load = tomllib.loads if path.suffix == ".toml" else json.loads
        return load(f"[{','.join(text.splitlines())}]" if path.suffix == ".jsonl" else text)
    return [np.array([ord(c) for c in line]) for line in lasting]  # what was generated: every byte


def numbers(root: Path, renamed: dict[str, str]) -> dict[str, dict[str, np.ndarray]]:
    """By file every leaf; of a key, parts between dots are renamed, and those that tell of time or place left out."""
    names = "|".join(map(re.escape, sorted(renamed, key=len, reverse=True))) or "$^"
    pattern, found = re.compile(rf"(?<![^.])({names})(?![^.])"), {}
    for path in sorted(p for p in root.rglob("*") if p.is_file() and p.parent != root):
        place = str(path.relative_to(root))
        every = leaves(content(path) if path.suffix in KINDS or place.startswith("export") else {})
        found[place] = {pattern.sub(lambda m: renamed[m[1]], k): v for k, v in every if not IGNORED & {*k.split(".")}}
    return found


def apart(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Relative differences, 0 where both are the same, infinite where only one is a number or the shapes differ."""
    if old.shape != new.shape:
        return np.full(max(old.size, new.size), np.inf)
    with np.errstate(all="ignore"):
        relative = np.nan_to_num(np.abs(old - new) / np.maximum(np.abs(old), np.abs(new)), nan=np.inf, posinf=np.inf)
    return np.where((old == new) | (np.isnan(old) & np.isnan(new)), 0.0, relative).ravel()


def compare(old: Path, new: Path, renamed: dict[str, str], tolerance: float) -> bool:
    """Print how far they are apart, command by command; whether nowhere too far, and nothing of the old is missing."""
    before, after, agree = numbers(old, renamed), numbers(new, {}), True
    for command in sorted({name.split("/")[0] for name in (*before, *after)}):
        count, differ, worst, lines = 0, 0, (0.0, ""), []
        for name in sorted(n for n in {*before, *after} if n.split("/")[0] == command):
            a, b = before.get(name, {}), after.get(name, {})
            for side, files, one, two in ((old, after, a, b), (new, before, b, a)):
                lost = [key for key in one if key not in two and one[key].size]
                agree &= side == new or not lost
                if lost or name not in files:
                    lines.append(f"  only in {side}: {name} {len(lost)} numbers: {', '.join(lost[:4])}")
            for key in a.keys() & b.keys():
                gaps = apart(a[key], b[key])
                count, differ = count + gaps.size, differ + int(np.count_nonzero(gaps > tolerance))
                worst = max(worst, (float(gaps.max(initial=0.0)), f" in {name}: {key}" if gaps.any() else ""))
        print(f"{command}: {count} numbers, {differ} differ, by {worst[0]:.3g} at most{worst[1]}", *lines, sep="\n")
        agree &= not differ
    return agree


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.digits", description=__doc__)
    parser.add_argument("part", choices=("collect", "compare"))
    parser.add_argument("folders", type=Path, nargs=2, metavar="FOLDER", help="REPO with .venv, OUT; or OLD, NEW")
    parser.add_argument("--only", action="append", choices=COMMANDS, metavar="NAME", help="to collect; repeatable")
    parser.add_argument("--renamed", action="append", default=[], metavar="OLD=NEW", help="of keys; A.B=A.B keeps one")
    parser.add_argument("--tolerance", type=float, default=0.0, help="relative; without it the same digits")
    given = parser.parse_args()
    if given.part == "collect":
        collect(*given.folders, given.only)
    elif not compare(*given.folders, dict(x.split("=", 1) for x in given.renamed), given.tolerance):
        raise SystemExit(1)
