"""The types of the interface: what a chair knows, its world, its task and its commands."""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.actors.records import Actors, check_actors, no_actors
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import FARTHEST, InputError
from wheelchair_gym.compiled.address import as_array, read_record
from wheelchair_gym.sensors.settings import SensorSettings

if TYPE_CHECKING:
    from wheelchair_gym.geometry.kinematics import Limits
    from wheelchair_gym.geometry.outline import Footprint
    from wheelchair_gym.maps import OccupancyGrid
    from wheelchair_gym.safety.settings import ShieldSettings
    from wheelchair_gym.sim.settings import ChairSettings


# One report of a drive board about the wheels: its fields stand in types.toml.
WHEELS = read_record("WHEELS", globals())[0]


class Stick(NamedTuple):
    """Signal of a person's interface to the chair.

    Attributes:
        forward: deflection in [-1, 1]; of the full speed forward or backward.
        left: deflection in [-1, 1]; of the full turn rate, counter-clockwise.
        latched: it lasts without the person's doing until a signal to stop.
    """

    forward: float
    left: float
    latched: bool


class Reading(NamedTuple):
    """Data that a chair can know at one instant; never changed in place.

    No echo is +inf, too near -inf, invalid NaN (REP-117). The environment fills in the last four
    for a policy (`NavigationEnv.reading`).

    Attributes:
        pose: (3,) m, m, rad: where the chair believes it is, in the map frame.
        twist: (2,) m/s, rad/s: forward speed and turn rate, counter-clockwise, from the encoders.
        laser: (beams,) m: ranges of each scanner, one after another (`SensorSettings.slices`);
            beams are counter-clockwise.
        ultrasonic: (8,) m: ranges; NaN where none is mounted; (10,) for a chair with ten.
        age: (8,) or (10,) s since each ultrasonic fired; +inf where none is mounted.
        bumped: a bumper strip is pressed.
        battery: its voltage [V].
        stamp: s since reset.
        halted: why the chair stands whatever the command; empty: it obeys commands.
        action: the last one asked of the chair, in [-1, 1].
        shield_intervention: what the shield took from the twist of that action [m/s, rad/s].
        map: drawn so far, where the chair draws its own map; else None.
        stick: of the person who drives; None where nobody does.
    """

    pose: Array
    twist: Array
    laser: NDArray[np.float32]
    ultrasonic: NDArray[np.float32]
    age: NDArray[np.float32]
    bumped: bool
    battery: float
    stamp: float
    halted: str = ""
    action: tuple[float, float] = (0.0, 0.0)
    shield_intervention: tuple[float, float] = (0.0, 0.0)
    map: OccupancyGrid | None = None
    stick: Stick | None = None


def check_reading(reading: Reading, sensors: SensorSettings) -> None:
    """Refuse a reading whose arrays have other shapes than the sensors give.

    Raises:
        ValueError: the first array that has, and its shape.
    """
    lengths = {"pose": 3, "twist": 2, "laser": sensors.beams}
    lengths |= dict.fromkeys(("ultrasonic", "age"), sensors.ultrasonic.columns)
    for name, length in lengths.items():
        found = getattr(reading, name).shape
        if found != (length,):
            raise ValueError(f"the reading's {name} has shape {found}; expected {(length,)}")


class Belief(NamedTuple):
    """Evidence that a pose source uses: for viewers and logs, never for a policy."""

    odometry: Array  # (3,) m, m, rad: dead-reckoned, in the frame odom (REP-105)
    particles: Array | None = None  # (n, 3) m, m, rad: where on the map the chair may be
    built_map: Callable[[], OccupancyGrid] | None = None  # a map that grows; None: the episode's


class Truth(NamedTuple):
    """The true state: for info and scores, never for an observation or a decision.

    A real chair fills it with the best it knows.
    """

    pose: Array  # (3,) m, m, rad
    twist: Array  # (2,) m/s, rad/s
    clearance: float  # m from the outline to the nearest obstacle, at most 2 m
    contact: bool  # touched anything during the last control period
    touched: bool  # touched anything since reset
    distance: float  # m driven since reset, forward and backward
    energy: float  # Wh drawn from the battery since reset
    at_fault: bool = False  # the chair caused a contact in that period (`sim.contact`)
    contact_with: int = -1  # the actor that it touched in that period; -1: none
    approach_speed: float = 0.0  # m/s at which the chair closed on what it touched
    other_approach_speed: float = 0.0  # m/s at which that closed on the chair
    actor_poses: Array = np.empty((0, 3))  # (k, 3) m, m, rad: where actors are; NaN: not there


def no_walls() -> Array:
    """Walls (0, 4) of an empty world."""
    return np.empty((0, 4))


def no_discs() -> Array:
    """Discs (0, 3) of a world without any."""
    return np.empty((0, 3))


