"""What the stability proof of eqs. (26)-(72) says in numbers: its functions, constants and printed bounds.

Written for the plant `Decoupled` with one `Deadzone` a channel, no sensor, and `NeuroBackstepping` with a constant
belief Pi_hat. Everything measured along a run is measured at its saved samples. What can be proved instead of the
printed bounds (50), (54), (72) is in `bounds.py`.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import agvjax
from agvjax import Real
from agvjax._pytree import pytree
from agvjax.controllers.backstepping import BacksteppingState
from agvjax.engine.loop import as_vector
from agvjax.geometry import wrap
from agvjax.leaves import cast
from agvjax.messages import Measurement
from agvjax.paths.heading import reference
from agvjax.plants import DecoupledState

RIDGE = 1e-3  # of the least-squares fit, relative to the nodes' largest mean square


@pytree
class Signals:
    """What the proof speaks of, along a run of N + 1 samples."""

    t: Float[Array, " N+1"]  # s
    Z1: Float[Array, "N+1 2"]  # m, eq. (21)
    Zb1: Float[Array, "N+1 2"]  # m, eq. (24)
    Zb2: Float[Array, "N+1 2"]  # m/s, eq. (24)
    Z3: Float[Array, " N+1"]  # rad, eq. (57)
    filter_error: Float[Array, "N+1 2"]  # m/s, phi1 - alpha1, eq. (22)
    phi1_rate: Float[Array, "N+1 2"]  # m/s^2, eq. (22)
    rate: Float[Array, "N+1 3"]  # m/s^2, m/s^2, rad/s, chi2' and psi' of eq. (6)
    command: Float[Array, "N+1 3"]  # u_x, u_y [m/s^2], omega_bar [rad/s]
    slope: Float[Array, "N+1 3"]  # true Pi_x, Pi_y, Pi_psi that the command's sign selects, eqs. (13), (17)
    f2: Float[Array, "N+1 2"]  # m/s^2, Zb1 + delta - xi2' + F + d(U), after eq. (36)
    F_psi: Float[Array, " N+1"]  # rad/s, d(omega_bar) + delta_psi, eq. (60)
    S: Float[Array, "N+1 n"]  # activations, eq. (20), at chi2 and
    S_psi: Float[Array, "N+1 n"]  # at psi
    gain: Float[Array, "N+1 2"]  # n = varphi S'S / (2 b^2), position and heading, eqs. (41), (63)
    disturbance: Float[Array, "N+1 3"]  # m/s^2, m/s^2, rad/s
    velocity: Float[Array, "N+1 2"]  # m/s, of the reference
    reference_acceleration: Float[Array, "N+1 2"]  # m/s^2
    heading_rate: Float[Array, " N+1"]  # rad/s, psi_d'


@jax.jit
def papers_deadzones(scenario: agvjax.Scenario) -> dict[str, agvjax.Deadzone]:
    """The deadzones of a scenario; the proof speaks of no other element in their place."""
    return {name: part for name, part in scenario.deadzone.items() if isinstance(part, agvjax.Deadzone)}


# long: a line for each signal of the proof
def signals(controller: agvjax.NeuroBackstepping, scenario: agvjax.Scenario, trajectory: agvjax.Trajectory) -> Signals:
    """The signals of eqs. (21)-(60) along a trajectory, recomputed from its states; works under `jax.vmap`.

    d and delta are taken together as what is delivered beyond Pi times the command, from eq. (6).
    """
    controller, scenario = cast((controller, scenario), trajectory.t.dtype)
    deadzones = papers_deadzones(scenario)

    def one(r: agvjax.Trajectory) -> Signals:
        ref, s = reference(scenario.path, scenario.heading, r.t), r.controller
        state = DecoupledState(position=r.position, velocity=r.velocity, heading=r.heading)
        seen = Measurement(position=r.position, velocity=r.velocity, heading=r.heading, yaw_rate=jnp.zeros_like(r.t))
        delivered = {"position": r.delivered[:2], "heading": r.delivered[2]}
        delta = scenario.disturbance(r.t)
        plant = scenario.plant.derivative(state, (), delivered, delta)  # (6)
        law = controller.law(s, (), seen, ref)[1]
        Z1 = r.position - ref.position
        Z3 = r.heading - ref.heading
        slope = deadzones["position"].slope(r.command[:2])
        slope_psi = deadzones["heading"].slope(r.command[2])
        share, share_psi = controller.shares(seen)
        return Signals(
            t=r.t,
            Z1=Z1,
            Zb1=Z1 - s.xi1,
            Zb2=r.velocity - s.phi1 - s.xi2,
            Z3=wrap(Z3) if controller.wrapped else Z3,
            filter_error=s.phi1 - controller.virtual_control(Z1, s.beta1, ref.velocity),
            phi1_rate=law.phi1,
            rate=jnp.append(plant.velocity, plant.heading),
            command=r.command,
            slope=jnp.append(slope, slope_psi),
            f2=Z1 - s.xi1 - law.xi2 + plant.velocity - slope * r.command[:2],
            F_psi=plant.heading - slope_psi * r.command[2],
            S=controller.position_network(r.velocity),
            S_psi=controller.heading_network(r.heading),
            gain=jnp.stack([s.network.varphi * share, s.network.varphi_psi * share_psi]),
            disturbance=delta,
            velocity=ref.velocity,
            reference_acceleration=ref.acceleration,
            heading_rate=ref.heading_rate,
        )

    return jax.vmap(one)(dataclasses.replace(trajectory, ok=trajectory.t, weight_norm=None))


@pytree
class Constants:
    """The constants of the proof and what they are made of; numbers in SI units. Suprema are over t >= `since`."""

    a1: Float[Array, ""]  # 1/s, eq. (48), with the smallest slope
    a2: Float[Array, ""]  # eq. (48) as printed
    a2_repaired: Float[Array, ""]  # with what (48) drops
    a3: Float[Array, ""]  # 1/s, eq. (52), never defined in print
    a4: Float[Array, ""]  # eq. (52), never defined in print
    a5: Float[Array, ""]  # 1/s, eq. (70), with the smallest slope
    a6: Float[Array, ""]  # eq. (70) as printed, eps_psi^2 counted twice
    a6_repaired: Float[Array, ""]  # with what (70) drops, eps_psi^2 counted once
    N1: Float[Array, ""]  # m, sup |xi1|, before eq. (50)
    eta: Float[Array, ""]  # m/s, sup |phi1 - alpha1|, after eq. (22)
    phi: Float[Array, ""]  # |W|^2 of the best weights, after eq. (38)
    phi_psi: Float[Array, ""]  # after eq. (61)
    eps: Float[Array, ""]  # m/s^2, sup of the residual's norm, eq. (37)
    eps_psi: Float[Array, ""]  # rad/s, eq. (60)

    @property
    def position(self) -> Float[Array, ""]:
        """Eq. (50) as printed: ultimate bound on |Z1| [m]."""
        return _ultimate(self.a1, self.a2) + self.N1

    @property
    def compensator(self) -> Float[Array, ""]:
        """Eq. (54) as printed: ultimate bound on |xi1| and |xi2|."""
        return _ultimate(self.a3, self.a4)

    @property
    def heading(self) -> Float[Array, ""]:
        """Eq. (72) as printed: ultimate bound on |Z3| [rad]."""
        return _ultimate(self.a5, self.a6)

    @property
    def repaired(self) -> Float[Array, "2"]:
        """Eqs. (50) and (72) with a2_repaired and a6_repaired [m, rad]."""
        return jnp.stack([_ultimate(self.a1, self.a2_repaired) + self.N1, _ultimate(self.a5, self.a6_repaired)])


def _ultimate(rate: Array, drive: Array) -> Array:
    """What L' <= -rate L + drive leaves of an error whose half square is in L; infinite where a margin is lost."""
    return jnp.where(rate > 0, jnp.sqrt(2 * drive / jnp.where(rate > 0, rate, 1.0)), jnp.inf)


