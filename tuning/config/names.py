"""Names of classes in TOML: `type = "circle"` in a table, or `filter = "literal"` where there is nothing to set."""

from __future__ import annotations

from collections.abc import Mapping

import agvjax

LAWS = {
    "neuro_backstepping": agvjax.NeuroBackstepping,
    "backstepping": agvjax.Backstepping,
    "full_weight": agvjax.FullWeightBackstepping,
    "osfc": agvjax.OSFC,
    "asmc": agvjax.ASMC,
    "dfc": agvjax.DFC,
    "ftsmc": agvjax.FTSMC,
    "super_twisting_ftsmc": agvjax.SuperTwistingFTSMC,
    "regulated_pure_pursuit": agvjax.RegulatedPurePursuit,
    "path_pid": agvjax.PathPID,
    "stanley": agvjax.Stanley,
    "path_lqr": agvjax.PathLQR,
}
COMPOSED = {
    "event_triggered": agvjax.EventTriggered,
    "fractional": agvjax.FractionalBackstepping,
    "compensated": agvjax.Compensated,
}
PLANTS = {
    "decoupled": agvjax.Decoupled,
    "unicycle": agvjax.Unicycle,
    "differential_drive": agvjax.DifferentialDrive,
    "kinematic_single_track": agvjax.KinematicSingleTrack,
    "single_track": agvjax.SingleTrack,
    "base": agvjax.Base,
    "twist_base": agvjax.TwistBase,
    "ackermann": agvjax.Ackermann,
}
PARTS = {
    "yaw_rate": {"delivered": agvjax.DeliveredYawRate, "kinematic": agvjax.readings.KinematicYawRate},
    "coupling": {"turned_velocity": agvjax.TurnedVelocity, "forward_speed": agvjax.readings.ForwardSpeed},
    "drive": {"torque": agvjax.TorqueDrive, "speed": agvjax.SpeedDrive},
    "tyre": {"linear": agvjax.LinearTyre, "saturating": agvjax.SaturatingTyre},
    "surface": {"none": None, "patch": agvjax.FrictionPatch},
}
FILTERS = {"command": agvjax.CommandFilter, "literal": agvjax.readings.LiteralFilter, "none": agvjax.NoFilter}
ELEMENTS = {
    "deadzone": agvjax.Deadzone,
    "saturation": agvjax.Saturation,
    "quantisation": agvjax.Quantisation,
    "lag": agvjax.Lag,
    "backlash": agvjax.Backlash,
    "rate_limit": agvjax.RateLimit,
    "delay": agvjax.Delay,
}
Classes = Mapping[str, Mapping[str, type | None]]  # by key, then by name; None stands for nothing of the kind
CLASSES: Classes = {
    "controller": LAWS | COMPOSED | {"sampled": agvjax.Sampled},
    "controller.inner": LAWS | {"velocity_reference": agvjax.VelocityReference},
    "controller.inner.inner": LAWS,
    "controller.inner.inner.filter": FILTERS,
    "controller.filter": FILTERS,
    "controller.inner.filter": FILTERS,
    "controller.anti_windup": {"none": agvjax.NoAntiWindup, "back_calculation": agvjax.BackCalculation},
    "controller.compensation": {
        "none": agvjax.NoCompensation,
        "inverse": agvjax.Inverse,
        "adaptive_inverse": agvjax.AdaptiveInverse,
    },
    "controller.prediction": {"none": agvjax.NoPrediction, "predictor": agvjax.Predictor},
    "controller.vehicle": PLANTS,
    **{f"controller.vehicle.{name}": classes for name, classes in PARTS.items()},
    "scenario.plant": PLANTS,
    **{f"scenario.plant.{name}": classes for name, classes in PARTS.items()},
    "scenario.sensor": {"none": None, "noise": agvjax.Noise, "mounted": agvjax.Mounted},
    "scenario.path": {
        "dumbbell": agvjax.Dumbbell,
        "circle": agvjax.Circle,
        "lemniscate": agvjax.Lemniscate,
        "line": agvjax.Line,
        "waypoints": agvjax.Waypoints,
        "route": agvjax.Route,
    },
    "scenario.heading": {
        "default": None,
        "bearing": agvjax.Bearing,
        "bearing_raw": agvjax.readings.RawBearing,
        "bearing_swapped": agvjax.readings.SwappedBearing,
        "tangent": agvjax.Tangent,
    },
    "scenario.disturbance": {
        "cosine": agvjax.Cosine,
        "none": agvjax.NoDisturbance,
        "step": agvjax.Step,
        "cosine_sum": agvjax.CosineSum,
        "harmonic": agvjax.Harmonic,
        "band_limited_noise": agvjax.BandLimitedNoise,
        "recorded": agvjax.Recorded,
    },
    "elements": ELEMENTS,
}


LETTERS = ("pid", "lqr", "osfc", "asmc", "dfc", "ftsmc")  # names that are letters, not words


def in_words(thing: object) -> str:
    """What a law, a plant or a path is called, and its class: "regulated pure pursuit (RegulatedPurePursuit)"."""
    kind = type(thing)
    named = LAWS | COMPOSED | PLANTS | dict(CLASSES["scenario.path"]) | dict(CLASSES["controller.inner"])
    name = next((name for name, other in named.items() if other is kind), "")
    words = [word.upper() if word in LETTERS else word for word in name.split("_")]
    return f"{' '.join(words)} ({kind.__name__})" if name else kind.__name__
