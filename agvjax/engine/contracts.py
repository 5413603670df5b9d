"""What a loop must be made of, said before it is stepped."""

from __future__ import annotations

from ..paths.route import Route
from ..protocols import Disturbance, Element, Heading, Law, Path, Plant, Sensor
from ..scenario import Scenario


def route_of(controller: Law, path: Path) -> Route | None:
    """The path where it is a route, which a law that follows one needs."""
    if isinstance(path, Route):
        return path
    if controller.follows():
        kind = f"{type(path).__name__} goes by a clock: make it Route.along(path)"
        raise ValueError(f"{type(controller).__name__} follows a route by where it is; {kind}")
    return None


def check_contracts(controller: Law, scenario: Scenario) -> None:
    """Raise a TypeError for what does not derive from its base class."""
    parts = [("controller", controller, Law), ("plant", scenario.plant, Plant), ("path", scenario.path, Path)]
    parts += [("heading", scenario.heading, Heading), ("sensor", scenario.sensor, Sensor)]
    parts += [("disturbance", scenario.disturbance, Disturbance)]
    for kind in ("deadzone", "actuators"):
        parts += [(f"{kind}.{name}", part, Element) for name, part in getattr(scenario, kind).items()]
    for name, part, base in parts:
        optional = part is None and name in ("heading", "sensor")
        if not optional and not isinstance(part, base):
            kind = type(part).__name__
            raise TypeError(
                f"{name}: {kind} must derive from agvjax.{base.__name__}: class {kind}(agvjax.{base.__name__})"
            )
