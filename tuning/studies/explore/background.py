"""Where the page writes, and `agvjax tune` beside it, in a process of its own so that sliders go on moving."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ...config import dump, gains_table
from ...config.settings import Config
from ...io import files

WAIT = 5.0  # s, for a tuning to end when asked to
TAIL = 4000  # bytes of what it said that are looked at


class Desk:
    """The folder of a page, made when first something is written; its parts are numbered."""

    def __init__(self, make: Callable[[], Path], tune: Sequence[str], environment: Mapping[str, str]) -> None:
        """`make` makes the folder; `tune` is the command line of `agvjax tune`, to be run in `environment`."""
        self._make, self._folder = make, None
        self.tune, self.environment = tuple(tune), dict(environment)
        self.running: set[Tuning] = set()

    def part(self, name: str) -> Path:
        """A path in the folder that is not there yet: `name-1`, `name-2`, ..."""
        if self._folder is None:
            self._folder = self._make()
        taken = [int(m[1]) for p in self._folder.iterdir() if (m := re.match(rf"{name}-(\d+)", p.name))]
        return self._folder / f"{name}-{max(taken, default=0) + 1}"

    def save(self, config: Config) -> Path:
        """Write `gains.toml`, with `config.toml` beside it, as `agvjax tune` does; returns the former."""
        settings, gains = dump(config), gains_table(config.controller)
        folder = self.part("gains")
        folder.mkdir()
        files.write(folder / "config.toml", settings)
        files.write(folder / "gains.toml", gains)
        return folder / "gains.toml"

    def close(self) -> None:
        """End what runs."""
        for tuning in list(self.running):
            tuning.end()


class Tuning:
    """`agvjax tune` of a configuration, in a folder of its own beside what it says."""

    def __init__(self, desk: Desk, config: Config) -> None:
        """Begin."""
        settings, self.folder, self._desk = dump(config), desk.part("tune"), desk
        given, self._said = (self.folder.with_name(self.folder.name + end) for end in (".toml", ".log"))
        files.write(given, settings)
        command = [*desk.tune, "--config", str(given), "--out", str(self.folder)]
        with self._said.open("wb") as log:
            self._process = subprocess.Popen(
                command, env=desk.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
            )
        self._began = time.monotonic()
        desk.running.add(self)

    @property
    def seconds(self) -> float:
        """How long it has run [s]."""
        return time.monotonic() - self._began

    @property
    def gains(self) -> Path:
        """The file of what it found, there once it has ended well."""
        return self.folder / "gains.toml"

    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        code = self._process.poll()
        if code is not None:
            self._desk.running.discard(self)
        return code

    def said(self) -> str:
        """The last line that it said: the phase that it is in, then how it ended."""
        with self._said.open("rb") as log:
            log.seek(max(0, os.fstat(log.fileno()).st_size - TAIL))
            text = log.read().decode("utf-8", "replace")
        lines = [line.strip() for line in re.split(r"[\r\n]+", text) if line.strip()]
        return lines[-1] if lines else ""

    def stop(self) -> None:
        """Ask it to end as Ctrl-C does: it leaves a checkpoint."""
        if self.code() is None:
            self._process.send_signal(signal.SIGINT)

    def end(self) -> None:
        """End it, and wait until it has."""
        self.stop()
        try:
            self._process.wait(WAIT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._desk.running.discard(self)
