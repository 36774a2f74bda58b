"""Attacks on the shield: policies that know the truth and mean harm, and a judge that does, too.

Nothing here uses the shield's own code. A contact counts where the chair caused it, as the
simulation says (`info["at_fault"]`), at more than 0.05 m/s. It *could have been seen* if its place,
or the other thing's surface there, lay unoccluded in some sensor's field at a moment in the last
3 s that was at least a stopping time before.
"""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from tests.edges import POSTS, SCREEN, SLABS, Edges
from wheelchair_gym.actors.bodies import actors_of, shapes_of
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import episode_key, uniform
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.geometry.kinematics import Limits, approach_twist, arc_step
from wheelchair_gym.geometry.outline import Footprint, footprint_clearance
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.safety.grid import place_of_cell
from wheelchair_gym.safety.state import CELL, outline_samples
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.state import FAULTS

KINDS: Final = (
    "random", "ahead", "wall", "actor", "edge", "backwards", "pivot", "switches", "greedy",
    "leaf", "slab", "post", "corner",
)  # fmt: skip
RANDOM, AHEAD, WALL, ACTOR, EDGE, BACKWARDS, PIVOT, SWITCHES, GREEDY = range(9)
LEAF, SLAB, POST, CORNER = range(9, len(KINDS))  # in a hall of `tests.edges`
SECONDS: Final = 8.0  # of an attack
MEMORY: Final = 3.0  # s
TICK: Final = 0.1  # s: attackers change their minds at such times
MASSES: Final = (60.0, 100.0, 180.0, 250.0)  # kg: of chairs, and of the bands of a report
SCENES: Final[dict[str, Any]] = {
    "clutter": {"name": "clutter", "density": 0.6},
    "floor_plan": {"name": "floor_plan"},
    "hall": {"name": "crowd", "place": "hall", "people": {"density": (0.05, 0.12)}},
    "crossing": {
        "name": "crowd",
        "place": "hall",
        "people": {"density": (0.05, 0.12), "crossing_share": 0.5, "inattentive_share": 0.5},
    },
    "building": {"name": "crowd", "place": "building"},
    # As wide as two beams at a stopping distance and the way of a reaction, or wider.
    "edges": Edges(0.009, 0.06),
}
THIN: Final = {"thin": Edges(0.0001, 0.008)}  # narrower: no law, counted apart
# As wide as is promised with fewer beams; a leaf of 40 mm is not, and is left out.
COARSE: Final = {"181_beams": Edges(0.053, 0.12), "64_beams": Edges(0.15, 0.30)}
BEAMS: Final = {"181_beams": 181, "64_beams": 64}
APART: Final[dict[str, Any]] = {**THIN, **COARSE}
# Only where they are named: people of every kind, by both models of motion, and cylinders.
FURTHER: Final[dict[str, Any]] = {
    "cylinders": {"name": "barn"},
    "people": {"name": "people"},
    "people_social_force": {"name": "people", "people": {"model": "social_force"}},
}
ALL: Final = SCENES | APART | FURTHER
HARM, SLOW = 0.05, 0.10  # m/s
_ACTORS = 48  # that are remembered of a row
_FAN = ((1.0, 0.0), (1.0, 0.4), (1.0, -0.4), (1.0, 1.0), (1.0, -1.0), (-1.0, 0.0), (-1.0, 1.0),
        (-1.0, -1.0), (0.0, 1.0), (0.0, -1.0))  # fmt: skip


