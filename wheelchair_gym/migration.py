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
    "assistant": ("widen", "parabola", "turn_per_angle", "projection_time", "step", "turn_weight"),
    "assistant.freedom": ("docking_stick", "docking_time"),
    "driver.intention": (
        "caution", "mind_change_time", "look_distance", "look_speed", "look_time",
    ),
    "driver.hand": ("burst_time",),
    "driver.perception": ("lapse_least", "lapse_most"),
    "driver.interface": (
        "accuracy", "command_interval", "delay_least", "delay_most", "command_angle",
    ),
    "guidance": ("patch_radius", "known_radius", "shift_sigma"),
    "guidance.ways": ("step_length", "shrink_step", "shrink_tries"),
    "hardware": ("command_period", "poll_period", "odometry_latency"),
    "hardware.joystick": (
        "forward_axis", "turn_axis", "dead_man_button", "assist_button", "release_button",
        "rearm_button",
    ),
    "hardware.limits": ("rest_speed",),
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
    "scene": (
        "corridor_length", "lateral_offset", "lift_door_width", "map_margin", "passage_width",
        "room_depth",
    ),
    "scene.building": ("passage_width",),
    "scene.doors": ("sliding_share",),
    "scene.people": ("min_speed", "speed_sigma", "start_distance"),
    "sensors.modelled": ("position_max", "heading_max", "position_most", "heading_most"),
    "slam": (
        "matching", "resample_threshold", "likelihood_smoothing", "translation_error",
        "rotation_error", "rotation_per_translation", "translation_floor", "rotation_floor",
        "update_distance", "update_angle",
    ),
    "slam.mapping": (
        "free_range", "p_hit", "p_miss", "p_min", "p_max", "surface_sigma", "free_threshold",
        "occupied_threshold",
    ),
    "starts": ("min_time",),
}  # fmt: skip

# Where settings stand that have a section of their own: of mixed scenes, and of an experiment.
_SECTIONS: Final = {
    "scene.scenes": "scene",
    "protocol.tasks.scene": "scene",
    "protocol.practice.scene": "scene",
    "protocol.conditions.assist": "assistant",
    "protocol.conditions.hand": "driver.hand",
    "protocol.conditions.perception": "driver.perception",
}


def migrated(settings: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    """Settings (JSON content) under the names of today, less those dropped.

    Args:
        settings: of an environment, or of its section; of an experiment for "protocol".
        section: that they are.
    """
    section = _SECTIONS.get(section, section)
    names, dropped = RENAMED.get(section, {}), DROPPED.get(section, ())
    found = {}
    for key, value in settings.items():
        name = names.get(key, key)
        inner = f"{section}.{name}" if section else name
        if key not in dropped:
            found[name] = _migrated(value, inner)
    return found


def _migrated(value: Any, section: str) -> Any:
    if isinstance(value, list) and any(isinstance(each, dict) for each in value):
        return [_migrated(each, section) for each in value]
    return migrated(value, section) if isinstance(value, dict) else value
