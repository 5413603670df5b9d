"""Plants, one file each: how a vehicle moves under what its actuators deliver.

A plant has `actuators`, the names of what it is driven by, and

* `start(start) -> state`, a dataclass with a `heading`,
* `derivative(state, memory, delivered, disturbance) -> state`,
* `output(state, delivered) -> Measurement`, and `feedthrough`, whether that needs what is delivered at this instant,
* `allocate(command, measurement) -> {actuator: input}`: what to ask of the actuators for a law's command. A controller
  that runs on a computer of its own does this too, with the vehicle it believes in.

Optional: `achieved(inputs, measurement) -> (2,)`, the command that inputs amount to, which anti-windup needs;
`commands_heading = False` where the heading follows from the motion of the reference point and no law can command it;
`deadzones()`, nominal ones for its actuators; `needs(motion)`, what following a path exactly takes.
"""

from ..geometry import turned as turned
from ..messages import Command as Command
from ..messages import Measurement as Measurement
from ..messages import Start as Start
from .decoupled import Decoupled as Decoupled
from .decoupled import DecoupledState as DecoupledState
from .decoupled import DeliveredYawRate as DeliveredYawRate
from .decoupled import ForwardSpeed as ForwardSpeed
from .decoupled import KinematicYawRate as KinematicYawRate
from .decoupled import TurnedVelocity as TurnedVelocity
from .differential_drive import DifferentialDrive as DifferentialDrive
from .differential_drive import SpeedDrive as SpeedDrive
from .differential_drive import TorqueDrive as TorqueDrive
from .kinematic_single_track import KinematicSingleTrack as KinematicSingleTrack
from .kinematic_single_track import KinematicState as KinematicState
from .road import FrictionPatch as FrictionPatch
from .single_track import SingleTrack as SingleTrack
from .single_track import SingleTrackState as SingleTrackState
from .steered import SteeringLimits as SteeringLimits
from .tyre import LinearTyre as LinearTyre
from .tyre import SaturatingTyre as SaturatingTyre
from .unicycle import RollingState as RollingState
from .unicycle import Unicycle as Unicycle