@borrowing_kernel
def _edge(world: Any, key: np.uint64, kind: int, x: float, y: float) -> tuple[float, float]:
    """Return an attack's aim at something narrow: its end, or up to the outline's size aside."""
    walls, discs = shapes_of(world)
    which, aside = uniform(key, 0, 5, 0), 0.020 * uniform(key, 0, 5, 1) - 0.010
    if uniform(key, 0, 5, 2) < 0.4:
        aside *= 33.0  # up to the corners of the outline
    if kind == LEAF:
        number = min(int(which * world.n_actors), world.n_actors - 1)
        w = walls[actors_of(world)[1][number].slot + 3]  # its hinge
        f = walls[actors_of(world)[1][number].slot + 1]  # its other end
        tx, ty = 0.5 * (w[0] + w[2]), 0.5 * (w[1] + w[3])
        fx, fy = 0.5 * (f[0] + f[2]), 0.5 * (f[1] + f[3])
        if (fx - x) ** 2 + (fy - y) ** 2 < (tx - x) ** 2 + (ty - y) ** 2:
            tx, ty = fx, fy
    elif kind == SLAB:
        number = world.n_fixed_walls - 4 * (SLABS + 1) + 4 * int(which * SLABS)
        w = walls[number + 3]
        tx, ty = 0.5 * (w[0] + w[2]), 0.5 * (w[1] + w[3])
    elif kind == POST:
        number = int(which * POSTS)
        tx, ty = discs[number, 0], discs[number, 1]
    else:  # round the screen's end, and at what stands behind it
        tx, ty = discs[POSTS, 0], discs[POSTS, 1]
        first = world.n_fixed_walls - 4
        ox, oy = 0.0, 0.0
        for k in range(4):
            ox, oy = ox + 0.25 * walls[first + k, 0], oy + 0.25 * walls[first + k, 1]
        w = walls[first + 1]
        ex, ey = w[2] - w[0], w[3] - w[1]
        long = math.sqrt(ex * ex + ey * ey)
        side = math.copysign(1.0 / long, (tx - ox) * ex + (ty - oy) * ey)
        wx, wy = ox + side * ex * (SCREEN + 0.45), oy + side * ey * (SCREEN + 0.45)
        cross = (wx - ox) * (y - oy) - (wy - oy) * (x - ox)
        if cross * ((wx - ox) * (ty - oy) - (wy - oy) * (tx - ox)) < 0.0:
            along = ((x - ox) * ex + (y - oy) * ey) * side
            if along < SCREEN + 0.2:  # it is before the screen, and not yet beside its end
                return wx, wy
    far = math.sqrt((tx - x) ** 2 + (ty - y) ** 2)
    return tx - aside * (ty - y) / max(far, 0.1), ty + aside * (tx - x) / max(far, 0.1)


