"""Path following of autonomous ground vehicles whose actuators have a deadzone: simulate, differentiate, tune.

Maaruf & Mysorewala, "Neuro-adaptive path following control of autonomous ground vehicles with input deadzone",
Discover Applied Sciences 6:415 (2024). Equation numbers in this package are the paper's; a place where the paper is
silent or contradicts itself is marked `reading R..` where it matters.

| here | paper | meaning |
|---|---|---|
| `position`, `velocity` | chi1, chi2 | reference point (x_n, y_n) [m] and its rate [m/s], eqs. (2), (7) |
| `heading` | psi | orientation [rad] |
| `command` | U_bar, omega_bar | command of the law, before the deadzone [m/s^2, rad/s] |
| `delivered` | U, omega | output of the actuators |
| `slope_*`, `threshold_*` | Pi_r, Pi_l, s_r, s_l | deadzone, eq. (11) |
| `Pi_hat`, `Pi_psi_hat` | Pi, Pi_psi | deadzone slopes that the controller assumes (readings R2, R3) |
| `k1, k2, k3, Lam, Lam_psi` | k1, k2, k3, Lambda, Lambda_psi | gains |
| `omega_n`, `zeta` | omega_n, Psi or Phi | command filter (reading R6) |
| `phi1, phi2` | phi1, phi2 | command filter's state, eq. (22) |
| `xi1, xi2` | xi1, xi2 | filtering-error compensation, eq. (23) |
| `beta1, beta2` | beta1, beta2 | integrals of the errors, eqs. (25), (57) |
| `varphi`, `varphi_psi` | phi-hat, phi-hat_psi | estimates of the squared weight norms, eqs. (45), (67) |
| `centers`, `width` | eta-bar, eta | network, eq. (20) |
| `gamma1, gamma2, eta1, eta2, b1, b2` | the same | adaptation, eqs. (41), (45), (63), (67) |
"""

from . import _moved, readings
from ._pytree import ANY, FRACTION, NONNEGATIVE, POSITIVE, Real, Rule, number, structure
from .actuators.chain import Chain
from .actuators.deadzone import Deadzone
from .actuators.elements import Backlash, Delay, Lag, Quantisation, RateLimit, Saturation
from .check import check, faults, step_faults, step_warnings
from .controllers.adaptive_inverse import AdaptiveInverse
from .controllers.asmc import ASMC
from .controllers.backstepping import Backstepping
from .controllers.compensated import Compensated
from .controllers.compensation import Inverse, NoCompensation
from .controllers.dfc import DFC
from .controllers.event_triggered import EventTriggered
from .controllers.filters import CommandFilter, NoFilter
from .controllers.fractional import FractionalBackstepping, Oustaloup
from .controllers.ftsmc import FTSMC, SuperTwistingFTSMC
from .controllers.full_weight import FullWeightBackstepping
from .controllers.network import RadialBasis
from .controllers.neuro_backstepping import NeuroBackstepping
from .controllers.osfc import OSFC
from .controllers.path_lqr import PathLQR
from .controllers.path_pid import PathPID
from .controllers.predictor import NoPrediction, Predictor
from .controllers.pure_pursuit import RegulatedPurePursuit
from .controllers.sampled import BackCalculation, NoAntiWindup, Sampled
from .controllers.stanley import Stanley
from .controllers.velocity_reference import VelocityReference
from .controllers.wrapping import Wrapping
from .decorator import pytree
from .disturbance import BandLimitedNoise, Cosine, CosineSum, Harmonic, NoDisturbance, Recorded, Step, Tone
from .engine import xla as _xla
from .engine.xla import tune_xla
from .errors import Fault, InputError
from .evaluate import Batch, batch, evaluate
from .feasible import demands, path_needs, path_unchecked, path_warnings
from .geometry import into_body, into_plane, wrap
from .gradient import value_and_grad
from .integrate import EULER, HEUN, INTEGRATORS, RK4, Integrator
from .leaves import leaves, replace
from .messages import Command, Measurement, Reference, Start
from .metrics import Criteria, Metrics, measure, tracking_error
from .paths.heading import Bearing, Tangent, default_heading
from .paths.profile import SpeedLimits
from .paths.route import Route
from .paths.shapes import Circle, Dumbbell, Lemniscate, Line
from .paths.waypoints import Waypoints
from .plants.base import Ackermann, Base, TwistBase
from .plants.decoupled import Decoupled, DeliveredYawRate, TurnedVelocity
from .plants.differential_drive import DifferentialDrive, SpeedDrive, TorqueDrive
from .plants.kinematic_single_track import KinematicSingleTrack
from .plants.road import FrictionPatch
from .plants.single_track import SingleTrack
from .plants.steered import SteeringLimits
from .plants.tyre import LinearTyre, SaturatingTyre
from .plants.unicycle import Unicycle
from .protocols import Disturbance, Element, Heading, Law, Motion, Path, Plant, Reach, Sensor
from .scenario import Scenario
from .schedule import Schedule
from .sensor import Mounted, Noise
from .simulate import Trajectory, simulate
from .timing import Timing

