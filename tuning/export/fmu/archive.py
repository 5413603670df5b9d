"""An FMU is a zip archive: modelDescription.xml, sources, and a library made of them by this machine's C compiler."""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from ..artefact import Artefact, filled
from .description import Model, build, fmi2, fmi3

TEMPLATES = Path(__file__).with_name("files")
FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden")
SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
WORDS = {"linux": "linux64", "darwin": "darwin64", "win32": "win64"}  # of FMI 2.0
MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
BEGAN = (1980, 1, 1, 0, 0, 0)  # the date of every file: the same export is the same archive
PATIENCE = 120.0  # s for the compiler


def archives(model: Model, artefact: Artefact) -> dict[str, bytes]:
    """NAME.fmi2.fmu and NAME.fmi3.fmu; without a compiler they have sources alone, which the artefact's `note` says."""
    token = hashlib.sha256(json.dumps([model.sources, fmi3(model, "")]).encode()).hexdigest()
    parts, found, lacks = {"NAME": model.name, "TOKEN": token}, {}, ""
    for version in ("fmi2", "fmi3"):
        sources = model.sources | {
            f"{model.name}_instance.h": filled(TEMPLATES / "instance.h.txt", parts),
            f"{model.name}_{version}.c": filled(TEMPLATES / f"{version}.c.txt", parts),
        }
        compiled = [*model.units, f"{model.name}_{version}.c"]
        files: dict[str, str | bytes] = {f"sources/{name}": text for name, text in sources.items()}
        files["resources/provenance.json"] = json.dumps(artefact.provenance, indent=2) + "\n"
        if version == "fmi2":
            files["modelDescription.xml"] = fmi2(model, token, compiled)
        else:
            files |= {
                "modelDescription.xml": fmi3(model, token),
                "sources/buildDescription.xml": build(model, compiled),
            }
        library = _library(sources, compiled)
        if isinstance(library, bytes):
            files[f"binaries/{_folder(version)}/{model.name}{SYSTEMS[sys.platform][1]}"] = library
        else:
            lacks = library
        found[f"{model.name}.{version}.fmu"] = _zipped(files)
    if lacks:
        artefact.note(f"the FMUs hold sources and no binary, compile them where they are imported: {lacks}")
    return found


def _folder(version: str) -> str:
    """Where the library of this machine lies among others."""
    system, machine = sys.platform, platform.machine().lower()
    if version == "fmi2":
        return WORDS[system]
    return f"{MACHINES.get(machine, machine)}-{SYSTEMS[system][0]}"


def _library(sources: dict[str, str], compiled: Sequence[str]) -> bytes | str:
    """The library, or why there is none."""
    asked = shlex.split(os.environ.get("CC", "")) or [name for name in ("cc", "gcc", "clang") if shutil.which(name)][:1]
    if not asked or sys.platform not in SYSTEMS:
        return "no C compiler is found (cc, gcc, clang, or what CC names)"
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        command = [*asked, *FLAGS, "-o", "library", *compiled, "-lm"]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=PATIENCE, check=False
            )
        except (OSError, subprocess.SubprocessError) as error:
            return f"{asked[0]} does not run ({error})"
        if done.returncode:
            return f"{asked[0]} fails ({(done.stderr.strip().splitlines() or ['it does not say why'])[0][:200]})"
        return (Path(folder) / "library").read_bytes()


def _zipped(files: dict[str, str | bytes]) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(files.items()):
            entry = zipfile.ZipInfo(name, BEGAN)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, content)
    return target.getvalue()
