"""Control laws, one file each.

A controller has `init(measurement, reference) -> flow`, its continuous state, and
`law(flow, held, measurement, reference) -> (Command, flow derivative)`. Memory that jumps at control instants is
optional: `hold(measurement, reference) -> held` and `jump(flow, held, measurement, reference, h) -> held`, with `h` [s]
the time between control instants. A law must not need the yaw rate for its heading command where the plant has
`feedthrough`. What tools ask of a law is optional: `tunable`, the gains to tune; `weight_norms(flow)`; `poles()` with
`fastest`, `upper_bounds(stable)` and `stability_bounds(Pi_min, Pi_psi_min)`, which keep steps and gains where they
belong; see `Backstepping`.
"""

from .asmc import ASMC as ASMC
from .backstepping import Backstepping as Backstepping
from .backstepping import BacksteppingState as BacksteppingState
from .backstepping import KnownSlopes as KnownSlopes
from .compensated import Compensated as Compensated
from .compensation import Compensation as Compensation
from .compensation import Inverse as Inverse
from .compensation import NoCompensation as NoCompensation
from .dfc import DFC as DFC
from .event_triggered import EventTriggered as EventTriggered
from .filters import CommandFilter as CommandFilter
from .filters import LiteralFilter as LiteralFilter
from .filters import NoFilter as NoFilter
from .fractional import FractionalBackstepping as FractionalBackstepping
from .fractional import Oustaloup as Oustaloup
from .ftsmc import FTSMC as FTSMC
from .ftsmc import SuperTwistingFTSMC as SuperTwistingFTSMC
from .full_weight import FullWeightBackstepping as FullWeightBackstepping
from .neuro_backstepping import NeuroBackstepping as NeuroBackstepping
from .osfc import OSFC as OSFC
from .predictor import NoPrediction as NoPrediction
from .predictor import Prediction as Prediction
from .predictor import Predictor as Predictor
from .sampled import BackCalculation as BackCalculation
from .sampled import NoAntiWindup as NoAntiWindup
from .sampled import Sampled as Sampled
