"""Figures of runs whose numbers are huge, tiny, constant or not finite: drawn, and what is left out is said."""

import io

import jax.numpy as jnp
import numpy as np
import pytest

from agvjax.draw import animate, plot
from runs import trajectory

T = jnp.linspace(0.0, 1.0, 11)
ODD = {
    "constant": 7.0,
    "tiny": 5e-324,
    "large": 1e99,
    "larger": 1e300,
    "largest": 1.7e308,
    "inf": jnp.inf,
    "nan": jnp.nan,
}
NAMES = ("torque_left", "torque_right", "brake")


def odd(value, from_=0):
    """A run all of whose numbers are the value from a sample on, in either sign, and ordinary before."""
    sign, begin = jnp.where(T > 0.5, -1.0, 1.0), jnp.linspace(0.0, 1.0, T.size)
    one = jnp.where(jnp.arange(T.size) >= from_, sign * value if value != 7.0 else value, begin)
    pair, each = jnp.stack([one, one], 1), jnp.stack([one] * 3, 1)
    places = {"position": pair, "velocity": pair, "heading": one, "reference_position": -pair, "command": each}
    return trajectory(T, **places, reference_heading=-one, inputs=each, delivered=each)


def words(figure):
    return [text.get_text() for text in figure.texts]


@pytest.mark.parametrize(
    ("value", "from_"),
    [
        *(
            pytest.param(value, 0, marks=[pytest.mark.slow] * (name not in ("constant", "larger")))
            for name, value in ODD.items()
        ),
        pytest.param(1e300, 5, marks=pytest.mark.slow),
        (jnp.inf, 5),
    ],
)
def test_any_numbers_are_drawn_and_what_is_not_is_said(value, from_):
    run = odd(value, from_)
    figures = [plot.path({"run": run}, np.full((3, 2), value)), plot.errors({"run": run}), plot.commands({"run": run})]
    figures += [plot.inputs(run, NAMES)]
    for figure in figures:
        figure.savefig(io.BytesIO(), format="png", dpi=20)
        left_out = [text for text in words(figure) if text == plot.LEFT_OUT]
        assert bool(left_out) == (not abs(value) <= plot.FAR)


@pytest.mark.parametrize("value", [1e99, 1.7e308, jnp.nan])
def test_an_animation_is_of_what_can_be_shown(value):
    moving = animate.animation({"run": odd(value, 5)}, frames_per_second=4)
    animate.write_gif(moving, io.BytesIO())
    if not abs(value) <= plot.FAR:
        with pytest.raises(ValueError, match="no sample that"):
            animate.animation({"run": odd(value)})


def test_what_is_shown_is_as_it_was_or_a_gap():
    np.testing.assert_array_equal(plot.shown([1, -2.5, 1e100, 1e101, -np.inf, np.nan]), [1, -2.5, 1e100, *[np.nan] * 3])
