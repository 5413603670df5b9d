"""The closed loop in time: one `lax.scan` over the steps, from which trajectories and metrics both come."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._pytree import pytree
from .engine.rollout import NoMeter, Rollout
from .integrate import RK4, Integrator
from .protocols import Law
from .scenario import Scenario
from .timing import DT, N_STEPS, Timing


@pytree
class Trajectory:
    """N + 1 samples of one run, N = n_steps / save_every; m is the plant's number of actuators."""

    t: Float[Array, " N+1"]  # s
    position: Float[Array, "N+1 2"]  # m, reference point (x_n, y_n)
    velocity: Float[Array, "N+1 2"]  # m/s
    heading: Float[Array, " N+1"]  # rad
    reference_position: Float[Array, "N+1 2"]  # m
    reference_heading: Float[Array, " N+1"]  # rad
    command: Float[Array, "N+1 c"]  # u_x, u_y [m/s^2], and omega_bar [rad/s] where the plant's heading is commanded
    inputs: Float[Array, "N+1 m"]  # what the actuators were asked for
    delivered: Float[Array, "N+1 m"]  # what they delivered
    limited: Bool[Array, " N+1"]  # whether an actuator, or the controller's own limit, was at its limit
    controller: Any  # continuous state of the law, each leaf with a leading N+1
    weight_norm: Float[Array, "N+1 2"] | None  # position and heading, where the law adapts one
    ok: Bool[Array, ""]  # False: the state left `scenario.limit` and was latched


@functools.partial(jax.jit, static_argnames=("n_steps", "save_every", "control_every", "integrator", "dtype"))
def simulate(
    controller: Law,
    scenario: Scenario,
    *,
    dt: Any = DT,
    n_steps: int = N_STEPS,
    save_every: int = 1,
    control_every: int = 1,
    integrator: Integrator = RK4,
    dtype: Any = None,
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
        ValueError: `n_steps` is no positive multiple of `save_every`, or the scenario's actuators are not the plant's.
    """
    if save_every < 1 or n_steps % save_every:
        raise ValueError(
            f"n_steps must be a positive multiple of save_every; got n_steps={n_steps}, save_every={save_every}"
        )
    rollout = Rollout(
        controller,
        scenario,
        timing=Timing(dt=dt, n_steps=n_steps, control_every=control_every, integrator=integrator),
        dtype=dtype,
        meter=NoMeter(),
    )
    carry, samples, last = rollout.run(save_every)
    samples = jax.tree.map(lambda x, end: jnp.concatenate([x, end[None]]), samples, last)
    norms = jax.vmap(lambda _, state: controller.weight_norms(state))(samples.time, samples.controller)
    return Trajectory(
        t=samples.time,
        position=samples.position,
        velocity=samples.velocity,
        heading=samples.heading,
        reference_position=samples.reference_position,
        reference_heading=samples.reference_heading,
        command=samples.command,
        inputs=samples.inputs,
        delivered=samples.delivered,
        limited=samples.limited,
        controller=samples.controller,
        weight_norm=norms,
        ok=carry.ok,
    )
