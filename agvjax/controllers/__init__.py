"""Control laws, one file each.

A controller has `init(measurement, reference) -> flow`, its continuous state, and
`law(flow, held, measurement, reference) -> (Command, flow derivative)`. Memory that jumps at control instants is
optional: `hold(measurement, reference) -> held` and `jump(flow, held, measurement, reference, h) -> held`, with `h` [s]
the time between control instants. A law must not need the yaw rate for its heading command where the plant has
`feedthrough`.
"""

from .neuro_backstepping import BacksteppingState as BacksteppingState
from .neuro_backstepping import CommandFilter as CommandFilter
from .neuro_backstepping import LiteralFilter as LiteralFilter
from .neuro_backstepping import NeuroBackstepping as NeuroBackstepping
