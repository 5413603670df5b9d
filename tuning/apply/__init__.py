"""May new gains replace those on a robot? What both would do on all that its last log leaves possible."""

from .run import Applied as Applied
from .run import apply as apply