def constants(
    controller: agvjax.NeuroBackstepping,
    scenario: agvjax.Scenario,
    trajectory: agvjax.Trajectory,
    since: Real = 0.0,
    ridge: Real = RIDGE,
) -> Constants:
    """a1..a6 of eqs. (48), (52), (70); works under `jax.vmap`.

    The "ideal" weights W, (N, 2) for the position, are those that minimise mean |f - W'S|^2 + `ridge` |W|^2 over the
    samples t >= `since` [s], and phi is the square of their Frobenius norm. Without the ridge phi is whatever the nodes
    that are never awake happen to need. The repair adds what R14 lists, Pi eta phi^2 / (2 gamma) (Pi the largest) and
    Lambda^2 sup|beta1|^2 / 2, and a1 Lambda sup|beta|^2 / 2, since the integral part of L2 and L4 has no -beta^2 term
    in their derivatives. It still takes Pi_hat = Pi for granted, for (42), and Pi for constant.
    """
    s = signals(controller, scenario, trajectory)
    return _constants(controller, papers_deadzones(scenario), trajectory.controller, s, since, ridge)


@jax.jit
# long: a line for each constant of the proof
def _constants(
    k: agvjax.NeuroBackstepping,
    deadzone: dict[str, agvjax.Deadzone],
    law: BacksteppingState,
    s: Signals,
    since: Real,
    ridge: Real,
) -> Constants:
    late = s.t >= since

    def supremum(x: Array) -> Array:
        return jnp.max(jnp.where(late, jnp.sqrt(jnp.sum(x.reshape(late.size, -1) ** 2, axis=1)), 0.0))

    def fit(S: Array, f: Array) -> tuple[Array, Array]:
        f = f.reshape(late.size, -1)
        awake = jnp.where(late[:, None], S, 0.0).T / jnp.sum(late, dtype=S.dtype)
        W = jnp.linalg.solve(awake @ S + ridge * jnp.eye(S.shape[1], dtype=S.dtype), awake @ f)
        return jnp.sum(W**2), supremum(f - S @ W)

    (low, high), (low_psi, high_psi) = (slope_range(deadzone[name]) for name in ("position", "heading"))
    phi, eps = fit(s.S, s.f2)
    phi_psi, eps_psi = fit(s.S_psi, s.F_psi)
    N1, eta, beta1, beta2 = (supremum(x) for x in (law.xi1, s.filter_error, law.beta1, law.beta2))
    a1 = jnp.minimum(jnp.minimum(2 * k.k1, 2 * (low * k.k2 - 0.5)), k.eta1)
    a2 = N1**2 / 2 + k.b1**2 / 2 + eps**2 / 2
    a5 = jnp.minimum(2 * (low_psi * k.k3 - 0.5), k.eta2)
    drive = k.b2**2 / 2 + eps_psi**2 / 2
    forgotten = high * k.eta1 / (2 * k.gamma1) * phi**2 + (k.Lam**2 + a1 * k.Lam) * beta1**2 / 2
    forgotten_psi = high_psi * k.eta2 / (2 * k.gamma2) * phi_psi**2 + a5 * k.Lam_psi * beta2**2 / 2
    return Constants(
        a1=a1,
        a2=a2,
        a2_repaired=a2 + forgotten,
        a3=jnp.minimum(2 * (k.k1 - 1), 2 * k.k2 - 1),
        a4=eta**2 / 2,
        a5=a5,
        a6=drive + eps_psi**2 / 2,
        a6_repaired=drive + forgotten_psi,
        N1=N1,
        eta=eta,
        phi=phi,
        phi_psi=phi_psi,
        eps=eps,
        eps_psi=eps_psi,
    )


