"""Runs made by hand, to see what is measured of them."""

import jax.numpy as jnp

import agvjax


def trajectory(t, **given):
    """A trajectory whose position, errors and commands are zero, unless they are given."""
    pair, one, each = jnp.zeros((t.size, 2)), jnp.zeros(t.size), jnp.zeros((t.size, 3))
    places = {"position": pair, "velocity": pair, "heading": one, "reference_position": pair, "reference_heading": one}
    signals = {"command": each, "inputs": each, "delivered": each, "limited": one > 1, "controller": ()}
    return agvjax.Trajectory(**{"t": t, **places, **signals, "weight_norm": None, "ok": jnp.array(True), **given})
