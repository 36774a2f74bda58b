"""Reads settings under the names that earlier releases wrote into recordings and weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

_RANGER = {"cone": "field_of_view", "blind": "range_min", "ghosts": "ghost_share"}
# Earlier name -> name now, by section of the environment's settings, and of `truth` in a recording.
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
    "sensors.laser": {"nearest": "range_min", "no_echo": "dropout"},
    "sensors.ultrasonic.narrow": _RANGER,
    "sensors.ultrasonic.wide": _RANGER,
    "sensors.modelled": {"position_most": "position_max", "heading_most": "heading_max"},
    "sensors.faults": {"since": "onset"},
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
    "localization": {
        "astray": "outlier_share",
        "least": "min_particles",
        "most": "max_particles",
    },
}

# Settings that are constants now, by section: they are left out.
DROPPED: Final[dict[str, tuple[str, ...]]] = {
    "hardware": ("command_period", "poll_period", "odometry_latency"),
    "localization": (
        "beams", "trust", "error", "bin_side", "bin_sector", "way_by_way", "way_by_turn",
        "turn_by_way", "turn_by_turn", "aside", "start_position", "start_heading", "update_way",
        "update_turn", "forget_fast", "forget_slow", "alarm", "calm", "usual", "told", "reach",
        "max_beams", "independent_beams", "kld_error", "bin_size", "bin_angle",
        "translation_by_translation", "translation_by_rotation", "rotation_by_translation",
        "rotation_by_rotation", "lateral_slip", "initial_position_sigma", "initial_heading_sigma",
        "update_distance", "update_angle", "alpha_fast", "alpha_slow", "lost_ratio",
        "recovered_ratio", "initial_fit", "min_informative_beams", "estimate_radius", "tries",
        "candidates", "global_samples", "global_candidates",
    ),
    "physics": ("people",),
    "slam": (
        "matching", "resample_threshold", "likelihood_smoothing", "translation_error",
        "rotation_error", "rotation_per_translation", "translation_floor", "rotation_floor",
    ),
    "slam.mapping": (
        "p_hit", "p_miss", "p_min", "p_max", "surface_sigma", "free_threshold",
        "occupied_threshold",
    ),
}  # fmt: skip


def migrated(settings: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    """An environment's settings (JSON content) under the names of today, less those dropped."""
    names, dropped = RENAMED.get(section, {}), DROPPED.get(section, ())
    found = {}
    for key, value in settings.items():
        name = names.get(key, key)
        inner = f"{section}.{name}" if section else name
        if key not in dropped:
            found[name] = migrated(value, inner) if isinstance(value, dict) else value
    return found