def slope_range(deadzone: agvjax.Deadzone) -> tuple[Array, Array]:
    """The smallest and the largest true slope, eq. (15)."""
    right, left = deadzone.slope_right, deadzone.slope_left
    return jnp.minimum(right, left), jnp.maximum(right, left)


def margins(controller: agvjax.NeuroBackstepping, scenario: agvjax.Scenario) -> dict[str, float]:
    """What must be positive for (48), (52) and (70) to bound anything, by name."""
    low, low_psi = (float(slope_range(papers_deadzones(scenario)[name])[0]) for name in ("position", "heading"))
    k1, k2, k3 = (float(x) for x in (controller.k1, controller.k2, controller.k3))
    found = {"k1 - 1": k1 - 1, "k2 - 1/2": k2 - 0.5}
    found |= {"Pi_min k2 - 1/2": low * k2 - 0.5, "Pi_psi_min k3 - 1/2": low_psi * k3 - 0.5}
    return found | {name: float(getattr(controller, name)) for name in ("gamma1", "gamma2", "eta1", "eta2", "b1", "b2")}


@pytree
class Functions:
    """The four Lyapunov functions along a run, SI numbers."""

    L1: Float[Array, " N+1"]  # eq. (26)
    L2: Float[Array, " N+1"]  # eq. (34)
    L3: Float[Array, " N+1"]  # eq. (51)
    L4: Float[Array, " N+1"]  # eq. (58)


