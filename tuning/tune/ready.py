"""Compiled programs of a tuning problem made ready in the background, from disk where they were made ready before."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array

from ..compute.compiled import Ahead
from ..compute.processes import joined
from ..config import dump
from .finer import judgement, seen_and_unseen
from .problem import TuningProblem
from .screen import Screen


def steered(problem: TuningProblem) -> TuningProblem:
    """The problem with its Jacobian made ready."""
    tuner = problem.tuner
    if tuner.forward:
        tuner = dataclasses.replace(tuner, compiled=Ahead(tuner.jacobian, *_identity(problem), tuner.scenarios()))
    return problem._replace(tuner=tuner)


def readied(problem: TuningProblem) -> TuningProblem:
    """The problem with all that tuning and judging will call made ready, what is called first first.

    Not where several processes compute together: they must do the same in the same order.
    """
    if joined():
        return problem
    looked = _screened(problem)
    problem = steered(problem)
    (settings, z), adversary, config = _identity(problem), problem.adversary, problem.config
    jacobian = problem.tuner.compiled if isinstance(problem.tuner.compiled, Ahead) else None
    shares, scenarios = adversary.examples()
    climb = Ahead(adversary.climb, settings + "climb", z, jnp.asarray(shares, z.dtype), after=jacobian)
    look = Ahead(adversary.look, settings + "look", z, scenarios, after=jacobian)
    judge, parts = judgement(config, config.controller, seen_and_unseen(problem)[0])
    judged = Ahead(judge, settings + "judged", *parts, after=jacobian)
    adversary = dataclasses.replace(adversary, compiled=(climb, look))
    return problem._replace(adversary=adversary, screen=looked, judgement=judged)


def _screened(problem: TuningProblem) -> Screen | None:
    """The screening with its rollouts made ready."""
    screen = problem.screen
    if screen is None:
        return None
    compiled = Ahead(screen.tuner.values, _identity(problem)[0] + "screen", *screen.example())
    return dataclasses.replace(screen, compiled=compiled)


def _identity(problem: TuningProblem) -> tuple[str, Array]:
    """All that shapes what is compiled, and where the search starts."""
    settings = dump(dataclasses.replace(problem.config, seed=0))
    return settings, problem.tuner.gains.coordinates(problem.config.controller)
