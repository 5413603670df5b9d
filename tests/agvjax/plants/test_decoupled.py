"""The paper's plant by hand, and its coupling beside what two derivatives of the reference point leave."""

import jax.numpy as jnp
import numpy as np

from agvjax import Decoupled, TurnedVelocity
from agvjax.plants import DecoupledState
from agvjax.readings import ForwardSpeed, KinematicYawRate


def unicycle(t):
    """Position and heading of a vehicle that rolls: v = 1 + .3 t, psi = .4 + .5 t^2, (1) by Gauss quadrature."""
    psi = 0.4 + 0.5 * t**2
    s, weight = np.polynomial.legendre.leggauss(40)
    s, weight = t * (s + 1) / 2, weight * t / 2
    speed, angle = 1 + 0.3 * s, 0.4 + 0.5 * s**2
    return np.array([weight @ (speed * np.cos(angle)), weight @ (speed * np.sin(angle))]), psi


def test_coupling_is_what_two_derivatives_of_the_reference_point_leave():
    # chi1'' = F + v' (cos, sin) + L w' (-sin, cos) for the point L ahead of a vehicle that rolls without slip, (2)-(4)
    L, t, h = 0.5, 0.9, 1e-3

    def point(time):
        position, psi = unicycle(time)
        return position + L * np.array([np.cos(psi), np.sin(psi)])

    stencil = [point(t + k * h) for k in (-2, -1, 0, 1, 2)]
    second = np.array([-1, 16, -30, 16, -1]) @ stencil / (12 * h**2)
    velocity = np.array([1, -8, 0, 8, -1]) @ stencil / (12 * h)
    psi, w, w_rate, v_rate = 0.4 + 0.5 * t**2, t, 1.0, 0.3
    ahead, aside = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    wanted = second - v_rate * ahead - L * w_rate * aside
    state = DecoupledState(position=jnp.zeros(2), velocity=jnp.array(velocity), heading=jnp.array(psi))
    for coupling in (ForwardSpeed(), TurnedVelocity()):  # the lateral velocity of the point is L w here: both hold
        np.testing.assert_allclose(coupling(state, jnp.array(w), L), wanted, rtol=0, atol=1e-8)
    np.testing.assert_allclose(KinematicYawRate()(state, {}, L), w, rtol=1e-9)


def test_couplings_part_by_what_the_lateral_velocity_lacks():
    # velocity (a along, b aside): turned - printed = w (L w - b) ahead, for any motion
    L, psi, w, along, aside = 0.5, 0.7, 1.3, 0.9, -0.2
    ahead, left = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    state = DecoupledState(
        position=jnp.zeros(2), velocity=jnp.array(along * ahead + aside * left), heading=jnp.array(psi)
    )
    gap = TurnedVelocity()(state, jnp.array(w), L) - ForwardSpeed()(state, jnp.array(w), L)
    np.testing.assert_allclose(gap, w * (L * w - aside) * ahead, atol=1e-14)


def test_decoupled_plant_by_hand():
    state = DecoupledState(position=jnp.zeros(2), velocity=jnp.array([2.0, 3.0]), heading=jnp.array(0.5))
    delivered = {"position": jnp.array([10.0, 20.0]), "heading": jnp.array(0.1)}
    rate = Decoupled().derivative(state, (), delivered, jnp.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(rate.position, [2, 3])
    np.testing.assert_allclose(rate.velocity, [-0.3 + 10 + 1, 0.2 + 20 + 2], rtol=1e-14)
    np.testing.assert_allclose(rate.heading, 3.1)
    assert Decoupled().feedthrough and not Decoupled(yaw_rate=KinematicYawRate()).feedthrough
