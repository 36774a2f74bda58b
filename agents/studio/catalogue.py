"""Choices of a person: places to drive in, assistants, and hands."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from agents.people import ASSISTANTS
from wheelchair_gym.people.drivers.live_person import IMPAIRMENTS, SIGHTS
from wheelchair_gym.scenes import SCENES

FIRST: Final = "map_file"  # scene of the first drive: the clinic of the package, soon compiled
FIRST_ASSISTANT: Final = "shared_dwa"  # of the first drive
STILL: Final = ("floor_plan", "clutter", "doorway")  # scenes for the twin, in which nobody moves
MAP: Final = "map"  # the key of a person's own map
RATES: Final = (10, 20, 40)  # Hz
NO_HAND: Final = "none"
NO_SIGHT: Final = "none"  # nothing is hidden
ANY_TIME: Final = 3600.0  # s: limit of a drive that no suite limits


class Place(NamedTuple):
    """Source of episodes: a scene, a scene of a suite, or a map.

    Attributes:
        group: scene, suite or map.
        label: its name.
        scene: settings of the scene, for the environment.
        env: further settings of the environment.
        timed: the episode's own time limit counts.
        twin: the chair's boards are emulated.
    """

    group: str
    label: str
    scene: Any
    env: Mapping[str, Any]
    timed: bool = False
    twin: bool = False


def places(own_map: Mapping[str, Any] | None = None, model: str | None = None) -> dict[str, Place]:
    """All places by key: scenes, also for the twin, scenes of suites, and a person's own map.

    Args:
        own_map: settings of the scene `map_file`, with a label.
        model: chair of `configs/chairs`; None: the default.
    """
    from agents.evaluation.compare import SUITES
    from agents.evaluation.evaluate import episode_env, label, without_labels

    plain = {"pose_source": "modelled"}
    found: dict[str, Place] = {}
    if own_map is not None:
        found[MAP] = Place("map", str(own_map["label"]), without_labels(own_map), plain)
    for name in SCENES:
        if name != "mixture":
            shown = "clinic" if name == FIRST else name
            found[f"scene:{name}"] = Place("scene", shown, name, plain)
    measured = {"pose_source": "odometry"}
    for key in (MAP, *(f"scene:{name}" for name in STILL)):
        if key in found:
            place = found[key]
            found[f"twin:{key}"] = place._replace(group="twin", env=measured, twin=True)
    for name, suite in SUITES.items():
        for k, scene in enumerate(suite.scenes):
            env = episode_env(scene, suite.env)
            found[f"suite:{name}:{k}"] = Place(
                "suite", f"{name}: {label(scene)}", without_labels(scene), env, timed=True
            )
    more = {} if model is None else {"model": model}
    return {key: one._replace(env={**one.env, **more}) for key, one in found.items()}


def choices(found: Mapping[str, Place]) -> dict[str, Any]:
    """Return the choices that the page offers, as JSON holds them."""
    return {
        "places": [[key, place.group, place.label] for key, place in found.items()],
        "first": MAP if MAP in found else f"scene:{FIRST}",
        "assistants": sorted(ASSISTANTS),
        "assistant": FIRST_ASSISTANT,
        "hands": [NO_HAND, *IMPAIRMENTS],
        "sights": [NO_SIGHT, *SIGHTS],
        "rates": list(RATES),
    }
