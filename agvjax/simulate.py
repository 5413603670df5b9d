"""The closed loop in time: one `lax.scan` over the steps, from which trajectories and metrics both come."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from ._pytree import Real
from .engine.loop import Trajectory
from .engine.rollout import Meter, Rollout
from .host import looked_at
from .integrate import RK4, Integrator
from .protocols import Law
from .scenario import Scenario
from .timing import DT, N_STEPS, Timing


@looked_at
@functools.partial(jax.jit, static_argnames=("n_steps", "save_every", "control_every", "integrator", "dtype"))
# long: mostly its arguments and what they mean
def simulate(
    controller: Law,
    scenario: Scenario,
    *,
    dt: Real = DT,
    n_steps: int = N_STEPS,
    save_every: int = 1,
    control_every: int = 1,
    integrator: Integrator = RK4,
    dtype: DTypeLike | None = None,
) -> Trajectory:
    """Roll one vehicle out: section 4 by default, 12 s in steps of 1 ms (reading R10).

    Args:
        controller: a law; see `agvjax.Law`.
        scenario: what the controller does not know; see `Scenario`.
        dt: step [s]; traced, so that changing it does not compile again.
        n_steps: number of steps; a multiple of `save_every`.
        save_every: steps between saved samples.
        control_every: steps between control instants, at which a law with memory and a sensor look; a law with a
            period of its own looks every round(period / dt) steps.
        integrator: `RK4`, `HEUN` or `EULER`.
        dtype: float32 or float64; None takes JAX's default float.

    Returns:
        n_steps / save_every + 1 samples, the first at t = 0. Works under `jax.vmap`, `grad`, `jvp` and `jit`.

    Raises:
        ValueError: `dt` is not above 0, `n_steps` is no positive multiple of `save_every`, or the scenario's actuators
            are not the plant's.
        TypeError: a string where an object belongs.
    """
    if save_every < 1 or save_every != int(save_every) or n_steps % save_every:
        raise ValueError(
            f"n_steps must be a positive multiple of save_every; got n_steps={n_steps}, save_every={save_every}"
        )
    rollout = Rollout(
        controller,
        scenario,
        timing=Timing(dt=dt, n_steps=n_steps, control_every=control_every, integrator=integrator),
        dtype=dtype,
        meter=Meter(),
    )
    carry, samples, last = rollout.sampled(save_every)
    samples = jax.tree.map(lambda x, end: jnp.concatenate([x, end[None]]), samples, last)
    norms = jax.vmap(lambda _, state: controller.weight_norms(state))(samples.t, samples.controller)
    return Trajectory(**vars(samples), weight_norm=norms, ok=carry.ok)
