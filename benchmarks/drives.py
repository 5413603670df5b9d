"""What `agvjax identify` finds in public drives of machines that nobody here built; fetched, checked, never kept here.

`python -m benchmarks drives` fetches what is not in build/drives yet, from the addresses in drives.toml, and refuses a
file that is not the one that was measured, by its SHA-256.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
import tomllib
import urllib.request
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

import agvjax
from tuning import config as configuration
from tuning.identify.load import load as logged
from tuning.identify.plain import AT_ONCE, LAGGING

HERE = Path(__file__).parent
KEPT = HERE.parent / "build" / "drives"
LISTED = HERE / "drives.toml"
KEPT_UP = ("speed driven by speed asked for, straight on", "speed driven by speed asked for, in turns")
SPAN, ALIKE = 0.2, np.array([0.004, 0.03])  # s; m/s and rad/s within which commands are alike


def measure() -> list[dict[str, Any]]:
    """A row for each drive: what was learned from it, and how well it predicts another part or another drive."""
    return [_row(name, drive) for name, drive in tomllib.loads(LISTED.read_text()).items()]


def _row(name: str, drive: dict[str, Any]) -> dict[str, Any]:
    learned, unseen = (folder(name, part, drive) for part in ("learned", "unseen"))
    config, out = KEPT / f"{name}.toml", KEPT / f"{name}-found"
    config.write_text(tomli_w.dumps({"identify": {"columns": drive["columns"]}}))
    settings = [word for text in drive.get("set", ()) for word in ("--set", text)]
    options = ["--config", drive["config"], "--config", str(config), *settings, "--out", str(out), "--quiet"]
    options += ["--fit", drive["fit"]] if "fit" in drive else []
    shutil.rmtree(out, ignore_errors=True)
    command = [sys.executable, "-m", "tuning.cli", "identify", str(learned), "--unseen", str(unseen), *options]
    subprocess.run(command, check=False)  # 1: the numbers are not good
    found = told(json.loads((out / "estimates.json").read_text()))
    return {"drive": name, "machine": drive["machine"]} | found | _kept_up((learned, unseen), drive, config)


def told(found: dict[str, Any]) -> dict[str, Any]:
    """What a table has room for, of estimates.json."""
    unseen = next(iter(found["predictions"]), {"rms": None, "plain": {}})  # none where nothing is identified
    rms = {"identified": unseen["rms"], **{name: unseen["plain"].get(name) for name in (AT_ONCE, LAGGING)}}
    count = sum(one["identified"] for one in found["parameters"].values())
    return {
        "verdict": re.split("[:;]", found["conclusion"])[0],
        "parameters": f"{count} of {len(found['parameters'])}",
        **{f"{name}, 5 s ahead [mm]": "" if value is None else round(1e3 * value, 1) for name, value in rms.items()},
    }


def _kept_up(parts: Sequence[Path], drive: dict[str, Any], columns: Path) -> dict[str, str]:
    """What share of the speed that it is told a base drives, straight on and in turns: of either part."""
    settings = configuration.load([drive["config"], str(columns)], drive.get("set", ()))
    if not isinstance(settings.scenario.plant, agvjax.Base):
        return dict.fromkeys(KEPT_UP, "")
    asked = settings.identify
    logs = [logged(str(part), settings.scenario.plant, asked.columns) for part in parts]
    each = [shares(log.t, log.measured, log.sent.values) for log in logs]
    return {name: " and ".join(f"{one[i]:.2f}" for one in each) for i, name in enumerate(KEPT_UP)}


def shares(t: np.ndarray, pose: Mapping[str, np.ndarray], sent: np.ndarray) -> tuple[float, float]:
    """Medians over .2 s of speed driven by speed asked for, straight on and in turns; NaN where that was never done.

    Counted is what was asked for alike for .7 s before, forwards by more than .06 m/s; a turn is more than .35 rad/s.

    Args:
        t: times (N,) [s], from 0.
        pose: x, y [m] and heading [rad], each (N,), NaN where it was not measured.
        sent: speed [m/s] and yaw rate [rad/s] that were asked for (N, 2).
    """
    known, ends = np.isfinite(pose["x"]), np.arange(1.0, t[-1] - 1.0, SPAN)
    headings = np.unwrap(pose["heading"][known])
    x, y, heading = (np.interp(ends, t[known], v) for v in (pose["x"][known], pose["y"][known], headings))
    middle = (heading[1:] + heading[:-1]) / 2
    speed = (np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)) / SPAN
    rows = zip(np.searchsorted(t, ends[:-1] - 0.8), np.searchsorted(t, ends[1:] - 0.1), strict=True)
    least, most = (np.array(v) for v in zip(*((sent[a:b].min(0), sent[a:b].max(0)) for a, b in rows), strict=True))
    v, w = ((most + least) / 2).T
    steady = (most - least < ALIKE).all(axis=1) & (v > 0.06)
    kinds = steady & (np.abs(w) < 0.08), steady & (np.abs(w) > 0.35)
    straight, turning = (float(np.median(speed[of_it] / v[of_it])) if of_it.sum() > 3 else np.nan for of_it in kinds)
    return straight, turning


def folder(name: str, part: str, drive: dict[str, Any]) -> Path:
    """The folder of a part's tables: each fetched where it is not there, and cut to the lines that are asked for."""
    made = KEPT / f"{name}-{part}"
    made.mkdir(parents=True, exist_ok=True)
    for topic, source in drive[part].items():
        file = source["file"]
        lines = whole(drive["at"] + file, drive["sha256"][file]).splitlines(keepends=True)
        first, last = source.get("lines", (drive["head"], len(lines)))
        (made / f"{topic}{Path(file).suffix}").write_bytes(b"".join([*lines[: drive["head"]], *lines[first:last]]))
    return made


def whole(address: str, digest: str) -> bytes:
    """A file as it was measured, fetched unless it is there.

    Raises:
        ValueError: it is another one.
    """
    file = KEPT / digest
    if not file.exists():
        KEPT.mkdir(parents=True, exist_ok=True)
        with urllib.request.urlopen(address) as answer:
            file.write_bytes(answer.read())
    content = file.read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        file.unlink()
        raise ValueError(f"{address} is not the file that was measured (SHA-256 {digest})")
    return content
