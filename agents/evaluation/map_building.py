"""Charts: maps that a chair draws of a scene while a policy drives it, and how true they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from agents.interrupt import by_hand
from agents.policies import GymPolicy, Policy
from planners.collision.space import Space
from wheelchair_gym.config import InputError
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, geodesic
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

ENDLESS = 1e-9  # m: a goal that is never near enough
_BLANK = OccupancyGrid(np.full((40, 40), FREE, np.int8), 0.1, (-2.0, -2.0, 0.0))
NOWHERE = Episode(_BLANK, np.zeros(3), np.array([1.0, 0.0, 0.0]), name="unknown")


@dataclass(frozen=True)
class Fidelity:
    """How true a map is."""

    right: float  # share of known cells: free without anything solid at their centres, or occupied
    # with a true surface within a cell's diagonal
    wall_median: float  # m from an occupied cell's centre to the nearest true surface
    wall_p95: float  # m
    floor_seen: float  # share of the floor that the chair's disc can reach, known to be free


def fidelity(made: OccupancyGrid, episode: Episode, radius: float) -> Fidelity:
    """How true a map is of an episode's world, in the same frame.

    Args:
        made: the map.
        episode: the world.
        radius: of a disc that fits into the chair [m].

    Raises:
        InputError: the map shows nothing.
    """
    free, solid = np.argwhere(made.cells == FREE), np.argwhere(made.cells == OCCUPIED)
    if not (len(free) and len(solid)):
        raise InputError("the map shows no wall, or nothing free; expected both")
    told = episode.map
    world = Space.from_walls(episode.walls, episode.discs, told.bounds).solid
    shapely.prepare(world)
    wrong = shapely.contains_xy(world, made.to_world(free))
    off = shapely.distance(shapely.points(made.to_world(solid)), shapely.boundary(world))
    right = len(free) - wrong.sum() + (off <= made.resolution * np.sqrt(2.0)).sum()
    floor = np.argwhere(np.isfinite(geodesic(told, episode.start[:2], radius).field))
    return Fidelity(
        float(right / (len(free) + len(solid))),
        float(np.median(off)),
        float(np.percentile(off, 95)),
        float((_at(made, told.to_world(floor)) == FREE).mean()),
    )


def _at(grid: OccupancyGrid, points: Array) -> NDArray[np.int8]:
    """A grid's cells (n,) at points (n, 2) [m]; off the grid nothing is known."""
    cells = grid.to_cell(points)
    found = np.full(len(points), UNKNOWN, np.int8)
    on = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
    found[on] = grid.cells[tuple(cells[on].T)]
    return found


@dataclass(frozen=True)
class Chart:
    """What came of a drive through an unknown scene."""

    grid: OccupancyGrid
    believed: Array  # (n, 3) m, m, rad
    true: Array  # (n, 3)
    seconds: float
    way: float  # m
    ended: str  # done, time, contact or stopped
    fidelity: Fidelity | None  # none where nobody knows the truth: of a real chair

    @property
    def figures(self) -> dict[str, Any]:
        """The figures as JSON takes them."""
        told = {"seconds": self.seconds, "way": self.way, "ended": self.ended}
        if self.fidelity is None:
            return told
        off = self.believed - self.true
        turn = np.remainder(off[:, 2] + np.pi, 2 * np.pi) - np.pi
        return {
            **told,
            "pose_rms_m": float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean())),
            "heading_rms_deg": float(np.degrees(np.sqrt((turn**2).mean()))),
            **asdict(self.fidelity),
        }


def chart(
    env: Any,
    policy: Policy,
    seed: int,
    seconds: float,
    each: Callable[[Any], object] = lambda env: None,
    *,
    real: bool = False,
) -> Chart:
    """Let a policy drive through a world whose chair draws its own map.

    It ends when the policy is done, when time is up, at a contact or at Ctrl-C.

    Args:
        env: with the pose source `slam`.
        policy: ends the drive with a command that says it is done.
        seed: of the episode.
        seconds: at most so long.
        each: called with the environment at each step.
        real: a real chair: there is no scene, and the map begins where the chair is.
    """
    scene = NOWHERE
    if not real:
        env.unwrapped.reset(seed=seed)  # unseen by recorders
        scene = env.unwrapped.episode
    endless = replace(scene, tolerance=ENDLESS, time_limit=seconds)
    observation, info = env.reset(seed=seed, options={"episode": endless})
    task = env.unwrapped.task
    believed, true = [info["pose_estimate"]], [info["pose"]]
    over, ended = False, "time"
    try:
        driver = GymPolicy(policy, env)
        driver.reset()
        while not over:
            each(env)
            action = driver.act(observation)
            if driver.command is not None and driver.command.done:
                ended = "done"
                break
            observation, _, bumped, late, info = env.step(action)
            believed.append(info["pose_estimate"])
            true.append(info["pose"])
            over = bumped or late
            ended = "contact" if bumped else ended
    except (KeyboardInterrupt, SystemError) as error:
        if not by_hand(error):
            raise
        ended = "stopped"
    grid = task.map
    found = None if real else fidelity(grid, scene, task.footprint.half_width)
    return Chart(
        grid, np.array(believed), np.array(true), info["time"], info["distance"], ended, found
    )
