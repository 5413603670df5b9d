"""Other readings of the paper, where it is silent or contradicts itself: for comparison, not for use on a vehicle."""

from .controllers.backstepping import KnownSlopes as KnownSlopes
from .controllers.filters import LiteralFilter as LiteralFilter
from .paths.heading import RawBearing as RawBearing
from .paths.heading import SwappedBearing as SwappedBearing
from .plants.decoupled import ForwardSpeed as ForwardSpeed
from .plants.decoupled import KinematicYawRate as KinematicYawRate
