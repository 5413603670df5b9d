"""What the search for the highest speed needs of a configuration."""

from __future__ import annotations

import numpy as np

import agvjax
from agvjax import Fault

from ...config.settings import Config
from ...tune import rules


def faults(config: Config) -> list[Fault]:
    """What is wrong with a configuration whose highest speed is looked for."""
    path = config.scenario.path
    if not config.controller.follows() or not isinstance(path, agvjax.Route):
        law = "a law that follows a route: regulated_pure_pursuit, path_pid, stanley, path_lqr, in a computer"
        key = "controller.inner" if isinstance(config.controller, agvjax.Sampled) else "controller"
        inner = config.controller.inner if isinstance(config.controller, agvjax.Sampled) else config.controller
        if not config.controller.follows():
            return [Fault(key, type(inner).__name__, law)]
        return [Fault("scenario.path", type(path).__name__, "a route, which goes by where the vehicle is")]
    return rules.faults(config) or _settings(config, path)


def _settings(config: Config, route: agvjax.Route) -> list[Fault]:
    """Settings under which nothing can be said of a speed."""
    speed, tune, found = config.speed, config.tune, rules.margin_faults(config.tune)
    takes = float(np.asarray(route.instants)[-1])
    if not speed.within and route.half_widths is None:
        rule = "> 0 m (--within) where the route has no corridor (scenario.path.half_width)"
        found.append(Fault("speed.within", speed.within, rule))
    if speed.low > speed.high:
        found.append(Fault("speed.low", speed.low, f"at most speed.high, {speed.high:g}"))
    if speed.after >= takes:
        rule = f"< {takes:.4g} s, which the route takes: the distance counts when the start is over"
        found.append(Fault("speed.after", speed.after, rule))
    if isinstance(tune.gains, str):
        found.append(Fault("tune.gains", tune.gains, "names of gains: the same are tuned at every speed"))
    if tune.search.rounds:
        found.append(Fault("tune.search.rounds", tune.search.rounds, "0: here no worst scenario is searched for"))
    return found
