"""Logs, a scenario and wishes into a task for the fit; and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import agvjax
from agvjax import Fault, InputError

from ..config.settings import Config
from . import log as logs
from . import parameters as wanted
from .fit import Task
from .load import Count, load, uncounted
from .log import Log
from .model import Model
from .segments import cut, thinned, widened

STEP = 0.0101  # s, the longest that is integrated at once
LEAST_STRETCHES = 5
BRIEF, SOME = 4, 64  # times shorter are the stretches that the starts are fitted to, and how many of them


def read(files: Sequence[str], config: Config, count: Count = uncounted) -> tuple[tuple[Log, ...], bool]:
    """Logs, and whether they have one clock; `count` is told how much was read.

    Raises:
        agvjax.InputError: names file, column and rule.
    """
    wishes, plant = config.identify, config.scenario.plant
    drives = [load(file, plant, wishes.columns, wishes.ahead, wishes.topics, wishes.stamps, count) for file in files]
    wrong = logs.same_channels(drives)
    for i, log in enumerate(drives):
        if any(logs.same_drive(log, other) for other in drives[:i]):
            wrong.append(Fault("LOG.csv", log.name, "given once: the same drive twice is no more to learn from"))
    if wrong:
        raise InputError(wrong)
    return logs.together(drives)


def task(files: Sequence[str], config: Config, count: Count = uncounted) -> Task:
    """All that the fit needs; `count` is told how much was read.

    Raises:
        agvjax.InputError: names every bad key, or the log and what is wrong with it.
    """
    read_logs, one_clock = read(files, config, count)
    settings, first = config.identify, read_logs[0]
    if settings.segment < BRIEF * max(log.step for log in read_logs):
        rule = f"at least {BRIEF} rows long, {BRIEF * max(log.step for log in read_logs):g} s"
        raise InputError([Fault("identify.segment", settings.segment, rule)])
    shortest, longest = (pick(log.step for log in read_logs) for pick in (min, max))
    model = model_of(config, tuple(first.measured), first.commands, shortest)
    model = model._replace(substeps=max(1, int(np.ceil(longest / STEP))))
    pace = settings.memory, settings.gap, 0.0, model.run_up(settings.memory)
    segments, counts = cut(read_logs, settings.segment, *pace)
    if counts.segments < LEAST_STRETCHES:
        long = sum(log.t[-1] - log.t[0] for log in read_logs)
        rule = (
            f"at least {LEAST_STRETCHES} stretches of identify.segment, {settings.segment:g} s, without gaps, after"
            f" identify.memory, {settings.memory:g} s, at the beginning and after each gap;"
            f" it has {counts.segments} in {long:.3g} s with {counts.gaps} gaps"
        )
        raise InputError([Fault("LOG.csv", first.name, rule)])
    substep = longest / model.substeps
    parameters = wanted.parameters(model.scenario, model.names, read_logs, substep, settings.memory)
    unknown = counts.segments * model.begun + len(parameters)
    if (measurements := int((segments.weight > 0).sum())) < 2 * unknown:
        rule = f"so long that there are twice as many measurements as unknowns; there are {measurements} for {unknown}"
        raise InputError([Fault("identify.segment", settings.segment, rule)])
    brief = thinned(cut(read_logs, settings.segment / BRIEF, *pace)[0], SOME)
    brief = widened(brief, segments.t.shape[1], first.step)  # so that both share a compilation
    return Task(read_logs, one_clock, segments, brief, counts, model, parameters, settings.columns, settings.memory)


def model_of(config: Config, channels: tuple[str, ...], commands: tuple[str, ...], step: float) -> Model:
    """The model that is fitted to rows `step` s apart."""
    scenario = agvjax.check(wanted.prepared(config.scenario, config.identify.fit, step, config.identify.memory))
    names = wanted.named(scenario, config.identify.fit)
    return Model(scenario, names, channels, commands, max(1, int(np.ceil(step / STEP))))