@borrowing_kernel
def aim(
    worlds: Any, pose: Array, footprint: Array, kinds: Any, keys: Any, steps: Any, out: Array
) -> None:
    """The actions (n, 2) of attackers.

    Args:
        worlds: (n,) of WORLD, the truth.
        pose: (n, 3) true.
        footprint: of the chair.
        kinds: (n,) of KINDS.
        keys: (n,) of each attack's randomness.
        steps: (n,) ticks since its beginning.
        out: (n, 2), is written.
    """
    for i in range(pose.shape[0]):
        world, key, kind, step = worlds[i], keys[i], kinds[i], steps[i]
        x, y, yaw = pose[i, 0], pose[i, 1], pose[i, 2]
        held = step // (3 + int(12 * uniform(key, 0, 0, 0)))
        u, v = uniform(key, held, 1, 0), uniform(key, held, 1, 1)
        walls, discs = shapes_of(world)
        if kind == RANDOM:
            out[i, 0], out[i, 1] = 2.0 * u - 1.0, 2.0 * v - 1.0
            continue
        if kind == AHEAD:
            out[i, 0], out[i, 1] = 1.0, 0.4 * (2.0 * v - 1.0)
            continue
        if kind == BACKWARDS:
            out[i, 0], out[i, 1] = -1.0, 2.0 * v - 1.0
            continue
        if kind == PIVOT:
            out[i, 0], out[i, 1] = 0.0, 1.0 if v < 0.5 else -1.0
            continue
        if kind == SWITCHES:
            k = int(9 * u)
            out[i, 0], out[i, 1] = k // 3 - 1.0, k % 3 - 1.0
            continue
        if kind == GREEDY and step % 3 == 0:
            worst, chosen = math.inf, 0
            for k in range(len(_FAN)):
                px, py, pyaw = x, y, yaw
                a, b = _FAN[k]
                speed = 0.8 * a if a > 0.0 else 0.3 * a
                gap = 0.0
                for j in range(1, 13):
                    px, py, pyaw = arc_step(px, py, pyaw, speed, b, 0.15)
                    gap = footprint_clearance(px, py, pyaw, footprint, walls, discs, 1.0)
                    if gap < 0.02:
                        gap = j * 0.01 - 1.0 + 0.05 * uniform(key, step, 2, k)
                        break
                if gap < worst:
                    worst, chosen = gap, k
            out[i, 0], out[i, 1] = _FAN[chosen]
            continue
        if kind == GREEDY:
            continue  # as before
        # Others drive at a point: the nearest of those of their kind that is not too near.
        best, tx, ty = math.inf, x + math.cos(yaw), y + math.sin(yaw)
        if kind >= LEAF:
            tx, ty = _edge(world, key, kind, x, y)
            best = math.sqrt((tx - x) ** 2 + (ty - y) ** 2)
        if kind == ACTOR and world.n_actors > 0:
            moving = actors_of(world)[1]
            for k in range(world.n_actors):
                own = moving[k]
                mx = own.pose[0] + own.twist[0] * 0.7 * v
                my = own.pose[1] + own.twist[1] * 0.7 * v
                far = math.sqrt((mx - x) ** 2 + (my - y) ** 2)
                if far < best:
                    best, tx, ty = far, mx, my
        for k in range(world.n_walls if best == math.inf else 0):
            ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
            ex, ey = bx - ax, by - ay
            square = ex * ex + ey * ey
            t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / max(square, 1e-9)))
            if kind == EDGE:
                t = 0.0 if t < 0.5 else 1.0
            qx, qy = ax + t * ex, ay + t * ey
            far = math.sqrt((qx - x) ** 2 + (qy - y) ** 2)
            far += 2.0 * uniform(key, 0, 3, k)
            if far < best:
                best, tx, ty = far, qx, qy
        looks = kind < LEAF and (kind != ACTOR or world.n_actors == 0)
        for k in range(world.n_discs if looks else 0):
            far = math.sqrt((discs[k, 0] - x) ** 2 + (discs[k, 1] - y) ** 2)
            far += 2.0 * uniform(key, 0, 4, k)
            if far < best:
                best, tx, ty = far, discs[k, 0], discs[k, 1]
        error = math.atan2(ty - y, tx - x) - yaw
        if kind == EDGE:  # beside it, so that a side or a rear corner meets it
            error += (0.5 if u < 0.5 else -0.5) * min(1.0, 0.8 / max(best, 0.3))
        error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
        out[i, 0] = 1.0 if abs(error) < 1.0 else 0.0
        out[i, 1] = min(1.0, max(-1.0, 2.0 * error))


_place_of_cell: Any = place_of_cell


def entering(shields: Any, twist: Array, outline: Array, memory: float) -> Array:
    """Return maximum speeds [m/s] (n,) of outlines into cells that no shield has seen of late.

    Args:
        shields: (n,) of SHIELD.
        twist: (n, 2) true.
        outline: front, rear, half width [m].
        memory: of the shields [s].
    """
    samples = outline_samples(*outline.tolist())
    ax, ay, nx, ny = (samples[name] for name in ("x", "y", "normal_x", "normal_y"))
    v, w = twist[:, :1], twist[:, 1:]
    vx, vy = v - w * ay, w * ax
    out = vx * nx + vy * ny
    back, aside = np.maximum(-vx[:, :2], 0.0), np.maximum(np.sign(ay[:2]) * vy[:, :2], 0.0)
    out[:, :2] = np.where(v > 0.05, 0.0, np.hypot(back, aside))  # rear corners
    x, y, yaw = shields["pose"].T[:, :, None]
    c, s = np.cos(yaw), np.sin(yaw)
    i = np.floor((x + c * ax - s * ay) / CELL).astype(int)
    j = np.floor((y + s * ax + c * ay) / CELL).astype(int)
    seen = shields["seen"][np.arange(len(shields))[:, None], _place_of_cell.py_func(i, j)]
    unseen = seen < shields["stamp"][:, None] - memory
    return np.array(np.where(unseen, out, 0.0).max(axis=1))


