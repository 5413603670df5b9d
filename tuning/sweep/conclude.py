"""The end of a sweep: it is judged, and its report written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from .. import config as configuration
from ..config.settings import Config
from ..io import files
from ..io.pages import publish
from ..io.pictures import write_figures
from ..io.terminal import plain
from . import figures, page, results, shards, verdict, work
from .design import Design
from .laws import Laws
from .shards import Manifest


def conclude(
    config: Config,
    folder: Path,
    manifest: Manifest,
    plan: Design,
    laws: Laws,
    judges: Sequence[work.Judge],
    say: Callable[..., None],
) -> None:
    """Write the report of a sweep whose shards are all there.

    Args:
        config: of the sweep, with what counts as a failure now.
        folder: of the sweep.
        manifest: of the sweep.
        plan: its scenarios.
        laws: its controllers.
        judges: what judged them.
        say: is told what is done, and the report.
    """
    text = configuration.dump(config)
    if not _reported(folder, text):
        (folder / "report.html").unlink(missing_ok=True)
        files.write(folder / "config.toml", text)
        say("evaluating the results ...")
        say("", plain(_write(config, results.collect(folder, manifest, config, plan), laws, judges, folder)))
        say(f"shards, findings and report written to {folder}; begin with {folder}/report.html")
    else:
        say(f"complete, with its report: {folder}/report.html")
    shards.sweep_up(folder)


def _reported(folder: Path, text: str) -> bool:
    """Whether the report is there, for these settings."""
    return (folder / "report.html").exists() and (folder / "config.toml").read_text(encoding="utf-8") == text


def _write(config: Config, swept: results.Results, laws: Laws, judges: Sequence[work.Judge], folder: Path) -> str:
    """Findings, figures and report; what a terminal is told."""
    judged = verdict.judge(config, swept, laws, judges)
    files.write_json(folder / "findings.json", page.as_json(swept, judged))
    drawings = figures.every(swept, judged.bounds, judged.which, judged.indices)
    lost = write_figures(folder, drawings)
    text = page.page(swept, judged, [f"{name}.png" for name in drawings], str(folder))
    publish(folder, text, (page.METRIC_TABLE, page.LARGEST_TABLE))
    return "\n\n".join([page.brief(swept, judged, str(folder)), *lost])
