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
from pathlib import Path
from typing import Any

import tomli_w

from tuning.identify.plain import AT_ONCE, LAGGING

HERE = Path(__file__).parent
KEPT = HERE.parent / "build" / "drives"
LISTED = HERE / "drives.toml"


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
    return {"drive": name, "machine": drive["machine"]} | told(json.loads((out / "estimates.json").read_text()))


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