__version__ = "0.1.0"

# run and judge
__all__ = ["Trajectory", "simulate", "Batch", "batch", "evaluate", "Criteria", "Metrics", "measure"]
__all__ += ["tracking_error", "Scenario", "Timing", "EULER", "HEUN", "INTEGRATORS", "Integrator", "RK4"]
__all__ += ["demands", "path_needs", "path_unchecked", "path_warnings"]
# laws
__all__ += ["ASMC", "DFC", "FTSMC", "SuperTwistingFTSMC", "OSFC", "BackCalculation", "NoAntiWindup", "Sampled"]
__all__ += ["AdaptiveInverse", "Compensated", "Inverse", "NoCompensation", "NoPrediction", "Predictor", "Schedule"]
__all__ += ["PathLQR", "PathPID", "RegulatedPurePursuit", "Stanley", "VelocityReference"]
__all__ += ["Backstepping", "CommandFilter", "NoFilter", "EventTriggered", "FractionalBackstepping"]
__all__ += ["Oustaloup", "FullWeightBackstepping", "NeuroBackstepping", "RadialBasis"]
# plants
__all__ += ["Decoupled", "DeliveredYawRate", "TurnedVelocity", "DifferentialDrive", "SpeedDrive", "TorqueDrive"]
__all__ += ["Ackermann", "Base", "TwistBase"]
__all__ += ["FrictionPatch", "KinematicSingleTrack", "LinearTyre", "SaturatingTyre", "SingleTrack"]
__all__ += ["SteeringLimits", "Unicycle"]
# actuators, sensors, paths, disturbances
__all__ += ["Chain", "Deadzone", "Backlash", "Delay", "Lag", "Quantisation", "RateLimit", "Saturation", "Noise"]
__all__ += ["Mounted"]
__all__ += ["Bearing", "Tangent", "default_heading", "Circle", "Dumbbell", "Lemniscate", "Line", "Waypoints"]
__all__ += ["Route", "SpeedLimits"]
__all__ += ["BandLimitedNoise", "Cosine", "CosineSum", "Harmonic", "NoDisturbance", "Recorded", "Step", "Tone"]
# check, leaves, compiler
__all__ += ["check", "faults", "step_faults", "step_warnings", "Fault", "InputError", "leaves", "replace"]
__all__ += ["tune_xla", "value_and_grad", "readings"]
# what a class of one's own needs
__all__ += ["Disturbance", "Element", "Heading", "Law", "Motion", "Path", "Plant", "Reach", "Sensor", "Command"]
__all__ += ["Measurement", "Reference", "Start", "ANY", "FRACTION", "NONNEGATIVE", "POSITIVE", "Real", "Rule"]
__all__ += ["number", "structure", "pytree", "into_body", "into_plane", "wrap", "Wrapping"]

_xla.set_on_import()


def __getattr__(name: str) -> object:
    return _moved.find(__name__, name)
