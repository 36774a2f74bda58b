"""Law of the settings of planners, swarms and followers: each of them changes what is done."""

import dataclasses
import typing

import numpy as np
import pytest

from agents.control import FOLLOWERS
from planners import PLANNERS, Problem, Space
from planners.registries import OBJECTIVES, OPTIMIZERS
from planners.rrt_star_woa.woa import WhaleMoves
from tests.agents.control.test_followers import PATH as TIGHT_PATH
from tests.agents.control.test_followers import ROOM as TIGHT_ROOM
from tests.agents.control.test_followers import driven, manoeuvre
from tests.agents.fakes import corridor
from wheelchair_gym.base.settings import InputError, dump, load, with_values

# Names of settings, or of their ends, that need not change a plan or a command, and why.
EXCEPTIONS = {
    "limits": "a whole chair's limits, of which a planner reads some",
    "first": "a name of another registry", "objective": "the same", "optimizer": "the same",
}  # fmt: skip
# Settings under which the others count; one setting must count under one of several.
COARSE = {"resolution": 1.0}
SMALL = {"iterations": 300}
WHALES = {"whales": {"iterations": 10}, "tree": SMALL}
NEEDS = {
    "a_star": [COARSE | {"obstacle_weight": 2.0}], "dijkstra": [COARSE | {"obstacle_weight": 2.0}],
    "bfs": [COARSE], "dfs": [COARSE],
    "se2_rrt_star_woa": [SMALL | {"iterations": 3000, "improvement": 40}],
    "swarm": [
        {"optimizer": "woa", "curve": "pchip", "iterations": 10, "cycle": 5, "way_points": 2}
    ],
    "rrt_star": [SMALL], "rrt_star_fn": [{"tree": SMALL}], "rrt_star_smart": [{"tree": SMALL}],
    "rrt_star_woa_global": [WHALES], "rrt_star_woa_local": [WHALES],
    "pso_gwo": [{"inertia": "fixed"}, {"inertia": "adaptive"}],
}  # fmt: skip
# Walls, start and goal: a block, a detour, a niche and a narrow door, a door too narrow for the
# chair, and a goal behind it.
NICHE = [(0.4, 0, 0.6, 3), (1.4, 0, 1.6, 3), (0.4, 0, 1.6, 0.3)]
PROBLEMS = (
    ([(4, 4, 6, 6.5)], (1, 5), (9, 5)),
    ([(3, 0, 3.5, 7), (6, 3, 6.5, 10), (8.2, 5, 9, 5.6)], (1, 1), (9, 9)),
    ([(5, 0, 5.4, 4.68), (5, 5.32, 5.4, 10), *NICHE], (1, 1.2, -1.57), (9, 9, 0.0)),
    ([(5, 0, 5.4, 4.8), (5, 5.4, 5.4, 8.6), (5, 9.6, 5.4, 10), (2.5, 4.6, 3.0, 5.6)],
     (1, 1, 3.0), (9, 9, 0.0)),
    ([(4, 4, 6, 6)], (3, 5, 0.0), (2.1, 5, 0.0)),
)  # fmt: skip


def leaves(value, prefix=""):
    """Dotted names, values, types and bounds of all settings of a settings object."""
    hints = typing.get_type_hints(type(value))
    for field in dataclasses.fields(value):
        inner = getattr(value, field.name)
        if dataclasses.is_dataclass(inner):
            yield from leaves(inner, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, inner, hints[field.name]


def other_values(value, hint):
    """Values of a setting that differ from a value."""
    if typing.get_origin(hint) is typing.Literal:
        return [option for option in typing.get_args(hint) if option != value]
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [max(1, value // 4), 2 * value, value + 1, 8, 1, 0]
    if value is None:
        return [1.0, 2.0, 3, 5.0]
    return [0.25 * value, 2 * value, value + 0.3, 9 * value, 0.0]


def idle_settings(name, cls, outcome):
    """Names of the settings that change no outcome, whichever value they have."""
    idle = []
    for base in NEEDS.get(name, [{}]):
        made = load(cls, base, "base")
        before = list(outcome(made))
        idle.append(set())
        for key, value, hint in leaves(made):
            if EXCEPTIONS.keys() & set(key.split(".")):
                continue
            for other in other_values(value, hint):
                try:
                    changed = load(cls, with_values(dump(made), {key: other}), "changed")
                except InputError:  # beyond its bounds
                    continue
                if any(a != b for a, b in zip(outcome(changed), before, strict=True)):
                    break
            else:
                idle[-1].add(key)
    return set.intersection(*idle)


def test_every_user_of_the_whales_has_all_their_parameters():
    """Each of them acts: see the laws below."""
    users = {}
    for registry in (PLANNERS, FOLLOWERS, OPTIMIZERS):
        for name in registry:
            keys = [key for key, *_ in leaves(registry.make(name)) if "whales." in key]
            users |= {name: {key.split(".")[-1] for key in keys}} if keys else {}
    assert users.keys() == {
        "rrt_star_woa_local", "rrt_star_woa_global", "se2_rrt_star_woa", "rrt_woa", "woa_modified",
        "controls", "thesis", "whales",
    }  # fmt: skip
    moves = {field.name for field in dataclasses.fields(WhaleMoves)}
    assert all(keys >= moves for keys in users.values())


def plans(planner):
    """The plans of a planner, as bytes."""
    for walls, start, goal in PROBLEMS:
        space = Space.from_rectangles(walls, (0.0, 0.0, 10.0, 10.0))
        problem = Problem(space, np.array(start, float), np.array(goal, float), 0.3)
        plan = planner.plan(problem, np.random.default_rng(3))
        yield plan.status, plan.path.tobytes()


@pytest.mark.parametrize("name", PLANNERS)
def test_each_setting_of_a_planner_changes_a_plan(name):
    assert idle_settings(name, PLANNERS[name], plans) == set()


@pytest.mark.parametrize("name", [*OPTIMIZERS, *OBJECTIVES])
def test_each_setting_of_a_swarm_changes_a_plan(name):
    registry, kind = (OPTIMIZERS, "optimizer") if name in OPTIMIZERS else (OBJECTIVES, "objective")

    def outcome(settings):
        spec = {"name": name, **dump(settings)}
        common = {"iterations": 10, "cycle": 10, "way_points": 3, "first": "line"}
        return plans(load(PLANNERS["swarm"], {kind: spec, **common}, "swarm"))

    assert idle_settings(name, registry[name], outcome) == set()


def drives(config):
    """Poses of a follower in a tight place, in a corridor up to a goal, and before a person."""
    names = {type(FOLLOWERS.make(name)): name for name in FOLLOWERS}
    follower = {"name": names[type(config)], **dump(config)}
    person = np.array([[1.3, 0.2, -0.9, -0.1, 0.25, 0.0025, 0.0, 0.04]])
    yield driven(TIGHT_PATH, TIGHT_ROOM, 4.0, follower).tobytes()
    beside = manoeuvre((1.0, 0.0, -1.35), [(-0.2, 0.4), (1.0, 0.95)])
    yield driven(beside, corridor(width=1.7), 6.0, follower).tobytes()
    on = manoeuvre((1.0, 0.0, 0.4), [(4.0, -0.8)])
    yield driven(on, corridor(width=2.4), 1.5, follower, person).tobytes()


# The thesis's is `controls` with others.
@pytest.mark.parametrize("name", sorted(set(FOLLOWERS) - {"thesis"}))
def test_each_setting_of_a_follower_changes_a_drive(name):
    assert idle_settings("", FOLLOWERS[name], drives) == set()