class Arrival(NamedTuple):
    """When a chair counts as being at a goal that is a pose: a rectangle, a heading and a speed.

    Attributes:
        along: largest distance from the goal along its heading [m].
        across: the same across its heading [m].
        heading: largest error of the heading [rad].
        speed: largest speed, forward or backward [m/s].
    """

    along: float
    across: float
    heading: float
    speed: float


@dataclass(frozen=True)
class Episode:
    """A world, a start and a goal.

    Walls form closed loops with the solid on their left: a point is inside something solid exactly
    if they wind around it. Loops may overlap; a hole runs against the loop around it. The map is
    what the chair knows of the world.
    Neither an episode nor its arrays are ever changed: a deep copy of one is itself.

    Raises:
        InputError: an array has a wrong shape or type, or a value that is not finite or too large.
    """

    map: OccupancyGrid
    start: Array  # (3,) m, m, rad
    goal: Array  # (3,) m, m, rad; the heading counts only where the task asks for it
    walls: Array = field(default_factory=no_walls)  # (n, 4) m: x0, y0, x1, y1
    discs: Array = field(default_factory=no_discs)  # (m, 3) m: x, y, radius
    tolerance: float | None = None  # m: how near the goal counts, where the world says so
    time_limit: float | None = None  # s: where the world says so
    name: str = ""
    actors: Actors = field(default_factory=no_actors)  # which the map does not show
    reference_length: float | None = None  # m: the path length that its source measures speed with
    arrival: Arrival | None = None  # where the goal is a pose; the task's tolerances otherwise

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[int | None, ...]] = {"start": (3,), "goal": (3,)}
        shapes |= {"walls": (None, 4), "discs": (None, 3)}
        for name, shape in shapes.items():
            array = as_array(getattr(self, name), np.float64, shape, f"Episode.{name}", FARTHEST)
            object.__setattr__(self, name, array)
        if (self.discs[:, 2] < 0.0).any():
            raise InputError(f"Episode.discs has a radius of {self.discs[:, 2].min():g} m")
        for name in ("tolerance", "time_limit", "reference_length"):
            value = getattr(self, name)
            minimum = 0.0 if name == "tolerance" else math.ulp(0.0)  # 0 m: it never arrives
            if value is not None and not minimum <= value < math.inf:
                raise InputError(f"Episode.{name} is {value}; expected a positive number, or None")
        if self.arrival is not None:
            values = as_array(self.arrival, np.float64, (4,), "Episode.arrival", FARTHEST)
            if not (values > 0.0).all():
                raise InputError(f"Episode.arrival is {self.arrival}; expected positive numbers")
            object.__setattr__(self, "arrival", Arrival(*values.tolist()))
            if self.tolerance is None:
                object.__setattr__(self, "tolerance", float(values[:2].min()))
        object.__setattr__(self, "actors", check_actors(self.actors))

    def starting_at(self, start: Array) -> Episode:
        """The same episode from another start (3,) [m, m, rad]."""
        other = copy.copy(self)  # its other arrays are checked already
        where = as_array(start, np.float64, (3,), "Episode.start", FARTHEST)
        object.__setattr__(other, "start", where)
        return other

    def __deepcopy__(self, memo: dict[int, Any]) -> Episode:
        return self


@dataclass(frozen=True, eq=False)
class Mission:
    """Information for a policy before it drives. Policies may share one; none changes it.

    Attributes:
        map: of the world, unknown cells occupied; None: the chair draws its own (`Reading.map`).
        reading: the first, taken at the start.
        goal: (3,) m, m, rad, on the map; (2,) where no heading is asked for.
        tolerance: how near the goal counts [m].
        time_limit: of the episode [s].
        period: of control [s]: each command is driven for so long.
        chair: settings of the chair: outline, limits of speed and acceleration, drive.
        sensors: settings of the sensors: where they are mounted, their beams and noise.
        shield: settings of the shield that filters the commands; None: there is none.
        is_shielded: the shield filters this episode's commands.
        key: of the episode; seeds what a policy draws.
        real_time: time passes while the policy thinks, as on a real chair.
    """

    map: OccupancyGrid | None
    reading: Reading
    goal: Array
    tolerance: float
    time_limit: float
    period: float
    chair: ChairSettings
    sensors: SensorSettings
    shield: ShieldSettings | None
    is_shielded: bool
    key: int
    real_time: bool = False

    @property
    def start(self) -> Array:
        """Pose at which the chair believes that it starts (3,) [m, m, rad]."""
        return self.reading.pose

    @property
    def footprint(self) -> Footprint:
        """The chair's outline."""
        return self.chair.footprint

    @property
    def limits(self) -> Limits:
        """The chair's limits of speed and acceleration."""
        return self.chair.limits

    def map_at(self, reading: Reading) -> OccupancyGrid:
        """The map of the world; where the chair draws its own, the one drawn by a reading."""
        known = reading.map if self.map is None else self.map
        assert known is not None  # a chair without a map draws one
        return known


