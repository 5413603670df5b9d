"""Path following of autonomous ground vehicles whose actuators have a deadzone: simulate, differentiate, tune.

Maaruf & Mysorewala, "Neuro-adaptive path following control of autonomous ground vehicles with input deadzone",
Discover Applied Sciences 6:415 (2024). Equation numbers in this package are the paper's; a place where the paper is
silent or contradicts itself is marked `reading R..` where it matters.

| here | paper | meaning |
|---|---|---|
| `position`, `velocity` | chi1, chi2 | reference point (x_n, y_n) [m] and its rate [m/s], eqs. (2), (7) |
| `heading` | psi | orientation [rad] |
| `command` | U_bar, omega_bar | what the law asks for, before the deadzone [m/s^2, rad/s] |
| `delivered` | U, omega | what the actuators deliver |
| `slope_*`, `threshold_*` | Pi_r, Pi_l, s_r, s_l | deadzone, eq. (11) |
| `Pi_hat`, `Pi_psi_hat` | Pi, Pi_psi | the slopes the controller believes in (readings R2, R3) |
| `k1, k2, k3, Lam, Lam_psi` | k1, k2, k3, Lambda, Lambda_psi | gains |
| `omega_n`, `zeta` | omega_n, Psi or Phi | command filter (reading R6) |
| `phi1, phi2` | phi1, phi2 | command filter's state, eq. (22) |
| `xi1, xi2` | xi1, xi2 | filtering-error compensation, eq. (23) |
| `beta1, beta2` | beta1, beta2 | integrals of the errors, eqs. (25), (57) |
| `varphi`, `varphi_psi` | phi-hat, phi-hat_psi | estimates of the squared weight norms, eqs. (45), (67) |
| `centers`, `width` | eta-bar, eta | network, eq. (20) |
| `gamma1, gamma2, eta1, eta2, b1, b2` | the same | adaptation, eqs. (41), (45), (63), (67) |
"""

import importlib
import warnings

from ._pytree import FRACTION as FRACTION
from ._pytree import NONNEGATIVE as NONNEGATIVE
from ._pytree import POSITIVE as POSITIVE
from ._pytree import Rule as Rule
from ._pytree import number as number
from ._pytree import structure as structure
from .actuators.chain import Chain as Chain
from .actuators.deadzone import Deadzone as Deadzone
from .actuators.elements import Backlash as Backlash
from .actuators.elements import Delay as Delay
from .actuators.elements import Lag as Lag
from .actuators.elements import Quantisation as Quantisation
from .actuators.elements import RateLimit as RateLimit
from .actuators.elements import Saturation as Saturation
from .check import check as check
from .check import faults as faults
from .check import step_faults as step_faults
from .check import step_warnings as step_warnings
from .controllers import ASMC as ASMC
from .controllers import DFC as DFC
from .controllers import FTSMC as FTSMC
from .controllers import OSFC as OSFC
from .controllers import BackCalculation as BackCalculation
from .controllers import Backstepping as Backstepping
from .controllers import CommandFilter as CommandFilter
from .controllers import EventTriggered as EventTriggered
from .controllers import FractionalBackstepping as FractionalBackstepping
from .controllers import FullWeightBackstepping as FullWeightBackstepping
from .controllers import KnownSlopes as KnownSlopes
from .controllers import LiteralFilter as LiteralFilter
from .controllers import NeuroBackstepping as NeuroBackstepping
from .controllers import NoAntiWindup as NoAntiWindup
from .controllers import NoFilter as NoFilter
from .controllers import Oustaloup as Oustaloup
from .controllers import Sampled as Sampled
from .controllers import SuperTwistingFTSMC as SuperTwistingFTSMC
from .controllers.network import RadialBasis as RadialBasis
from .decorator import pytree as pytree
from .disturbance import BandLimitedNoise as BandLimitedNoise
from .disturbance import Cosine as Cosine
from .disturbance import CosineSum as CosineSum
from .disturbance import Harmonic as Harmonic
from .disturbance import NoDisturbance as NoDisturbance
from .disturbance import Recorded as Recorded
from .disturbance import Step as Step
from .disturbance import Tone as Tone
from .engine.xla import tune_xla as tune_xla
from .errors import Fault as Fault
from .errors import InputError as InputError
from .evaluate import Batch as Batch
from .evaluate import batch as batch
from .evaluate import evaluate as evaluate
from .feasible import demands as demands
from .feasible import path_warnings as path_warnings
from .geometry import into_body as into_body
from .geometry import into_plane as into_plane
from .geometry import wrap as wrap
from .integrate import EULER as EULER
from .integrate import HEUN as HEUN
from .integrate import INTEGRATORS as INTEGRATORS
from .integrate import RK4 as RK4
from .integrate import Integrator as Integrator
from .leaves import leaves as leaves
from .leaves import replace as replace
from .messages import Command as Command
from .messages import Measurement as Measurement
from .messages import Reference as Reference
from .messages import Start as Start
from .metrics import Criteria as Criteria
from .metrics import Metrics as Metrics
from .metrics import measure as measure
from .metrics import tracking_error as tracking_error
from .paths.heading import Bearing as Bearing
from .paths.heading import RawBearing as RawBearing
from .paths.heading import SwappedBearing as SwappedBearing
from .paths.heading import Tangent as Tangent
from .paths.heading import default_heading as default_heading
from .paths.shapes import Circle as Circle
from .paths.shapes import Dumbbell as Dumbbell
from .paths.shapes import Lemniscate as Lemniscate
from .paths.shapes import Line as Line
from .paths.waypoints import Waypoints as Waypoints
from .plants import Decoupled as Decoupled
from .plants import DeliveredYawRate as DeliveredYawRate
from .plants import DifferentialDrive as DifferentialDrive
from .plants import ForwardSpeed as ForwardSpeed
from .plants import FrictionPatch as FrictionPatch
from .plants import KinematicSingleTrack as KinematicSingleTrack
from .plants import KinematicYawRate as KinematicYawRate
from .plants import LinearTyre as LinearTyre
from .plants import SaturatingTyre as SaturatingTyre
from .plants import SingleTrack as SingleTrack
from .plants import SpeedDrive as SpeedDrive
from .plants import SteeringLimits as SteeringLimits
from .plants import TorqueDrive as TorqueDrive
from .plants import TurnedVelocity as TurnedVelocity
from .plants import Unicycle as Unicycle
from .protocols import Disturbance as Disturbance
from .protocols import Element as Element
from .protocols import Heading as Heading
from .protocols import Law as Law
from .protocols import Motion as Motion
from .protocols import Path as Path
from .protocols import Plant as Plant
from .protocols import Reach as Reach
from .protocols import Sensor as Sensor
from .scenario import Scenario as Scenario
from .sensor import Noise as Noise
from .simulate import Trajectory as Trajectory
from .simulate import simulate as simulate
from .timing import Timing as Timing

__version__ = "0.1.0"

_RENAMED = {"Problem": "Fault", "problems": "faults", "step_problems": "step_faults", "path_problems": "path_warnings"}
_MOVED = {"plot": "draw.plot", "animate": "draw.animate"}


def __getattr__(name: str) -> object:
    """A name of earlier releases."""
    if name not in _RENAMED and name not in _MOVED:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    now = _RENAMED.get(name) or _MOVED[name]
    warnings.warn(f"agvjax.{name} is agvjax.{now}", DeprecationWarning, stacklevel=2)
    return globals()[now] if name in _RENAMED else importlib.import_module(f".{now}", __name__)
