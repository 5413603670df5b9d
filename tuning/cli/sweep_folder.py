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
from .folders import new_folder, usable


def begun(
    arguments: argparse.Namespace, console: Console, manifest: shards.Manifest, ours: contextlib.ExitStack
) -> tuple[Path, shards.Manifest] | None:
    """The folder in which this very sweep has begun, `ours` alone from now on, and its own manifest.

    None where a sweep may begin; nothing is written then.
    """
    out = Path(arguments.out or os.devnull)
    if os.path.exists(out / shards.MANIFEST):
        taken = _taken_up(out, console, manifest)  # before anything is written
        ours.enter_context(alone(out))
        return out, taken
    if arguments.resume:
        raise InputError([Fault("--resume", arguments.out, "used with --out, the folder of a sweep that has begun")])
    if not _lost(out, manifest):
        usable(arguments.out, arguments.command)
    return None


def begin(
    arguments: argparse.Namespace, console: Console, manifest: shards.Manifest, text: str, ours: contextlib.ExitStack
) -> tuple[Path, shards.Manifest]:
    """A new folder, `ours` alone, with the manifest and the settings, unless another process has begun in it meanwhile.

    Args:
        arguments: of the command.
        console: where to say what is noteworthy.
        manifest: of the sweep.
        text: the settings, TOML.
        ours: keeps the folder for this process.
    """
    out = Path(arguments.out or os.devnull)
    if not _lost(out, manifest):
        out = new_folder(arguments.out, arguments.command)
    ours.enter_context(alone(out))
    if os.path.exists(out / shards.MANIFEST):
        return out, _taken_up(out, console, manifest)
    files.write(out / "config.toml", text)
    shards.write_manifest(out, manifest)
    return out, manifest


def _lost(out: Path, manifest: shards.Manifest) -> bool:
    """Whether this sweep has begun in a folder that is not empty, and its manifest was lost, or not written yet."""
    return os.path.isdir(out) and not files.empty(out) and shards.begun(out, manifest)


def _taken_up(out: Path, console: Console, manifest: shards.Manifest) -> shards.Manifest:
    """The manifest to go on with, of the same sweep as the one that lies in the folder."""
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
    return manifest
