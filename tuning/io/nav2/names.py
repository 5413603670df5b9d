"""The parameters of Nav2's Regulated Pure Pursuit: those a law has, those that mean nothing to one robot on a path."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from agvjax import NONNEGATIVE, POSITIVE, RegulatedPurePursuit, Rule

PLUGIN = r"nav2_regulated_pure_pursuit_controller(::|/)RegulatedPurePursuitController"
SHIM = r"nav2_rotation_shim_controller(::|/)RotationShimController"


class Parameter(NamedTuple):
    """A number with its default, unit and rule, or a switch, which has no rule; from Nav2's Jazzy, f4108e5b."""

    default: float | bool
    unit: str = ""
    rule: Rule | None = None


def _of_law() -> dict[str, Parameter]:
    """Those that the law has, which are written down there."""
    law = RegulatedPurePursuit()
    told = {f.name: f.metadata for f in dataclasses.fields(law) if f.name not in OURS}
    return {name: Parameter(vars(law)[name], of.get("unit", ""), of.get("rule")) for name, of in told.items()}


OURS = {"max_angular_velocity"}  # of the law's fields, one that Nav2's controller does not have
SIMULATED = _of_law()
NOT_SIMULATED = {  # manoeuvres that the law does not have
    "use_fixed_curvature_lookahead": Parameter(False),
    "curvature_lookahead_dist": Parameter(0.6, "m", POSITIVE),
    "use_rotate_to_heading": Parameter(True),
    "rotate_to_heading_min_angle": Parameter(0.785, "rad", NONNEGATIVE),
    "rotate_to_heading_angular_vel": Parameter(1.8, "rad/s", POSITIVE),
    "max_angular_accel": Parameter(3.2, "rad/s^2", POSITIVE),
    "allow_reversing": Parameter(False),
}
PARAMETERS = SIMULATED | NOT_SIMULATED
NEWER = {"max_linear_vel": "desired_linear_vel"}  # names from Lyrical on, which reads the older one too
FREQUENCY = Parameter(20.0, "Hz", POSITIVE)  # controller_frequency, of the server

_OBSTACLES = "There are no obstacles in the simulation."
_WINDOW = "It belongs to the dynamic window of Lyrical, another law."
_GONE = "No release since Humble reads it."
_SHIM = "It belongs to the rotation shim, which turns the robot before this law drives it."
IGNORED = {  # why each means nothing here
    **dict.fromkeys(("use_collision_detection", "max_allowed_time_to_collision_up_to_carrot"), _OBSTACLES),
    **dict.fromkeys(("min_distance_to_obstacle", "allow_obstacle_checking_beyond_goal"), _OBSTACLES),
    **dict.fromkeys(("use_cost_regulated_linear_velocity_scaling", "cost_scaling_dist"), _OBSTACLES),
    **dict.fromkeys(("cost_scaling_gain", "inflation_cost_scaling_factor"), _OBSTACLES),
    **dict.fromkeys(("max_angular_decel", "max_angular_vel", "min_angular_vel", "min_linear_vel"), _WINDOW),
    **dict.fromkeys(("max_linear_accel", "max_linear_decel", "use_dynamic_window"), _WINDOW),
    **dict.fromkeys(("goal_dist_tol", "max_allowed_time_to_collision", "use_approach_linear_velocity_scaling"), _GONE),
    "transform_tolerance": "There is one frame, and its transform is never late.",
    **dict.fromkeys(("use_cancel_deceleration", "cancel_deceleration"), "No drive is cancelled."),
    "max_robot_pose_search_dist": "The law knows how far along its path it is, and searches no other part of it.",
    "stateful": "The simulated path ends without a goal's tolerance.",
    "interpolate_curvature_after_goal": "The simulated path ends without a goal's tolerance.",
    "use_interpolation": "The law always takes the point between two poses, as Nav2 does from Jazzy on.",
}
OF_SHIM = dict.fromkeys(
    (
        *("angular_dist_threshold", "angular_disengage_threshold", "forward_sampling_distance", "max_cost_threshold"),
        *("simulate_ahead_time", "rotate_to_goal_heading", "rotate_to_heading_once", "rotate_to_goal_heading_once"),
        *("closed_loop", "use_path_orientations"),
    ),
    _SHIM,
)
DOUBLES = {  # of the ignored, those that every release declares as such, so that it refuses a whole number
    *("max_allowed_time_to_collision_up_to_carrot", "cost_scaling_dist", "cost_scaling_gain"),
    *("inflation_cost_scaling_factor", "transform_tolerance", "max_robot_pose_search_dist"),
}