class Shown(NamedTuple):
    """Overlay of a policy for pictures, recordings and logs.

    Attributes:
        path: (n, 2) m: what it follows; None: pictures show the environment's guidance.
        status: what it is doing.
        plans: number of searches for a path in this episode, one for each map tried.
        rollout: (n, 3) m, m, rad: where its generated commands lead; None: it has none.
    """

    path: Array | None = None
    status: str = ""
    plans: int = 0
    rollout: Array | None = None


_NOTHING = Shown()


class Command(NamedTuple):
    """A policy's answer to a reading.

    Attributes:
        twist: (2,) m/s, rad/s: the forward speed and turn rate that it wants.
        shown: what people shall see.
        action: (2,) in [-1, 1]: what the twist was computed from, if the policy's own output is
            an action; else None.
        done: the policy has nothing left to do.
    """

    twist: Array
    shown: Shown = _NOTHING
    action: Array | None = None
    done: bool = False

    @classmethod
    def from_action(cls, action: Array, limits: Limits, shown: Shown = _NOTHING) -> Command:
        """The command that an action (2,) in [-1, 1] stands for."""
        return cls(limits.twist(action), shown, action)

    def as_action(self, limits: Limits) -> Array:
        """The action (2,) in [-1, 1] that asks for the twist, clipped to the limits."""
        return limits.action(self.twist) if self.action is None else self.action


class NotCopyable:
    """Base of what holds a line, a thread or a process: it can be neither copied nor pickled."""

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Refuse, before anything that it holds is looked at.

        Raises:
            TypeError: always.
        """
        raise TypeError(
            f"{type(self).__name__} holds what is outside this program: it can be neither copied "
            "nor pickled"
        )


class Chair(ABC):
    """Something that drives and senses. Time belongs to it: `drive` takes one control period.

    A chair implements `reset`, `drive` and `truth`. All other members have defaults: those of a
    chair that runs in real time, holds no resources, and that no person has to re-arm.

    Attributes:
        real_time: time passes while a policy thinks.
        needs_rearm: after some stops a person must re-arm it, see `rearm`.
        latched: why it has stopped until it is re-armed and reset; empty: it has not.
        waiting_for: what reset waits for a person to do; empty while it does not.
    """

    real_time = True
    needs_rearm = False
    latched = ""
    waiting_for = ""

    @abstractmethod
    def reset(self, episode: Episode, key: int) -> Reading:
        """Stand at the episode's start (a real chair stays where it is) and sense.

        Args:
            episode: the world, where the chair is simulated.
            key: seeds every random draw until the next reset.
        """

    @abstractmethod
    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """Drive towards a target twist for one control period, then sense.

        Args:
            twist: (2,) [m/s, rad/s].
            protective: come to rest at the protective rate instead, exempt from jerk.
        """

    @property
    @abstractmethod
    def truth(self) -> Truth:
        """The true state, as far as this chair knows it."""

    def close(self) -> None:  # noqa: B027
        """Stop, and release all resources."""

    @property
    def belief(self) -> Belief | None:
        """Evidence of the pose source; None: only the pose of the reading is known."""
        return None

    @property
    def report(self) -> dict[str, float | str] | None:
        """The state of a drive board, for recordings; None: there is no real chair."""
        return None

    @property
    def wheels(self) -> NDArray[np.void]:
        """Reports about the wheels since the reading before, (n,) of WHEELS; () where unknown."""
        return np.empty(0, WHEELS)

    @property
    def scan_stamps(self) -> Sequence[float]:
        """When each scanner made its scan of the latest reading [s]; () where unknown."""
        return ()

    @property
    def board_parameters(self) -> dict[str, dict[str, float]] | None:
        """Parameters that the boards have reported, by board; None: there is no real chair."""
        return None

    @property
    def late(self) -> Sequence[tuple[float, float]]:
        """End [s since reset] and delay [s] of each control period that ended late."""
        return ()

    def set_localized_pose(self, pose: Array) -> None:  # noqa: B027
        """Take the pose (3,) on the map that a localizer has estimated."""

    def rearm(self) -> None:  # noqa: B027
        """Re-arm the chair: called only for a person who has removed the cause of the stop."""

    def add_rearm_callback(self, callback: Callable[[], object]) -> None:  # noqa: B027
        """Call a function whenever a person has re-armed the chair."""

    def episode(self, goal: ArrayLike, start: ArrayLike | None = None) -> Episode | None:
        """Return an episode to a goal on the chair's own map; None: it has no map."""
        return None
