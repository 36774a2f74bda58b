"""Laws of arrays that kernels take by address: each is checked before its address is taken."""

import re

import numpy as np
import pytest

from tests.conftest import at_start, modules
from tests.copies import differences
from wheelchair_gym.actors.records import ACTOR, Actors, combine, door, person, with_trolley
from wheelchair_gym.base.settings import FARTHEST, InputError
from wheelchair_gym.compiled.address import Pointers, as_array
from wheelchair_gym.engine import ENGINE
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.drivers import make_driver
from wheelchair_gym.people.drivers.live_person import LiveInput
from wheelchair_gym.perception.track_state import static_map_pointers
from wheelchair_gym.perception.tracker import Tracker
from wheelchair_gym.safety.shield import Shield
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.types import Chair, Episode

# Modules with records of addresses: their tables of what each address is of.
TABLES = {
    "wheelchair_gym.safety.shield": ("SHIELDS",),
    "wheelchair_gym.safety.state": ("CONSTANTS",),
    "wheelchair_gym.sim.chairs": ("WORLD", "CHAIRS"),
    "wheelchair_gym.sim.state": ("SUITE",),
    "wheelchair_gym.sensors.laser": ("SCANNER",),
    "wheelchair_gym.task.prepared_episode": ("PREPARED",),
    "wheelchair_gym.task.task": ("RULES", "TASK"),
    "wheelchair_gym.people.assistance.step": ("ASSISTANTS",),
    "wheelchair_gym.people.drivers.step": ("DRIVERS",),
    "wheelchair_gym.envs.vector": ("BATCH",),
    "wheelchair_gym.envs.one_chair": (),  # one row of the same
    "wheelchair_gym.envs.results": ("RESULTS",),
    "wheelchair_gym.perception.track_state": ("CONSTANTS", "STATIC_MAP"),
    "wheelchair_gym.perception.tracker": ("TRACKERS",),
}
# Fields of eight unsigned bytes that are no addresses of arrays.
HASHES = {"scan_hash", "sonar_hash"}
OTHERS = {"static_body", "surface", *(ENGINE.names or ()), "space", "body", "shape", "key", *HASHES}


# Of a world: kernels write them too, from an episode's record and from its own.
GROUND = {"walls", "discs", "actors", "routes"}


def test_addresses_are_taken_in_one_place():
    """An array's address is taken in `address`, and given to C in the emulator's binding."""
    for name, path in modules():
        text = path.read_text()
        if name != "wheelchair_gym.compiled.address":
            assert "address_of(" not in text, name
            assert "__array_interface__" not in text, name
        if name not in ("wheelchair_gym.compiled.address", "wheelchair_gym.hardware.twin.board"):
            assert "ctypes.data" not in text, name


def test_every_record_of_addresses_is_known():
    makers = {
        name
        for name, path in modules()
        if re.search(r"\bPointers\(\s*\S|\(Pointers\):", path.read_text())
        and name != "wheelchair_gym.compiled.address"
    }
    assert makers == set(TABLES)


def records_of(holder, depth=3):
    """Every `Pointers` that an object holds."""
    if isinstance(holder, Pointers):
        yield holder
    if isinstance(holder, list):
        for value in holder:
            yield from records_of(value, depth)
    elif depth and hasattr(holder, "__dict__"):
        for value in vars(holder).values():
            yield from records_of(value, depth - 1)


@pytest.fixture(scope="module")
def holders():
    env = at_start(NavigationEnv("crowd", shield=True, guidance="poses", bank=1))
    many = at_start(NavigationVectorEnv(2, scene="crowd", shield=True, bank=1))
    grid = OccupancyGrid(np.zeros((100, 100), np.int8), 0.1)
    result = env._loop._pool.take()
    chair = env.settings.chair, env.settings.sensors
    hand = LiveInput(make_driver("ataxia"), *chair, 0.05)
    helped = NavigationVectorEnv(
        2, scene="clutter", shield=True, driver="expert", assistant="slide", bank=1
    )
    helped.reset(seed=0)
    return env, many, result, Tracker(), [static_map_pointers([grid])], hand, helped


