"""A path by arc length: what a vehicle follows that looks at where it is and not at a clock.

Laid on the host (`Route.along` any path, `Route.through` points, `Route.corners` points joined by straight lines) and
looked up in the loop. A route has one or more legs, each driven forwards or backwards; where they meet the vehicle
stops, for as long as it is told, and goes on or turns back. Its speed is a profile over the arc length. A law remembers
its progress along the route (`Place`), moved at its instants by `Route.follow`: so it stays on its branch where the
route crosses itself.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._pytree import POSITIVE, Numbers, Real, number, pytree, structure
from ..geometry import direction, safe_sqrt
from ..protocols import Path
from .corners import corners
from .laying import Laid, along, through
from .pieces import FLAT, Leg, Piece, by_clock, far, look, of_leg
from .place import Place
from .profile import SpeedLimits

PACE = 4.0  # times its own motion, that progress may move in a step: inside a curve it is faster than the vehicle
SLIDE, SLOWEST = 1e-3, 0.05  # of the route's length, but at most m, by which progress may move in a step at rest
STILL = 1e-12  # m^2/s^2, squared speeds below which are rounding: it stands
TURN = 1.0  # m that a radian of a wrong heading counts as where a vehicle looks for its place; or a tenth of the length


@pytree
class Route(Path):
    """A path by arc length with a speed profile, driven forwards and backwards; made by one of its class methods.

    By a clock (`route(t)`) it is run at its profile from its beginning, once, or again and again where it is closed.
    """

    table: Numbers  # (12, n) m, coefficients of the powers of the share of n pieces, x then y
    squares: Numbers  # (2, n) m^2/s^2, squared speed at the beginning of each piece, and its change over it
    instants: Numbers  # (n + 1,) s, when each piece begins by the clock, and the end
    legs: Numbers  # (5, m) of each leg: beginning [m], pieces in a metre, first piece, sign, standing at its end [s]
    length: Numbers  # m
    reached: Real = number(0.02, "m", POSITIVE, "from the end of a leg, where it is done")
    half_widths: Numbers | None = None  # (4, n) m, left and right at the beginning of each piece, and their changes
    closed: bool = structure(False)
    made: str = structure("")  # the table of TOML that it was laid of, as JSON; empty where Python laid it
    origin: tuple[float, float] = structure((0.0, 0.0))  # m, where of the map in `made` it counts from

    @classmethod
    def along(
        cls,
        path: Path,
        *,
        until: float | None = None,
        faster: float = 1.0,
        limits: SpeedLimits | None = None,
        half_width: ArrayLike = 0.0,
    ) -> Route:
        """The route of any path, at its own speed.

        Args:
            path: with a lap or an end, or `until` [s] says how much of it.
            until: where [s] the route ends by the path's clock; None takes the path's lap (closed) or end.
            faster: times the path's own speed.
            limits: what the speed is reduced to; see `SpeedLimits`.
            half_width: of a corridor [m], one or left and right; 0: no corridor.

        Raises:
            ValueError: a path without an end, or one that stands still or has a corner.
        """
        return cls._of(along(path, until, faster), limits, half_width)

    @classmethod
    def through(
        cls,
        points: ArrayLike,
        speed: ArrayLike | None = None,
        *,
        dwell: ArrayLike = 0.0,
        closed: bool = False,
        limits: SpeedLimits | None = None,
        half_width: ArrayLike = 0.0,
    ) -> Route:
        """A spline through points (N, 2) [m], as `Waypoints.through` lays it, driven backwards where speed is negative.

        A leg ends where the sign changes, at the first point with the other one, and where the vehicle stops.

        Args:
            points: (N, 2) m, or (N, 3) with a speed each.
            speed: m/s, one or one for each point; 1 m/s where none is given; 0 at stops, reached at the speed around.
            dwell: how long [s] it stands: at every point of speed 0, or a time for each point, above 0 where it stops.
            closed: whether it goes on from the last point to the first.
            limits: what the speed is reduced to; see `SpeedLimits`.
            half_width: of a corridor [m], one, left and right, or (N, 2); 0: no corridor.

        Raises:
            ValueError: too few points, equal ones, numbers that are none, a stop on a closed route or at an end.
        """
        return cls._of(through(points, speed, closed, dwell), limits, half_width)

    @classmethod
    def corners(
        cls,
        points: ArrayLike,
        speed: ArrayLike | None = None,
        *,
        radius: float | None = None,
        tolerance: float | None = None,
        dwell: ArrayLike = 0.0,
        closed: bool = False,
        limits: SpeedLimits | None = None,
        half_width: ArrayLike = 0.0,
    ) -> Route:
        """Straight lines between points (N, 2) [m], their corners rounded by arcs; arguments as those of `through`.

        Args:
            points: the corners.
            speed: m/s, one or one for each line by its first point; negative: backwards.
            radius: of every corner [m].
            tolerance: how far [m] from a corner its arc may pass; arcs are made as wide as it and the lines allow.
            dwell: as in `through`; at a corner it stands in the middle of the arc.
            closed: whether a line leads from the last point to the first.
            limits: what the speed is reduced to.
            half_width: of a corridor [m].

        Raises:
            ValueError: as `through`; neither or both of radius and tolerance; a corner that an arc does not fit in.
        """
        return cls._of(corners(points, speed, closed, radius, tolerance, dwell), limits, half_width)

    @classmethod
    def _of(cls, laid: Laid, limits: SpeedLimits | None, half_width: ArrayLike) -> Route:
        parts: dict[str, Any] = laid.tables(SpeedLimits() if limits is None else limits, half_width)
        return cls(**parts, closed=laid.closed)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m] at time `t` [s] of a vehicle that runs at the profile."""
        return self._at(*self.clock(t)).position

    def bearing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad] at time `t` [s]; backwards the vehicle looks back."""
        return self._at(*self.clock(t)).heading()

    def by_arc(self) -> bool:
        """It is."""
        return True

    def end(self) -> float:
        """When [s] an open route ends by the clock."""
        return np.inf if self.closed else float(np.asarray(self.instants)[-1])

    def lap(self) -> float | None:
        """Time [s] of one lap of a closed route."""
        return float(np.asarray(self.instants)[-1]) if self.closed else None

    def clock(self, t: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Arc length [m] and leg at a time [s], at constant acceleration within a piece."""
        end = jnp.asarray(self.instants)[-1]
        # not clip: its slope is a half at either end
        t = jnp.mod(t, end) if self.closed else jnp.where(t > end, end, jnp.where(t < 0, jnp.zeros_like(t), t))
        return by_clock(t, self.instants, self.legs, self.look)

    def ahead_of_clock(self, arc: Float[Array, ""], clock: Float[Array, ""]) -> Float[Array, ""]:
        """How far [m] a vehicle is before where it would be by the clock; on a closed route at most half a lap."""
        away, length = arc - clock, jnp.asarray(self.length)
        return away - length * jnp.round(away / length) if self.closed else away

    def at(self, arc: Float[Array, ""], leg: Float[Array, ""]) -> Place:
        """The route at an arc length [m] of a leg, at most at its end; of a closed route of any lap."""
        return self._at(self._kept(arc, leg), leg)

    def _at(self, arc: Array, leg: Array) -> Place:
        return self._on(self._piece(arc, leg), arc, leg)

    def _piece(self, arc: Array, leg: Array) -> Piece:
        return Piece.of(functools.partial(self.look, "table"), self.of_leg(leg), arc)

    def _on(self, piece: Piece, arc: Array, leg: Array) -> Place:
        """A place whose piece has been looked up."""
        share = piece.share(arc)
        p, rate, second = piece.curve(share)
        length, inside = jnp.sqrt(jnp.sum(rate * rate)), jnp.clip(share, 0, 1)
        square, change = (self.look("squares", k, piece.number) for k in range(2))
        squared, room = square + change * inside, None
        if self.half_widths is not None:
            left, left_change, right, right_change = (self.look("half_widths", k, piece.number) for k in range(4))
            room = left + inside * left_change, right + inside * right_change
        return Place(
            arc=arc,
            leg=leg,
            position=p,
            tangent=rate / length,
            curvature=(rate[0] * second[1] - rate[1] * second[0]) / length**3,
            speed=safe_sqrt(jnp.where(squared < STILL, 0, squared)),
            sign=piece.leg.sign,
            remaining=self._leg_end(leg) - arc,
            waited=jnp.zeros_like(arc),
            room=room,
        )

    def follow(
        self, position: Float[Array, "2"], place: Place, velocity: Float[Array, "2"], h: Array, waits: bool = True
    ) -> Place:
        """The place of a vehicle that was at another `h` [s] ago: the nearest point of its leg, or the next leg.

        By Newton's method from the curve as it was there. Progress moves by little more than the vehicle can have come,
        so that it does not leap to another branch; and to the next leg as `onward` says.
        """
        most = PACE * h * safe_sqrt(jnp.sum(velocity**2)) + jnp.minimum(SLIDE * jnp.asarray(self.length), SLOWEST)
        tight = jnp.maximum(1 - place.curvature * place.across(position), FLAT)
        arc = self._kept(place.arc + jnp.clip(place.ahead(position) / tight, -most, most), place.leg)
        piece = self._piece(arc, place.leg)
        arc = piece.nearest(position, arc, most)
        kept = self._kept(arc, place.leg)  # the piece of a closed route goes on past the seam
        now = self._on(piece, self.by_kind(lambda: arc, lambda: kept), place.leg)
        return self.onward(dataclasses.replace(now, arc=kept, waited=place.waited), h, waits)

    def onward(self, place: Place, h: Float[Array, ""], waits: bool = True) -> Place:
        """The beginning of the next leg where no more than `reached` [m] of this one is left and it has stood there.

        It `waits` from the instant at which it gets there, for the number of steps of `h` [s] next to its dwell time.
        """
        if self.legs.shape[1] == 1:
            return place
        there = (place.remaining <= self.reached) & (place.leg < self.last_leg())
        waited = place.waited + there.astype(place.waited.dtype)
        over = there & ((waited - 0.5) * h > self.of_leg(place.leg).dwell) if waits else there
        arc = jnp.where(over, self._leg_end(place.leg), place.arc)
        now = self._at(arc, place.leg + over.astype(place.leg.dtype))
        return dataclasses.replace(now, waited=jnp.where(over, 0, waited))

    def arrived(self, place: Place) -> Bool[Array, ""]:
        """Whether a vehicle is within `reached` of the end of an open route."""
        return (place.leg >= self.last_leg()) & (place.remaining <= self.reached)

    def stands(self, place: Place) -> Bool[Array, ""]:
        """Whether a vehicle has to stand: at the end, or at a stop that it has not waited at for long enough."""
        return (place.remaining <= self.reached) & ((place.leg >= self.last_leg()) | (place.waited > 0))

    def search(self, position: Float[Array, "2"], heading: Float[Array, ""]) -> Place:
        """Where on the whole route a vehicle with this heading starts: near, and in the direction that it looks in.

        Of two places the nearer one, a heading that is off by an angle a counted as 2 sin(a / 2) m, at most as that
        times a tenth of the route's length. On a route with several legs it starts with the first.
        """
        leg, on = jnp.zeros_like(heading), self.of_leg(jnp.zeros_like(heading))
        score = far(position, direction(heading) * on.sign, jnp.minimum(TURN, jnp.asarray(self.length) / 10))
        arc = self.least(score, (0, 1, 6, 7), on.beyond) / on.pace
        arc = self.again(lambda s: self._kept(self._piece(s, leg).nearest(position, s, 1 / on.pace), leg), 3, arc)
        return self._at(arc, leg)

    def _kept(self, arc: Array, leg: Array) -> Array:
        """Within the leg, or on the lap."""
        length, on = jnp.asarray(self.length), self.of_leg(leg)
        return self.by_kind(lambda: arc - length * jnp.floor(arc / length), lambda: jnp.clip(arc, on.begins, on.ends))

    def _leg_end(self, leg: Array) -> Array:
        """Where [m] the leg ends."""
        return self.by_kind(lambda: jnp.full_like(leg, jnp.inf), lambda: self.of_leg(leg).ends)

    # All that the loop looks up in its tables; an exporter looks them up in a language of its own.

    def again(self, function: Callable[[Array], Array], times: int, value: Array) -> Array:
        """A function of its own result, so many times; compiled once."""
        return jax.lax.fori_loop(0, times, lambda _, x: function(x), value)

    def by_kind(self, closed: Callable[[], Array], opened: Callable[[], Array]) -> Array:
        """A value of a closed route, or that of an open one."""
        return closed() if self.closed else opened()

    def last_leg(self) -> Real:
        """The number of its last leg."""
        return self.legs.shape[1] - 1

    def of_leg(self, leg: Array) -> Leg:
        """The numbers of a leg."""
        rows = [jnp.asarray(row) for row in self.legs]
        ends, beyond = (jnp.append(rows[k], end) for k, end in ((0, self.length), (2, self.table.shape[1])))
        if self.legs.shape[1] == 1:
            return Leg.of([row[0] for row in rows], ends[1], beyond[1])
        return Leg.of([of_leg(row, leg) for row in rows], of_leg(ends, leg + 1), of_leg(beyond, leg + 1))

    def look(self, table: str, row: int, number: Array) -> Array:
        """The number of a piece in a row of `table`, `squares` or `half_widths`."""
        tables: dict[str, Any] = {"table": self.table, "squares": self.squares, "half_widths": self.half_widths}
        return look(tables[table], row, number)

    def least(self, score: Callable[..., Array], rows: tuple[int, ...], beyond: Array) -> Array:
        """The number of the piece before `beyond` with the least score, a function of these rows of `table`."""
        numbers = jnp.arange(self.table.shape[1])
        scores = score(*(jnp.asarray(self.table)[row] for row in rows))
        return jnp.argmin(jnp.where(numbers.astype(beyond.dtype) < beyond, scores, jnp.inf)).astype(beyond.dtype)
