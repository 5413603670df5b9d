"""CMA-ES: gain sets drawn about a mean, the better ones pull it. Needs no gradient, and many more runs than one.

Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772; the library is its author's (pycma). For laws that
chatter, and for plateaus, where slopes say nothing.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import cma
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from agvjax import Fault

from ...compute.processes import gathered
from ...config.settings import Config
from .method import Look, Method, Model, Progress, Scenarios

if TYPE_CHECKING:
    from ..tuner import Tuner

SPREAD = 0.3  # of the first generation, in the coordinates
SMALLEST = 1e-4  # spread at which it has converged
OPTIONS = {"popsize": (4, 10_000, "a whole number from 4 to 10000"), "sigma": (1e-6, 100.0, "from 1e-6 to 100")}


class State(NamedTuple):
    """All that the strategy was told: from it, it is built again, so that a run resumes to the same result."""

    begin: np.ndarray  # (K,), the first mean
    costs: np.ndarray  # (iterations, population), of the generations so far
    generations: np.ndarray  # ()
    spread: np.ndarray  # (), of the next generation

    @property
    def key(self) -> bytes:
        """What tells it from others."""
        return self.begin.tobytes() + self.costs.tobytes()


class Cma(Method):
    """A generation an iteration; its best set is the next point."""

    def begin(self, z: Array, scenarios: int) -> State:
        """Before the first generation."""
        size = (self.settings.iterations, self._population(z.size))
        spread = np.array(float(self.settings.options.get("sigma", SPREAD)))
        return State(np.asarray(z, float), np.full(size, np.nan), np.array(0), spread)

    def look(self, tuner: Tuner, z: Array, scenarios: Scenarios, model: Model | None) -> Look:
        """The cost alone."""
        score = tuner.cost_of(*tuner.roll(z, scenarios))[1]
        return Look(score, jnp.zeros_like(z))

    def step(
        self, p: Progress, look: Look, sound: bool, baseline: np.ndarray, scenarios: Scenarios
    ) -> tuple[Array, State]:
        """One generation."""
        state: State = p.optimiser
        if int(state.generations) >= len(state.costs):
            return p.z, state
        points = self.ask(state)
        state = self.told(state, np.asarray(self.costs(jnp.asarray(points, p.z.dtype), scenarios), float))
        best = int(np.argmin(state.costs[int(state.generations) - 1]))
        return jnp.asarray(points[best], p.z.dtype), state

    def ask(self, state: State) -> np.ndarray:
        """The gain sets (population, K) of the next generation; the same however often it is asked."""
        if state.key not in self._asked:
            self._asked[state.key] = (strategy := self._strategy(state)), np.array(strategy.ask())
        return self._asked[state.key][1]

    def told(self, state: State, costs: np.ndarray) -> State:
        """The state after a generation of these costs (population,); one that is not finite is the highest."""
        points, at = self.ask(state), int(state.generations)
        strategy, _ = self._asked.pop(state.key)
        known = np.where(np.isfinite(costs), costs, np.finfo(float).max ** 0.5)
        strategy.tell(list(points), list(known))
        table = state.costs.copy()
        table[at] = known
        state = State(state.begin, table, np.array(at + 1), np.array(float(np.max(strategy.result.stds))))
        self._kept[state.key] = strategy
        return state

    @functools.cached_property
    def costs(self) -> Callable[[Array, Scenarios], Array]:
        """(N, K) and scenarios -> costs (N,), jitted."""
        return gathered(jax.jit(lambda z, scenarios: jax.lax.map(self.cost(scenarios), z)))

    @functools.cached_property
    def _kept(self) -> dict[bytes, Any]:
        """Strategies by what they were told."""
        return {}

    @functools.cached_property
    def _asked(self) -> dict[bytes, tuple[Any, np.ndarray]]:
        """Strategies that were asked and not told yet, and what they answered."""
        return {}

    def _strategy(self, state: State) -> Any:
        """The strategy that was told this."""
        kept = self._kept.pop(state.key, None)
        if kept is not None:
            return kept
        draw = np.random.default_rng(0)
        options = {
            "popsize": state.costs.shape[1],
            "verbose": -9,
            "seed": np.nan,  # numbers come from `draw` alone
            "randn": lambda *shape: draw.standard_normal(shape),
        }
        strategy = cma.CMAEvolutionStrategy(state.begin, float(self.settings.options.get("sigma", SPREAD)), options)
        for costs in state.costs[: int(state.generations)]:
            strategy.tell(strategy.ask(), list(costs))
        return strategy

    def _population(self, gains: int) -> int:
        """As the library has it, but for a number that the user sets."""
        return int(self.settings.options.get("popsize", 4 + int(3 * np.log(gains))))

    def look_rollouts(self, gains: int) -> int:
        """A look is one rollout."""
        return 1

    def step_rollouts(self, state: State, gains: int) -> int:
        """A generation."""
        return state.costs.shape[1]

    def converged(self, state: State) -> bool:
        """Whether the sets hardly differ any more."""
        return bool(state.spread < SMALLEST)

    @classmethod
    def forward(cls, settings: Any, gains: int) -> bool:
        """No gradient is taken while tuning."""
        return False

    @classmethod
    def faults(cls, config: Config) -> list[Fault]:
        """Options that it does not have."""
        wrong = []
        for name, value in config.tune.options.items():
            low, high, rule = OPTIONS.get(name, (1.0, 0.0, f"one of {', '.join(OPTIONS)}"))
            whole = name != "popsize" or (isinstance(value, int) and not isinstance(value, bool))
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (number and whole and low <= value <= high):
                wrong.append(Fault(f"tune.options.{name}", value, rule))
        return wrong
