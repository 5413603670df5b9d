"""The folder of a sweep: new, or one that the same sweep has begun in; for one process at a time."""

from __future__ import annotations

import argparse
import contextlib
import os
from pathlib import Path

from agvjax import Fault, InputError

from ..config.old import counts_first_command
from ..io import files
from ..io.alone import alone
from ..sweep import shards
from .console import Console
from .folders import new_folder, not_empty


def begin(
    arguments: argparse.Namespace, console: Console, manifest: shards.Manifest, text: str, ours: contextlib.ExitStack
) -> tuple[Path, shards.Manifest]:
    """A new folder with the manifest and the settings, unless another process has begun in it meanwhile."""
    out = Path(arguments.out or os.devnull)
    try:
        out = new_folder(arguments.out, arguments.command)
    except InputError:
        if not out.is_dir() or not shards.begun(out, manifest):
            raise
    ours.enter_context(alone(out))
    if found := begun(arguments, console, manifest, None, out):
        return found
    files.write(out / "config.toml", text)
    shards.write_manifest(out, manifest)
    return out, manifest


def begun(
    arguments: argparse.Namespace,
    console: Console,
    manifest: shards.Manifest,
    ours: contextlib.ExitStack | None,
    out: Path | None = None,
) -> tuple[Path, shards.Manifest] | None:
    """The folder in which this very sweep has begun, with its own manifest; None where none has.

    It is held by `ours` alone from then on; None: it is already.
    """
    out = out or Path(arguments.out or os.devnull)
    if not (out / shards.MANIFEST).exists():
        if arguments.resume:
            rule = "used with --out, the folder of a sweep that has begun"
            raise InputError([Fault("--resume", arguments.out, rule)])
        if arguments.out and out.is_dir() and not files.empty(out) and not shards.begun(out, manifest):
            raise not_empty(out, arguments.command)
        return None
    if ours is not None:
        ours.enter_context(alone(out))
    try:
        before = shards.read_manifest(out)
    except ValueError as error:
        raise InputError([Fault("--out", out, f"a new folder, or that of this sweep ({error})")]) from error
    try:
        manifest = shards.taken_up(before, manifest)
    except ValueError as error:
        raise InputError([Fault("--out", out, f"a new folder, or that of the same sweep; changed: {error}")]) from error
    if before.versions != manifest.versions:
        console.note(f"this sweep was begun with {before.versions}, here are {manifest.versions}")
    if counts_first_command(before.config):
        console.note("in its finished shards the variation of commands and of what is delivered counts the first, too")
    return out, manifest
