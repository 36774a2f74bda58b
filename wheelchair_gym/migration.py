"""Reads settings under the names that earlier releases wrote into recordings and weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

# By section of the environment's settings: earlier name -> name now.
RENAMED: Final[dict[str, dict[str, str]]] = {
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
