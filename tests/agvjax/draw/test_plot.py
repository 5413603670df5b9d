"""Figures of runs whose numbers are huge, tiny, constant or not finite: drawn, and what is left out is said."""

import dataclasses
import io

import jax.numpy as jnp
import numpy as np
import pytest

from agvjax import Route
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


def test_a_route_is_drawn_whole_with_its_stops_by_its_map_however_far_a_run_came():
    """A run that never left the first metre; on the way the vehicle stands at (4, 0), at the end it just ends."""
    points, dwell = [[0, 0], [4, 0], [4, 3], [0, 3]], [0, 2.0, 0, 0]
    route = dataclasses.replace(Route.corners(points, radius=0.5, dwell=dwell), origin=(100.0, 50.0))
    course, stops = plot.outline(route)
    np.testing.assert_allclose(course[[0, -1]], [[100, 50], [100, 53]], atol=1e-9)
    middle = [103.5 + 0.5 / np.sqrt(2), 50.5 - 0.5 / np.sqrt(2)]  # of the arc at the corner
    np.testing.assert_allclose(stops, [middle], atol=1e-6)
    assert np.abs(course[:, 1] - 50).min(initial=9, where=course[:, 0] < 103) == 0 and course[:, 0].max() <= 104 + 1e-6
    axes = plot.path({"run": odd(0.1, 0)}, way=route).axes[0]
    drawn = {line.get_label(): np.stack(line.get_data(), 1) for line in axes.get_lines()}
    np.testing.assert_array_equal(drawn["path"], course)
    np.testing.assert_array_equal(drawn["stop"], stops)
    closed = plot.outline(Route.corners(points, radius=0.5, closed=True))
    np.testing.assert_allclose(closed[0][0], closed[0][-1], atol=1e-9)
    assert len(closed[1]) == 0