def stopping_time(v: float, w: float, limits: Limits) -> float:
    """Return the stopping time from a twist within the limits of comfort [s]."""
    t, sv, av, sw, aw = 0.0, v, 0.0, w, 0.0
    while max(abs(sv), abs(sw)) > 1e-3 and t < 10.0:
        sv, av, sw, aw = approach_twist(sv, av, sw, aw, 0.0, 0.0, limits.record, 0.05)
        t += 0.05
    return t


def _crosses(a: Array, b: Array, walls: Array, discs: Array) -> bool:
    """Return True if an object stands between a and b (2,)."""
    way = shapely.LineString([a, b])
    blocked = shapely.intersects(way, shapely.linestrings(walls.reshape(-1, 2, 2))).any()
    return bool(
        blocked or (shapely.distance(way, shapely.points(discs[:, :2])) < discs[:, 2]).any()
    )


def in_sight(
    pose: Array, point: Array, walls: Array, discs: Array, sensors: SensorSettings
) -> bool:
    """Return True if a point (2,) lies unoccluded in the field of a laser or an ultrasonic."""
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    rangers = sensors.ultrasonic
    eyes = [(one.x, one.y, one.yaw, 0.5 * one.fov, one.reach) for one in sensors.lasers]
    for one in rangers.mounted:
        model = rangers.narrow if one.model == "narrow" else rangers.wide
        eyes.append((one.x, one.y, one.yaw, 0.5 * model.field_of_view, model.reach))
    for ex, ey, turn, half, reach in eyes:
        eye = np.array([x + c * ex - s * ey, y + s * ex + c * ey])
        far = math.hypot(*(point - eye))
        off = math.remainder(math.atan2(*(point - eye)[::-1]) - yaw - turn, 2.0 * math.pi)
        if far > reach or abs(off) > half:
            continue
        short = eye + (point - eye) * max(0.0, 1.0 - 0.01 / max(far, 0.01))  # not the thing itself
        if not _crosses(eye, short, walls, discs):
            return True
    return False


def touching_point(pose: Array, footprint: Footprint, walls: Array, discs: Array) -> Array:
    """The point (2,) of what is solid that is nearest to the outline."""
    solid = shapely.union_all([
        *shapely.linestrings(walls.reshape(-1, 2, 2)),
        *shapely.buffer(shapely.points(discs[:, :2]), discs[:, 2], quad_segs=32),
    ])  # fmt: skip
    chair = shapely.Polygon(to_world(footprint.corners, pose))
    return shapely.get_coordinates(shapely.shortest_line(solid, chair))[0]


class Event(NamedTuple):
    """A contact that the chair caused, faster than 0.05 m/s."""

    seed: int  # of the row
    episode: int
    time: float  # s
    kind: str
    fault: str
    met: int
    closing: float  # m/s
    seen: bool  # it could have been
    cell: str  # of the table


@dataclass
class Report:
    """Result of attacks."""

    attacks: int = 0
    contacts: int = 0  # of any kind and cause
    events: list[Event] = field(default_factory=list)
    # Periods in which a shield let a twist pass ("") or changed it.
    reasons: Counter[str] = field(default_factory=Counter)
    # By kind, rate and mass: attacks, and contacts of any kind.
    cells: dict[str, list[int]] = field(default_factory=dict)

    def add(self, other: "Report") -> None:
        """Take in another."""
        self.attacks += other.attacks
        self.contacts += other.contacts
        self.events += other.events
        self.reasons.update(other.reasons)
        for name, counts in other.cells.items():
            self.count(name, *counts)

    def count(self, cell: str, attacks: int, contacts: int) -> None:
        """Count attacks and contacts of a cell of the table."""
        old = self.cells.get(cell, [0, 0])
        self.cells[cell] = [old[0] + attacks, old[1] + contacts]


