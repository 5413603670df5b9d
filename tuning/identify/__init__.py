"""From a log to a scenario: what the actuators of a vehicle really do, and how surely that is known."""

from .run import Identified as Identified
from .run import first_drive as first_drive
from .run import identify as identify