def test_every_address_field_says_what_it_points_to(holders):
    """Every set address belongs to an object that is kept alive."""
    seen = {}
    for pointers in (p for holder in holders for p in records_of(holder)):
        names = pointers.record.dtype.names
        fields = {n for n in names if pointers.record.dtype[n] == np.uint64} - OTHERS
        assert fields == set(pointers._targets)
        for row in range(len(pointers.record)):
            for name in fields - GROUND:
                array = pointers.array(name, row)
                address = int(pointers.record[name][row])
                assert address == (array.ctypes.data if (row, name) in pointers._kept else 0), name
        seen[names] = pointers
    assert len(seen) == sum(map(len, TABLES.values()))


def bad_arrays(target):
    """Arrays that are not what a target says."""
    shape = tuple(3 if length is None else length for length in target.shape)
    right = np.zeros(shape, target.dtype)
    yield np.zeros((*shape, 2), target.dtype)
    yield np.zeros(shape, np.float16)
    if target.dtype.newbyteorder() != target.dtype:
        yield right.astype(right.dtype.newbyteorder())
    if shape[-1] > 1:
        yield np.zeros((*shape[:-1], 2 * shape[-1]), target.dtype)[..., ::2]
    for k, length in enumerate(target.shape):
        if length is not None:
            yield np.zeros((*shape[:k], length + 1, *shape[k + 1 :]), target.dtype)


def test_no_record_takes_another_array_than_it_says(holders):
    for pointers in (p for holder in holders for p in records_of(holder)):
        names = list(pointers._targets)
        before = pointers.record[names].tolist()
        for name, target in pointers._targets.items():
            for array in bad_arrays(target):
                with pytest.raises(ValueError, match=r"an array"):
                    pointers.point(name, array)
        assert before == pointers.record[names].tolist()


GRID = OccupancyGrid(np.zeros((100, 100), np.int8), 0.1)
RIGHT = {
    "start": np.array([5.0, 5.0, 0.0]),
    "goal": np.array([8.0, 5.0, 0.0]),
    "walls": np.array([[0.0, 0, 10, 0], [10, 0, 10, 10], [10, 10, 0, 10], [0, 10, 0, 0]]),
    "discs": np.array([[2.0, 2.0, 0.3]]),
}
WALKER = combine([person([(2.0, 8.0), (8.0, 8.0)])])


def attacks(right):
    """Wrong arrays in place of a right one, and what they are."""
    yield "shape", right[..., :-1].copy()
    yield "shape", right[None]
    yield "shape", right.ravel()[:1].reshape(())
    yield "dtype", right.astype(object)
    yield "dtype", right.astype(str)
    yield "dtype", right.astype(complex)
    yield "ragged", [[1.0], [1.0, 2.0]]
    for value in (np.nan, np.inf, -np.inf, 1e155, -1e308, 2.0 * FARTHEST):
        for place in np.ndindex(right.shape):
            wrong = right.copy()
            wrong[place] = value
            yield f"{value}", wrong


def layouts(right):
    """The same array, laid out otherwise."""
    yield right.astype(">f8")
    yield np.repeat(right, 2, -1)[..., ::2]
    yield np.asfortranarray(right)
    yield right[::-1].copy()[::-1]
    yield right.tolist()
    odd = np.frombuffer(b"x" + right.tobytes(), np.uint8)[1:]
    yield odd.view(right.dtype).reshape(right.shape)


def refused(make):
    with pytest.raises(InputError) as told:
        make()
    assert len(str(told.value)) < 300


@pytest.mark.parametrize("name", RIGHT)
def test_an_episode_takes_no_wrong_array(name):
    for _what, wrong in attacks(RIGHT[name]):
        refused(lambda wrong=wrong: Episode(GRID, **(RIGHT | {name: wrong})))
    refused(lambda: Episode(GRID, **(RIGHT | {name: None})))


@pytest.mark.parametrize("name", RIGHT)
def test_how_an_array_lies_in_memory_changes_nothing(name):
    chair = SimulatedChair()
    known = chair.reset(Episode(GRID, **RIGHT), 1)
    for array in layouts(RIGHT[name]):
        episode = Episode(GRID, **(RIGHT | {name: array}))
        reading = chair.reset(episode, 1)
        assert not list(differences(known, reading))