def cell_of(kind: str, rate: float, mass: float) -> str:
    """The cell of the table for a kind, a rate [Hz] and a mass [kg]."""
    band = max(0, min(len(MASSES) - 2, int(np.searchsorted(MASSES, mass, "right")) - 1))
    return f"{kind},{rate:g},{MASSES[band]:g}-{MASSES[band + 1]:g}"


@borrowing_kernel
def shown(world: Any, walls: Array, discs: Array) -> None:
    """Copy what sensors could see now: walls (n, 4) and discs (m, 3), actors among them."""
    own_walls, own_discs = shapes_of(world)
    for k in range(world.n_walls):
        for i in range(4):
            walls[k, i] = own_walls[k, i]
    for k in range(world.n_discs):
        for i in range(3):
            discs[k, i] = own_discs[k, i]


@borrowing_kernel
def places(worlds: Any, out: Array) -> None:
    """Centres of all actors (n, k, 2) [m]; NaN where there is none."""
    for i in range(out.shape[0]):
        n = min(worlds[i].n_actors, out.shape[1])
        moving = actors_of(worlds[i])[1]
        for k in range(out.shape[1]):
            out[i, k, 0] = moving[k].pose[0] if k < n else math.nan
            out[i, k, 1] = moving[k].pose[1] if k < n else math.nan


REAR = {"x": -0.28, "yaw": math.pi, "beams": 541, "shows_free": True}


