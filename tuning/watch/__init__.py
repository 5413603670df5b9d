"""Are gains still tuned for the robot that a log is of?"""

from .run import Watched as Watched
from .run import watch as watch
