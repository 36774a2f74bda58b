"""Reads settings under the names that earlier releases wrote into recordings and weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

_RANGER = {"cone": "field_of_view", "blind": "range_min", "ghosts": "ghost_share"}
# Earlier name -> name now, by section of the environment's settings, and of `truth` in a recording
# and of the keys of an observation.
RENAMED: Final[dict[str, dict[str, str]]] = {
    "": {"localisation": "localization"},
    "chair": {"randomise": "randomize"},
    "chair.body": {
        "centre": "centre_of_mass",
        "gyration": "radius_of_gyration",
        "casters": "wheelbase",
        "rolling": "rolling_resistance",
        "bumper": "bumper_force",
    },
    "chair.motor": {
        "constant": "torque_constant",
        "current": "current_limit",
        "smoothing": "filter_time",
        "rate": "control_rate",
    },
    "chair.battery": {
        "full": "full_voltage",
        "empty": "empty_voltage",
        "charge": "initial_charge",
        "idle": "idle_power",
    },
    "physics.people": {
        "choose": "decision_period",
        "sight": "neighbour_distance",
        "notice": "inattentive_distance",
        "relax": "relaxation_time",
        "legs": "max_force",
    },
    "sensors.laser": {"nearest": "range_min", "no_echo": "dropout"},
    "sensors.ultrasonic.narrow": _RANGER,
    "sensors.ultrasonic.wide": _RANGER,
    "sensors.modelled": {"position_most": "position_max", "heading_most": "heading_max"},
    "sensors.faults": {"since": "onset"},
    "starts": {"within": "max_time", "least": "min_time"},
    "follower.objective": {
        "foresight": "prediction_time",
        "wish": "desired_clearance",
        "room": "actor_clearance",
        "struck": "actor_weight",
    },
    "planner": {"reverse_cost": "reverse_factor"},
    "planner.lattice": {"reverse_cost": "reverse_factor"},
    "guidance": {
        "slack": "max_detour",
        "share": "degraded_share",
        "forgotten": "patch_density",
        "patch": "patch_radius",
        "known": "known_radius",
        "shift": "shift_sigma",
    },
    "task": {"doubt": "arrival_margin", "gaps": "side_clearance", "unguided": "hide_guidance"},
    "task.reward": {
        "withheld": "shield_intervention",
        "haste": "proximity_speed",
        "change": "action_rate",
    },
    "truth": {
        "caused": "at_fault",
        "met": "contact_with",
        "closing": "approach_speed",
        "closed_on": "other_approach_speed",
        "way": "distance",
        "movers": "actor_poses",
    },
    "observation": {
        "gaps": "side_clearance",
        "hidden_path": "privileged_path",
        "hidden_gaps": "privileged_side_clearance",
    },
    "shield": {
        "margin": "stop_margin",
        "headway": "time_headway",
        "reaction": "reaction_time",
        "crawl": "creep_speed",
        "memory": "memory_time",
        "lasting": "static_memory_time",
        "vacated": "vacated_time",
        "unseen": "unseen_speed",
        "pace": "person_speed",
        "spurt": "person_acceleration",
        "wary": "moving_memory_time",
    },
    "localisation": {
        "beams": "max_beams",
        "astray": "outlier_share",
        "trust": "independent_beams",
        "least": "min_particles",
        "most": "max_particles",
        "error": "kld_error",
        "bin_side": "bin_size",
        "bin_sector": "bin_angle",
        "way_by_way": "translation_by_translation",
        "way_by_turn": "translation_by_rotation",
        "turn_by_way": "rotation_by_translation",
        "turn_by_turn": "rotation_by_rotation",
        "aside": "lateral_slip",
        "start_position": "initial_position_sigma",
        "start_heading": "initial_heading_sigma",
        "update_way": "update_distance",
        "update_turn": "update_angle",
        "forget_fast": "alpha_fast",
        "forget_slow": "alpha_slow",
        "alarm": "lost_ratio",
        "calm": "recovered_ratio",
        "usual": "initial_fit",
        "told": "min_informative_beams",
        "tries": "global_samples",
        "candidates": "global_candidates",
        "reach": "estimate_radius",
    },
    "slam": {
        "way": "update_distance",
        "turn": "update_angle",
        "resample": "resample_threshold",
        "smooth": "likelihood_smoothing",
        "way_error": "translation_error",
        "turn_error": "rotation_error",
        "turn_per_way": "rotation_per_translation",
        "way_floor": "translation_floor",
        "turn_floor": "rotation_floor",
    },
    "slam.mapping": {
        "hit": "p_hit",
        "miss": "p_miss",
        "least": "p_min",
        "most": "p_max",
        "occupied": "occupied_threshold",
        "free": "free_threshold",
        "clear": "free_range",
        "smear": "surface_sigma",
    },
    "slam.matching": {
        "window": "search_window",
        "turn": "search_angle",
        "step": "angle_step",
        "spacing": "point_spacing",
        "points": "max_points",
        "spread": "residual_sigma",
        "doubt": "search_threshold",
    },
}


def migrated(settings: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    """An environment's settings (JSON content) with each name replaced by the name it has now."""
    names = RENAMED.get(section, {})
    found = {}
    for key, value in settings.items():
        inner = f"{section}.{key}" if section else key
        found[names.get(key, key)] = migrated(value, inner) if isinstance(value, dict) else value
    return found
