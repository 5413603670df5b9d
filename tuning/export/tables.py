"""A route whose tables are looked up by the exported code: each lookup, and the search, becomes an operation by name.

The laws and `agvjax.Route` themselves are traced with it. Nothing of one route is in the trace: how many pieces
and legs it has, and whether it is closed, are arguments.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive
from jaxtyping import Array, Float, PyTree

from agvjax import Route
from agvjax._pytree import Real, pytree
from agvjax.messages import Reference
from agvjax.paths.pieces import Leg
from agvjax.paths.place import Place

from ..io.files import Json


class Table(NamedTuple):
    """A table of a route as it is exported, of rows that have a number for each piece or for each leg."""

    name: str
    columns: str  # one of `Sizes`: how many
    meaning: str  # and unit


TABLES = {  # by the names that they have in a `Route`
    "table": Table("coefficients", "pieces", "m, 12 rows: of the powers 0 to 5 of the share of a piece, x, then y"),
    "squares": Table("squared_speeds", "pieces", "m^2/s^2, 2 rows: where the piece begins, and the change over it"),
    "legs": Table(
        "each_leg",
        "legs",
        "5 rows: where it begins [m], pieces in a metre, its first piece, 1 or -1 backwards, standing at its end [s]",
    ),
}
CORRIDOR = "half_widths"  # a table that is not exported
UNITS = {"length": "m", "reached": "m, from the end of a leg, where it is done"}
UNITS |= {"pieces": "how many", "legs": "how many", "closed": "1 where its end is its beginning, else 0"}

lookup_p = Primitive("agvjax_lookup")  # number of a column, of all columns -> the number there; nearest end beyond them
lookup_p.def_abstract_eval(lambda index, count, *, table, row: index.update(weak_type=False))
least_p = Primitive("agvjax_least")  # count, what `score` captures -> the column before `count` with the least score
least_p.def_abstract_eval(lambda count, *captured, score: count.update(weak_type=False))


class Sizes(NamedTuple):
    """What a route is besides its tables, all real numbers; the names are those of members of the exported route."""

    pieces: Any  # how many
    legs: Any  # how many
    closed: Any  # 1 of a closed route, else 0
    length: Any  # m
    reached: Any  # m, from the end of a leg, where it is done

    @classmethod
    def of(cls, route: Route) -> Sizes:
        """Of a route as it is laid."""
        pieces, legs, length = route.squares.shape[1], route.legs.shape[1], np.asarray(route.length)
        return cls(float(pieces), float(legs), float(route.closed), float(length), float(route.reached))


@pytree
class Tabled(Route):
    """A route known by its sizes alone: only to be traced."""

    pieces: Real
    count: Real  # of legs
    loop: Real

    @classmethod
    def traced(cls, sizes: Sizes) -> Tabled:
        """With these sizes, which are tracers; a law that looks at its corridor is found out by that."""
        none = np.zeros((0, 0))  # of no leg, least of all of one
        return cls(
            table=none,
            squares=none,
            instants=none,
            legs=none,
            half_widths=none,
            length=sizes.length,
            reached=sizes.reached,
            pieces=sizes.pieces,
            count=sizes.legs,
            loop=sizes.closed,
        )

    def by_kind(self, closed: Callable[[], Array], opened: Callable[[], Array]) -> Array:
        """Both, and one of them is taken."""
        return jnp.where(self.loop != 0, closed(), opened())

    def again(self, function: Callable[[Array], Array], times: int, value: Array) -> Array:
        """Written one after the other."""
        for _ in range(times):
            value = function(value)
        return value

    def onward(self, place: Place, h: Array, waits: bool = True) -> Place:
        """As every route, and where it has one leg the place stays as it was found."""
        return lax.cond(self.count > 1, lambda now: super(Tabled, self).onward(now, h, waits), lambda now: now, place)

    def last_leg(self) -> Real:
        """An argument less 1."""
        return self.count - 1

    def of_leg(self, leg: Array) -> Leg:
        """Rows of the table of legs; where a leg ends, the next begins."""
        rows = [self._of_leg(row, leg) for row in range(5)]
        last = leg >= self.last_leg()
        ends, beyond = jnp.asarray(self.length), jnp.asarray(self.pieces)
        ends = jnp.where(last, ends, self._of_leg(0, leg + 1))
        return Leg.of(rows, ends, jnp.where(last, beyond, self._of_leg(2, leg + 1)))

    def _of_leg(self, row: int, leg: Array) -> Array:
        return lookup_p.bind(leg, jnp.asarray(self.count), table=TABLES["legs"].name, row=row)

    def look(self, table: str, row: int, number: Array) -> Array:
        """An operation of the exported code."""
        name = CORRIDOR if table == "half_widths" else TABLES[table].name
        return lookup_p.bind(number, jnp.asarray(self.pieces), table=name, row=row)

    def least(self, score: Callable[..., Array], rows: tuple[int, ...], beyond: Array) -> Array:
        """A loop of the exported code, over pieces one by one."""

        def of_piece(number: Array) -> Array:
            return score(*(self.look("table", row, number) for row in rows))

        closed = jax.make_jaxpr(of_piece)(jnp.zeros((), beyond.dtype))
        return least_p.bind(beyond, *closed.consts, score=closed.jaxpr)


def asked(sizes: PyTree) -> Reference:
    """What a law that follows a route is given where that is known by its sizes alone."""
    return to_follow(Tabled.traced(jax.tree.map(jnp.asarray, sizes)))


def to_follow(route: Route) -> Reference:
    """What a law that follows a route is given: the route. It looks at no clock, as in the simulator."""
    pairs = dict.fromkeys(("position", "velocity", "acceleration"), jnp.zeros(2))
    return Reference(**pairs, heading=jnp.zeros(()), heading_rate=jnp.zeros(()), route=route)


def arrays(route: Route) -> dict[str, Float[np.ndarray, "rows columns"]]:
    """The tables of a route by the names of `TABLES`, in float64."""
    tables = {"table": route.table, "squares": route.squares, "legs": route.legs}
    return {TABLES[key].name: np.asarray(x, float) for key, x in tables.items()}


def data(route: Route) -> Json:
    """A route as plain data: its sizes and its tables, rows as lists."""
    sizes: Json = Sizes.of(route)._asdict()
    counts = {name: int(sizes[name]) for name in ("pieces", "legs", "closed")}
    return sizes | counts | {name: x.tolist() for name, x in arrays(route).items()}


def numbers(route: Route) -> dict[str, np.ndarray]:
    """What of a route a module takes as arguments whose shapes and kind of route are fixed, by sorted names."""
    sizes = {"length": np.asarray(route.length, float), "reached": np.asarray(route.reached, float)}
    return dict(sorted((sizes | arrays(route)).items()))


def followed(like: Route, given: PyTree) -> Reference:
    """What a law is given to follow these `numbers`, of a route of the shapes and the kind of another."""
    tables = {field: given[table.name] for field, table in TABLES.items()}
    route = dataclasses.replace(like, **tables, length=given["length"], reached=given["reached"])
    return to_follow(route)
