"""Pieces of a route, looked up in its tables: quintic polynomials of the share of a piece."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from .._pytree import Numbers
from ..geometry import safe_sqrt

STEPS = 2  # of Newton's method on a piece
FLAT = 0.2  # least of 1 - curvature x deviation in them: at 0 lies the centre of the curve, equally near to all of it


class Leg(NamedTuple):
    """Numbers of a leg, or of all legs in rows."""

    begins: Array  # m
    ends: Array  # m
    offset: Array  # m, where it begins, less the pieces before that
    pace: Array  # pieces in a metre
    first: Array  # its first piece
    beyond: Array  # the first piece that is the next leg's
    sign: Array  # 1 forwards, -1 backwards
    dwell: Array  # s, how long a vehicle stands where it ends

    @classmethod
    def of(cls, rows: Sequence[Array], ends: Array, beyond: Array) -> Leg:
        """From rows of a route's table of legs, and where a leg ends."""
        begins, pace, first, sign, dwell = rows
        return cls(begins, ends, begins - first / pace, pace, first, beyond, sign, dwell)


class Piece(NamedTuple):
    """A piece of a route, looked up."""

    number: Array  # whole, as a real number
    coefficients: list[Array]  # (12,) m, of the powers of the share
    leg: Leg

    @classmethod
    def of(cls, look: Callable[[int, Array], Array], leg: Leg, arc: Array) -> Piece:
        """The piece of an arc length; beyond the ends of the leg its first or last. `look` finds a coefficient."""
        number = jnp.clip(jnp.floor((arc - leg.offset) * leg.pace), leg.first, leg.beyond - 1)
        return cls(number, [look(k, number) for k in range(12)], leg)

    def share(self, arc: Array) -> Array:
        """How much of it lies before an arc length."""
        return (arc - self.leg.offset) * self.leg.pace - self.number

    def curve(self, share: Array) -> tuple[Array, Array, Array]:
        """Position, and its first and second derivative by the share."""
        values = []
        for k in (0, 6):
            c0, c1, c2, c3, c4, c5 = self.coefficients[k : k + 6]
            x = c0 + share * (c1 + share * (c2 + share * (c3 + share * (c4 + share * c5))))
            rate = c1 + share * (2 * c2 + share * (3 * c3 + share * (4 * c4 + share * 5 * c5)))
            second = 2 * c2 + share * (6 * c3 + share * (12 * c4 + share * 20 * c5))
            values.append((x, rate, second))
        p, rate, second = (jnp.stack(pair) for pair in zip(*values, strict=True))
        return p, rate, second

    def nearest(self, position: Array, arc: Array, most: Array) -> Array:
        """The arc length [m] of its point nearest to a position, no step longer than `most` [m]."""
        for _ in range(STEPS):
            p, rate, second = self.curve(self.share(arc))
            away = position - p
            slope, bend = jnp.sum(away * rate), jnp.sum(rate * rate)
            step = slope / jnp.maximum(bend - jnp.sum(away * second), FLAT * bend) / self.leg.pace
            arc = arc + jnp.clip(step, -most, most)
        return arc


def by_clock(
    t: Array, instants: Numbers, legs: Numbers, look: Callable[[str, int, Array], Array]
) -> tuple[Array, Array]:
    """Arc length [m] and leg at a time [s] within a route, at constant acceleration within a piece."""
    instants, last = jnp.asarray(instants), instants.shape[0] - 1
    piece = jnp.clip(jnp.searchsorted(instants, t, side="right") - 1, 0, last - 1)
    square, change = (look("squares", k, piece) for k in range(2))
    begins, pace, first, _, _ = (jnp.asarray(row) for row in legs)
    leg = jnp.sum(piece.astype(t.dtype) >= first).astype(int) - 1
    after = t - instants[piece]
    if legs.shape[1] > 1:  # where a leg ends it may stand for a while
        whole = 2 / (pace[leg] * (safe_sqrt(square) + safe_sqrt(square + change)))
        after = jnp.where(after > whole, whole, after)
    way = after * (safe_sqrt(square) + after * change * pace[leg] / 4)
    return begins[leg] + (piece.astype(t.dtype) - first[leg]) / pace[leg] + way, leg.astype(t.dtype)


def far(position: Array, ahead: Array, weight: Array) -> Callable[..., Array]:
    """A function of where a piece begins and of its slope there: squared distance, and by `weight` [m] off `ahead`."""
    x0, y0, x_ahead, y_ahead = position[0], position[1], ahead[0], ahead[1]

    def score(x: Array, x_rate: Array, y: Array, y_rate: Array) -> Array:
        cosine = (x_ahead * x_rate + y_ahead * y_rate) / jnp.sqrt(x_rate**2 + y_rate**2)
        return (x - x0) ** 2 + (y - y0) ** 2 + 2 * weight**2 * (1 - cosine)

    return score


def look(table: Numbers, row: int, number: Array) -> Array:
    """The number of a piece in a row of a table; of the flat one, so that no row of it is copied."""
    flat = jnp.asarray(table).reshape(-1)
    index = number.astype(int) + row * table.shape[1]
    return flat.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def of_leg(row: Array, leg: Array) -> Array:
    """The number of a leg, or that at the nearest end."""
    return row.at[jnp.asarray(leg).astype(int)].get(mode="clip", wrap_negative_indices=False)