@pytest.mark.parametrize("name", ["tolerance", "time_limit", "reference_length"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0])
def test_an_episode_takes_no_wrong_number(name, value):
    if name == "tolerance" and value == 0.0:  # a goal that is never reached
        assert Episode(GRID, **RIGHT, tolerance=value).tolerance == 0.0
        return
    refused(lambda: Episode(GRID, **RIGHT, **{name: value}))


def test_an_episode_takes_no_wrong_movers():
    rows, routes = WALKER
    for _what, wrong in attacks(routes):
        refused(lambda wrong=wrong: Episode(GRID, **RIGHT, actors=Actors(rows, wrong)))
    for wrong in (rows.view(np.uint8), rows[None], np.zeros(1), None):
        refused(lambda wrong=wrong: Episode(GRID, **RIGHT, actors=Actors(wrong, routes)))
    for name in ACTOR.names:
        kind = ACTOR[name].base.kind
        values = {"i": (-1, 1 << 40), "f": (np.nan,), "b": ()}[kind]
        values += (1e155, -np.inf) if name in ("pose", "travel") else ()
        for value in values:
            wrong = rows.copy()
            wrong[name] = value
            refused(lambda wrong=wrong: Episode(GRID, **RIGHT, actors=Actors(wrong, routes)))
    # A leaf without a width would be written where discs are; a force on an infinite mass is NaN.
    pushed, leaf = with_trolley(person([(2.0, 8.0)])), door((2.0, 8.0), 0.0, 1.0, 1.0)
    for name, value, k, things in (
        ("size", (1.0, 0.0), 0, [leaf]), ("mass", np.inf, 0, pushed), ("mass", np.inf, 1, pushed),
    ):  # fmt: skip
        actors = combine(things)
        actors.rows[name][k] = value
        refused(lambda actors=actors: Episode(GRID, **RIGHT, actors=actors))


def test_a_grid_takes_no_wrong_numbers():
    for bad in (np.zeros(4), np.zeros((0, 3)), np.full((2, 2), 300), np.full((2, 2), np.nan), "x"):
        refused(lambda bad=bad: OccupancyGrid(bad, 0.1))
    for resolution in (0.0, -1.0, np.nan, np.inf, 1e155):
        refused(lambda resolution=resolution: OccupancyGrid(GRID.cells, resolution))
    for origin in ((np.nan, 0, 0), (1e155, 0, 0), (0, 0, np.inf), (0, 0)):
        refused(lambda origin=origin: OccupancyGrid(GRID.cells, 0.1, origin))


def test_a_guidance_gives_no_wrong_path():
    episode = Episode(GRID, **RIGHT)
    for _what, wrong in attacks(np.array([[5.0, 5.0], [8.0, 5.0]])):
        env = NavigationEnv(guidance=lambda task, wrong=wrong: wrong, bank=1)
        with pytest.raises(ValueError, match=r"guidance"):
            env.reset(seed=0, options={"episode": episode})


class Told(Chair):
    """A chair that somebody made, and what it tells."""

    drive = truth = None  # never asked for

    def __init__(self, chair, reading):
        self.chair, self.reading = chair, reading

    def reset(self, episode, key):
        self.chair.reset(episode, key)
        return self.reading


def test_nobody_takes_a_reading_of_another_chair():
    shield = Shield()
    reading = SimulatedChair().reset(Episode(GRID, **RIGHT), 0)
    for name in ("laser", "ultrasonic", "age", "pose", "twist"):
        array = getattr(reading, name)
        for wrong in (array[:-1], array[None], array[:0]):
            told = reading._replace(**{name: wrong})
            with pytest.raises(ValueError, match=name):
                shield.update(told)
            chair = SimulatedChair()
            env = NavigationEnv(bank=1, chair=Told(chair, told))
            with pytest.raises(ValueError, match=name):
                env.reset(seed=0)


def test_as_array_keeps_a_right_array():
    array = np.zeros((3, 4))
    assert as_array(array, np.float64, (None, 4), "it") is array
    refused(lambda: as_array([-(2**63)], np.float64, (1,), "it", FARTHEST))