def functions(
    controller: agvjax.NeuroBackstepping, scenario: agvjax.Scenario, trajectory: agvjax.Trajectory, found: Constants
) -> Functions:
    """Eqs. (26), (34), (51), (58), with phi and phi_psi from `constants`; works under `jax.vmap`.

    Pi is the true slope that each command's sign selects, and jumps with it (reading R14). L2 has one phi for two axes:
    its Pi is the mean of theirs.
    """
    s, k, law = signals(controller, scenario, trajectory), controller, trajectory.controller
    L1 = jnp.sum(s.Zb1**2 + k.Lam * law.beta1**2, axis=1) / 2
    missing, missing_psi = found.phi - law.network.varphi, found.phi_psi - law.network.varphi_psi
    weights = jnp.mean(s.slope[:, :2], axis=1) / (2 * k.gamma1) * missing**2
    weights_psi = s.slope[:, 2] / (2 * k.gamma2) * missing_psi**2
    return Functions(
        L1=L1,
        L2=L1 + jnp.sum(s.Zb2**2, axis=1) / 2 + weights,
        L3=jnp.sum(law.xi1**2 + law.xi2**2, axis=1) / 2,
        L4=(s.Z3**2 + k.Lam_psi * law.beta2**2) / 2 + weights_psi,
    )


def exponential_bound(t: Array | np.ndarray, start: Array | np.ndarray, rate: Real, drive: Real) -> Array | np.ndarray:
    """Eqs. (49), (53), (71): drive/rate + (start - drive/rate) exp(-rate t), what L' <= -rate L + drive allows.

    `t` [s] from the start, any shape; `start` is L there; (rate, drive) is (a1, a2), (a3, a4) or (a5, a6). It makes no
    allowance for the jumps of L2 and L4 with Pi: counted from 4 s on, L2 does leave it in the paper's own lap.
    """
    return drive / rate + (start - drive / rate) * jnp.exp(-rate * t)


@jax.jit
def compensation(
    controller: agvjax.NeuroBackstepping, scenario: agvjax.Scenario, trajectory: agvjax.Trajectory
) -> tuple[Array, Array]:
    """What eq. (23) does to the commands: max |d command / d xi1| and max |xi2| along a run, both exactly 0."""
    controller, scenario = cast((controller, scenario), trajectory.t.dtype)

    def sensitivity(t: Array, position: Array, velocity: Array, heading: Array, s: BacksteppingState) -> Array:
        seen = Measurement(position=position, velocity=velocity, heading=heading, yaw_rate=jnp.zeros_like(t))
        ref = reference(scenario.path, scenario.heading, t)

        def command(xi1: Array) -> Array:
            return as_vector(controller.law(dataclasses.replace(s, xi1=xi1), (), seen, ref)[0], heading=True)

        return jax.jacfwd(command)(s.xi1)

    r = trajectory
    slopes = jax.vmap(sensitivity)(r.t, r.position, r.velocity, r.heading, r.controller)
    return jnp.max(jnp.abs(slopes)), jnp.max(jnp.abs(r.controller.xi2))
