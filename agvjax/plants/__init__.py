"""Plants, one file each: how a vehicle moves under what its actuators deliver; see `agvjax.Plant`."""

from .. import _moved
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


def __getattr__(name: str) -> object:
    return _moved.find(__name__, name)
