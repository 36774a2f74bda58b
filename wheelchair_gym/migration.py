"""Reads settings under the names that earlier releases wrote into recordings and weights."""

from __future__ import annotations

import math
import warnings
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

# Settings that are constants now, by section, with their values; None: not compared.
DROPPED: Final[dict[str, dict[str, Any]]] = {
    "assistant": {
        "widen": 0.05, "parabola": 1.0, "turn_per_angle": 1.0, "projection_time": 1.0, "step": 0.1,
        "turn_weight": 0.3,
    },
    "assistant.belief": {"goals": "scan", "count": None, "forget": 0.2},
    "assistant.freedom": {"docking_stick": 0.35, "docking_time": 1.0},
    "guidance": {"patch_radius": 0.8, "known_radius": 2.0, "shift_sigma": 0.03},
    "guidance.ways": {"step_length": 0.2, "shrink_step": 0.02, "shrink_tries": 5},
    "hardware": {"command_period": 0.02, "poll_period": 0.005, "odometry_latency": 0.004},
    "hardware.limits": {"rest_speed": 0.05},
    "localization": {
        "max_beams": 60, "independent_beams": 12.0, "kld_error": 0.05, "bin_size": 0.25,
        "bin_angle": math.radians(10.0), "translation_by_translation": 0.03,
        "translation_by_rotation": 0.01, "rotation_by_translation": 0.04,
        "rotation_by_rotation": 0.05, "lateral_slip": 0.03, "initial_position_sigma": 0.05,
        "initial_heading_sigma": math.radians(2.0), "update_distance": 0.01, "update_angle": 0.01,
        "alpha_fast": 0.2, "alpha_slow": 0.005, "lost_ratio": 0.7, "recovered_ratio": 0.9,
        "initial_fit": 0.9, "min_informative_beams": 8, "estimate_radius": 1.0, "tries": None,
        "candidates": None, "global_samples": 2000, "global_candidates": 10,
        # The names of release 0.1.
        **dict.fromkeys((
            "beams", "trust", "error", "bin_side", "bin_sector", "way_by_way", "way_by_turn",
            "turn_by_way", "turn_by_turn", "aside", "start_position", "start_heading",
            "update_way", "update_turn", "forget_fast", "forget_slow", "alarm", "calm", "usual",
            "told", "reach",
        )),
    },
    "physics": {"people": None},
    "scene": {
        "corridor_length": None, "lateral_offset": 0.15, "lift_door_width": [0.9, 1.1],
        "map_margin": 1.5, "passage_width": 1.2, "room_depth": 3.5,
    },
    "scene.building": {"passage_width": 1.2},
    "scene.doors": {"sliding_share": 0.5},
    "scene.people": {"min_speed": 0.4, "speed_sigma": 0.26, "start_distance": 2.0},
    "sensors.modelled": {
        "position_max": 0.1, "heading_max": math.radians(3.0),
        "position_most": 0.1, "heading_most": math.radians(3.0),
    },
    "slam": {
        "matching": None, "resample_threshold": 0.5, "likelihood_smoothing": 3.0,
        "translation_error": 0.05, "rotation_error": 0.05, "rotation_per_translation": 0.05,
        "translation_floor": 0.01, "rotation_floor": 0.01, "update_distance": 0.4,
        "update_angle": 0.5,
    },
    "slam.mapping": {
        "free_range": 3.0, "p_hit": 0.7, "p_miss": 0.4, "p_min": 0.12, "p_max": 0.97,
        "surface_sigma": 0.02, "free_threshold": 0.41, "occupied_threshold": 0.65,
    },
    "starts": {"min_time": 1.0},
}  # fmt: skip

# Where settings stand that have a section of their own: of mixed scenes, and of an experiment.
_SECTIONS: Final = {
    "scene.scenes": "scene",
    "protocol.tasks.scene": "scene",
    "protocol.practice.scene": "scene",
    "protocol.conditions.assist": "assistant",
}


def migrated(settings: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    """Settings (JSON content) under the names of today, without those dropped.

    A dropped setting with another value than the constant of today is reported by a warning.

    Args:
        settings: of an environment, or of its section; of an experiment for "protocol".
        section: that they are.
    """
    section = _SECTIONS.get(section, section)
    names, dropped = RENAMED.get(section, {}), DROPPED.get(section, {})
    found = {}
    for key, value in settings.items():
        name = names.get(key, key)
        inner = f"{section}.{name}" if section else name
        if key not in dropped:
            found[name] = _migrated(value, inner)
        elif dropped[key] not in (None, value):
            warnings.warn(
                f"{inner} is {value} in a file of an earlier release; it is {dropped[key]} now",
                stacklevel=2,
            )
    return found


def _migrated(value: Any, section: str) -> Any:
    if isinstance(value, list) and any(isinstance(each, dict) for each in value):
        return [_migrated(each, section) for each in value]
    return migrated(value, section) if isinstance(value, dict) else value