class Attack:
    """Many attackers at once, each of them with one attack after another.

    Args:
        scene: see `SCENES`.
        rows: at a time.
        shield: as of the environment.
        faults: share of attacks in which a sensor fails.
        bank: worlds.
        threads: of the environment.
        rate: of control [Hz].
        rear: a second scanner looks back and shows what is free.
    """

    def __init__(
        self, scene: str, rows: int, shield: Any = True, faults: float = 0.25, bank: int = 200,
        threads: int | None = None, rate: float = 10.0, rear: bool = False,
    ) -> None:  # fmt: skip
        config: dict[str, Any] = {
            "task": {"time_base": SECONDS, "time_factor": 0.0, "tolerance": 0.01, "beams": 64},
            "sensors": {
                "faults": {"share": faults, "onset": (0.5, 5.0)},
                "pose_source": "odometry",
            },
            "chair": {"randomize": True, "random": {"mass": [MASSES[0], MASSES[-1]]}},
        }
        if scene in BEAMS:
            config["sensors"]["laser"] = {"beams": BEAMS[scene]}
        if rear:
            config["sensors"]["more_lasers"] = [REAR]
        self.env = NavigationVectorEnv(
            rows, ALL[scene], config, split="test", shield=shield, num_threads=threads,
            bank={"size": bank, "turnover": 0.0}, rate=rate,
        )  # fmt: skip
        self._rate, self._memory = rate, round(MEMORY * rate) + 1
        self._kinds = np.arange(LEAF)
        if isinstance(self.env.settings.scene, Edges):
            self._kinds = np.arange(SLAB if scene in COARSE else LEAF, len(KINDS))
        self._sensors = self.env.settings.sensors

    def run(self, seed: int, each: int) -> Report:
        """Run `each` attacks in every row; row i is the single environment of seed + i."""
        env, n = self.env, self.env.num_envs
        outline = env.settings.chair.footprint.array
        _, info = env.reset(seed=seed)
        worlds, states = env.chairs.world_rows, env.chairs.states
        done, steps = np.zeros(n, np.int64), np.zeros(n, np.int64)
        memory, hold = self._memory, self._rate * TICK
        poses, twists = np.zeros((memory, n, 3)), np.zeros((memory, n, 2))
        others = np.full((memory, n, _ACTORS, 2), np.nan)
        chairs = env.chairs.parameters
        actions = np.zeros((n, 2))
        report, touched, at = Report(n * each), np.zeros(n, np.bool_), 0
        poses[0], twists[0] = info["pose"], info["twist"]
        places(worlds, others[0])
        keys, kinds = self._draw(seed, done)
        over = np.zeros(n, np.bool_)
        while (done < each).any():
            ticks = (steps / hold).astype(np.int64)
            aim(worlds, info["pose"].copy(), outline, kinds, keys, ticks, actions)
            _, _, terminated, truncated, info = env.step(actions)
            begun, at = over, at + 1
            over = terminated | truncated
            steps = np.where(begun, 0, steps + 1)
            now = at % memory
            poses[now], twists[now] = info["pose"], info["twist"]
            places(worlds, others[now])
            live = (done < each) & ~begun
            if "shield" in info:
                report.reasons.update(info["shield"]["reason"][live].tolist())
            contact = info["contact"] & live
            report.contacts += int((contact & ~touched).sum())
            touched |= contact
            for i in np.flatnonzero(over & live).tolist():
                cell = cell_of(KINDS[kinds[i]], self._rate, chairs["mass"][i])
                report.count(cell, 1, int(touched[i]))
            touched &= ~over
            harm = info["at_fault"] & (info["approach_speed"] > HARM) & live
            for i in np.flatnonzero(harm).tolist():
                past = [(at - k) % memory for k in range(min(int(steps[i]), memory - 1) + 1)]
                trace = poses[past, i], twists[past, i], others[past, i]
                fault = "" if steps[i] < states["fault_step"][i] else FAULTS[states["fault"][i]]
                report.events.append(
                    Event(
                        seed + i, int(done[i]), round(float(info["time"][i]), 3), KINDS[kinds[i]],
                        fault, int(info["contact_with"][i]),
                        round(float(info["approach_speed"][i]), 4),
                        self._could_be_seen(i, int(info["contact_with"][i]), trace),
                        cell_of(KINDS[kinds[i]], self._rate, chairs["mass"][i]),
                    )
                )  # fmt: skip
            done += over
            if begun.any():
                keys, kinds = self._draw(seed, done)
        return report

    def _draw(self, seed: int, done: NDArray[np.int64]) -> tuple[Any, Any]:
        """Keys and kinds of the attacks that begin or go on."""
        n = len(done)
        keys = np.array([episode_key(seed + i, int(done[i]), "test") for i in range(n)], np.uint64)
        return keys, self._kinds[(keys >> np.uint64(40)) % np.uint64(len(self._kinds))]

    def _could_be_seen(self, i: int, met: int, trace: tuple[Array, Array, Array]) -> bool:
        """Return True if row i's contact was in sight, a stopping time before, in the last 3 s."""
        settings, world = self.env.settings, self.env.chairs.world_rows[i]
        walls, discs = np.empty((world["n_walls"], 4)), np.empty((world["n_discs"], 3))
        shown(self.env.chairs.world_rows[i], walls, discs)
        poses, twists, others = trace
        footprint, limits = settings.chair.footprint, settings.chair.limits
        fixed = walls[: world["n_fixed_walls"]], discs[: world["n_fixed_discs"]]
        moving = walls[world["n_fixed_walls"] :], discs[world["n_fixed_discs"] :]
        place = touching_point(poses[0], footprint, *(fixed if met < 0 else moving))
        for k in range(1, len(poses)):
            if k / self._rate < stopping_time(*twists[k], limits):
                continue
            points = [place] if met < 0 else [place, place + others[k, met] - others[0, met]]
            for point in points:
                if np.isfinite(point).all() and in_sight(poses[k], point, *fixed, self._sensors):
                    return True
        return False
