"""Runs made by hand, to see what is measured of them; runs as they would be logged."""

import csv

import jax.numpy as jnp
import numpy as np

import agvjax


def trajectory(t, **given):
    """A trajectory whose position, errors and commands are zero, unless they are given."""
    pair, one, each = jnp.zeros((t.size, 2)), jnp.zeros(t.size), jnp.zeros((t.size, 3))
    places = {"position": pair, "velocity": pair, "heading": one, "reference_position": pair, "reference_heading": one}
    signals = {"command": each, "inputs": each, "delivered": each, "limited": one > 1, "controller": ()}
    return agvjax.Trajectory(**{"t": t, **places, **signals, "weight_norm": None, "ok": jnp.array(True), **given})


def logged(file, run, commands):
    """Write a trajectory as the CSV file of a drive: time, pose and the inputs by their names."""
    columns = [
        run.t,
        run.position[:, 0],
        run.position[:, 1],
        run.heading,
        *np.asarray(run.inputs).reshape(len(run.t), -1).T,
    ]
    with open(file, "w", newline="") as log:
        rows = csv.writer(log)
        rows.writerow(["t", "x", "y", "heading", *commands])
        rows.writerows(np.stack(columns, 1).tolist())
