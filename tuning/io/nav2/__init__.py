"""Nav2's parameter files: the section of a Regulated Pure Pursuit read, tuned values written back into the text."""

from .names import SIMULATED as SIMULATED
from .params import Parameters as Parameters
from .params import diff as diff
from .params import read as read
from .params import write as write
