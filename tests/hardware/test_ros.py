"""Laws of a chair under ROS: driven by the same loop, and told to stop after every fault."""

import dataclasses
import itertools
import json
import math
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, closing, suppress
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest

from agents.cli import main
from agents.evaluation.evaluate import drive_episode
from agents.policies import make_policy
from tests.conftest import PATIENCE, ROOT, long_but, refusal, until
from tests.hardware.fake_rosbridge import RANGERS, SENSORS, FakeRosbridge, at, turned
from tests.hardware.served import Served, signals_kept
from wheelchair_gym import InputError
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.geometry.planar import point_segment_distance, to_world
from wheelchair_gym.hardware.connection import ClockSync
from wheelchair_gym.hardware.registry import chair_settings, make_chair
from wheelchair_gym.hardware.ros import messages as ros
from wheelchair_gym.hardware.ros.rosbridge import Rosbridge
from wheelchair_gym.hardware.ros.senses import RosSensors
from wheelchair_gym.hardware.ros.settings import RosbridgeSettings, RosSettings
from wheelchair_gym.hardware.settings import REST_SPEED
from wheelchair_gym.maps import OCCUPIED, read_map
from wheelchair_gym.sensors.settings import LaserSettings

CONFIG = {"sensors": {"laser": {"beams": 181}}, "task": {"beams": 181}}
LATE = {"scan": 0.4, "odometry": 0.4, "pose": 0.6, "command_timeout": 0.5, "latency": 0.4}
CALM = dict.fromkeys(LATE, PATIENCE)  # where nothing shall depend on how fast a machine is
ROOM = 3.0  # s, for a busy machine
AHEAD = np.array([0.3, 0.0])


@pytest.fixture
def bridge():
    with closing(FakeRosbridge()) as server:
        yield server


def spec(bridge, patience=PATIENCE, limits=CALM, **changes):
    limits = {**limits, "ready_timeout": patience}
    if bridge.rate is not None:
        changes = {"use_sim_time": True, "clock_timeout": PATIENCE} | changes
    return {"name": "ros", "host": "127.0.0.1", "port": bridge.port, "limits": limits, **changes}


@pytest.fixture
def waiting():
    """A bridge whose world waits for commands, and so for a machine that is slow."""
    with closing(FakeRosbridge(rate=math.inf)) as server:
        yield server


@pytest.fixture
def chair_of():
    """Makes chairs of bridges, which are closed at the end of the test."""
    with ExitStack() as stack:
        yield lambda *given, **changes: stack.enter_context(
            closing(make_chair(spec(*given, **changes), env_settings(CONFIG)))
        )


@pytest.fixture
def chair(bridge, chair_of, request):
    return chair_of(bridge, limits=LATE if request.node.get_closest_marker("realtime") else CALM)


def refused(ask):
    """Return the message of a chair that refuses to start."""
    with pytest.raises(InputError) as error:
        ask(np.ones(2), 0) if ask.__name__ == "reset" else ask(np.ones(2))
    return str(error.value)


def begun(chair, periods=3):
    """The chair, driving."""
    chair.reset(None, 0)
    for _ in range(periods):
        chair.drive(AHEAD)
    assert until(lambda: chair.drive(AHEAD).halted == "")
    return chair


def words_of(bridge, folder):
    """Words of a command that drives a bridge's chair; its files are in a folder."""
    (folder / "chair.json").write_text(json.dumps(CONFIG))
    (folder / "chairs.json").write_text(json.dumps({"ros": spec(bridge)}))
    return ["--chair", f"{folder / 'chairs.json'}:ros", "--config", f"{folder / 'chair.json'}"]


@pytest.mark.parametrize("pose_source", long_but(["modelled", "mcl"], ["mcl"]))
def test_a_policy_drives_it_from_start_to_goal(waiting, pose_source):
    """By the poses that tf tells, and by those that are worked out from odometry and map."""
    env = NavigationEnv(chair=spec(waiting), config=CONFIG, pose_source=pose_source, split="test")
    inner = env.chair if pose_source == "modelled" else env.chair.chair
    goal = waiting.episode.start[:2] + np.array([0.7, 0.2])
    episode = inner.episode(goal)
    np.testing.assert_array_equal(episode.map.cells, waiting.episode.map.cells)
    np.testing.assert_allclose(episode.start, waiting.episode.start, atol=1e-6)
    record = drive_episode(env, make_policy("visibility+window"), 0, episode=episode)
    env.close()
    assert record["success"]
    assert np.hypot(*(waiting.chair.truth.pose[:2] - goal)) < 0.3
    assert until(lambda: abs(waiting.reading.twist).max() < 0.01)  # which nobody but we told it to
    assert waiting.still
    assert not waiting.chair.truth.touched
    assert waiting.advertised == {"/ARDUINO1/Velocity": "geometry_msgs/Twist"}


def test_the_command_drives_it(waiting, tmp_path, capsys):
    file = tmp_path / "run.mcap"
    x, y = waiting.episode.start[:2] + np.array([0.6, 0.1])
    drive = ["simulate", *words_of(waiting, tmp_path), "--policy", "straight", "--pose", "odometry"]
    with signals_kept():
        assert main([*drive, "--goal", f"{x},{y}", "--record", str(file)]) == 0
    assert "success" in capsys.readouterr().out
    assert until(lambda: waiting.still)
    assert main(["replay", str(file)]) == 0
    capsys.readouterr()
    assert "--goal" in refusal(drive, capsys)


def test_it_maps_where_it_stands(waiting, tmp_path, capsys):
    """The drawn map agrees with the place, in the frame of the start pose."""
    begun = waiting.chair.truth.pose
    with signals_kept():
        survey = ["map", *words_of(waiting, tmp_path), "--time", "1.5"]
        assert main([*survey, "--out", str(tmp_path / "map"), "--quiet"]) == 0
    assert "explore on" in capsys.readouterr().out
    assert until(lambda: waiting.still)
    drawn = read_map(tmp_path / "map" / "map.yaml")
    seen = to_world(drawn.to_world(np.argwhere(drawn.cells == OCCUPIED)), begun)
    off = [min(point_segment_distance(x, y, *w) for w in waiting.episode.walls) for x, y in seen]
    assert len(seen) > 50
    assert np.quantile(off, 0.9) < 0.15


def test_a_reading_is_what_the_topics_said(bridge, chair_of):
    """Ranges, pose and twist to float32's rounding; what JSON cannot say is no echo."""
    chair = chair_of(bridge, ultrasonic=RANGERS, battery="/battery")
    chair.reset(None, 0)
    until(lambda: np.isfinite(chair.drive(np.zeros(2)).age).all())
    reading = chair.drive(np.zeros(2))
    told = bridge.reading  # it stands: only the noise varies
    assert reading.laser.shape == told.laser.shape
    both = np.isfinite(reading.laser) & np.isfinite(told.laser)
    np.testing.assert_allclose(reading.laser[both], told.laser[both], atol=0.15)
    dark = ~np.isfinite(reading.laser)  # null, which rosbridge writes for +inf and NaN
    assert np.isposinf(reading.laser[dark]).all()
    np.testing.assert_allclose(reading.pose, bridge.chair.truth.pose, atol=1e-3)
    assert (reading.age < CALM["pose"]).all()
    assert 30.0 < reading.battery < 42.0
    assert chair.truth.clearance > 0.0
    assert reading.halted == ""


def test_reset_stays_where_it_is(bridge, chair):
    """It stops, ignores where an episode starts, and begins its clock anew."""
    begun(chair, 12)
    reading = chair.reset(bridge.episode, 0)
    assert bridge.still
    assert np.abs(reading.twist).max() <= REST_SPEED
    assert np.hypot(*(reading.pose - bridge.episode.start)[:2]) > 0.05
    assert reading.stamp < 0.1


@kernel
def spin(rounds: int) -> float:
    """Keep a core busy, as a planner does."""
    total = 0.0
    for k in range(rounds):
        total += math.sin(total + k)
    return total


def test_what_it_is_told_keeps_to_the_limits(bridge, chair):
    """Limits of speed, acceleration and jerk hold: a base may have no ramps of its own."""
    limits, period = EnvSettings().chair.limits, chair.period
    chair.reset(None, 0)
    for twist in ([9.0, -9.0], [-9.0, 9.0]):
        before = len(bridge.commands)
        for _ in range(10):
            chair.drive(np.array(twist))
        _, v, w = np.array(bridge.commands[before:]).T
        assert -limits.backward <= v.min() <= v.max() <= limits.forward
        assert np.abs(w).max() <= limits.turn
        assert np.abs(np.diff(v)).max() <= limits.deceleration * period + 1e-9
        assert np.abs(np.diff(v, 2)).max() <= limits.jerk * period**2 + 1e-9
        assert np.abs(np.diff(w)).max() <= limits.turn_acceleration * period + 1e-9


@pytest.mark.realtime
def test_a_late_policy_does_not_drive_on(bridge, chair):
    spin(10)
    begun(chair)
    last = time.monotonic()
    assert not bridge.still
    while not bridge.still and time.monotonic() < last + PATIENCE:
        spin(20_000_000)
    assert bridge.commands[-1][0] - last < chair.settings.limits.command_timeout + ROOM
    assert until(lambda: abs(bridge.reading.twist).max() < 0.01)
    assert until(lambda: chair.drive(AHEAD).halted == "")  # it goes on when told to


def lengthened(message):
    return {**message, "ranges": message["ranges"][:-1]}


def muted(message):
    return None


def edited(old, new):
    return lambda message: json.loads(json.dumps(message).replace(old, new))


ON_SIDE = '"orientation": {"x": 0.5, "y": 0.5, "z": 0.5, "w": 0.5}, "_": {'
WRONG = {
    "a beam too few": ("/scan", lengthened, "laser.fov"),
    "words for ranges": ("/scan", lambda m: {**m, "ranges": ["x"] * 181}, "could not convert"),
    "ranges in ranges": ("/scan", lambda m: {**m, "ranges": [[1.0, 2.0], [3.0]]}, "inhomogeneous"),
    "a single beam": ("/scan", lambda m: {**m, "ranges": [1.0]}, "1 ranges; expected 2 to"),
    "another fan": ("/scan", lambda m: {**m, "angle_increment": 0.001}, "laser.fov"),
    "no angle": ("/scan", lambda m: {**m, "angle_min": None}, "not made as its type says"),
    "time goes back": ("/scan", lambda m: later(m, -100), "older than the one before"),
    "time stands still": ("/scan", lambda m: m, "older than the one before"),
    "odometry is null": (
        "/ARDUINO1/Odom", edited('on": {"x": ', 'on": {"x": null, "_": '), "not finite",
    ),
    "odometry is a list": ("/ARDUINO1/Odom", lambda m: [m], "not made as its type says"),
    "odometry lacks its twist": ("/ARDUINO1/Odom", lambda m: {"pose": m["pose"]}, "'twist'"),
    "odometry has NaN": ("/ARDUINO1/Odom", edited('"x": ', '"x": NaN, "_": '), "finite"),
    "it lies on its side": ("/ARDUINO1/Odom", edited('"orientation": {', ON_SIDE), "by 90 deg"),
    "no quaternion": ("/ARDUINO1/Odom", edited('"w": ', '"w": 7, "_": '), "norm is not 1"),
    "a cell too few": ("/map", lambda m: {**m, "data": m["data"][1:]}, "cells; expected"),
    "a cell of 101": ("/map", lambda m: {**m, "data": [101, *m["data"][1:]]}, "beyond -1 to 100"),
    "a map of nothing": ("/map", lambda m: {**m, "info": {**m["info"], "width": 0}}, "at least"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_messages_are_not_used_and_named(bridge, wrong, caplog):
    topic, mangle, why = WRONG[wrong]
    senses = RosSensors(RosSettings(), SENSORS, False)
    message = bridge._map() if topic == "/map" else bridge._messages()[topic]()
    senses.receive(topic, message, 1.0)
    known = dict(senses._newest)
    assert senses.describe_silence(topic) == f"{topic} is silent"
    for _ in range(3):
        senses.receive(topic, mangle(json.loads(json.dumps(message))), 1.1)
    assert why in senses.describe_silence(topic)
    assert senses._newest == known
    assert len(caplog.records) == 1  # said once


def test_a_null_range_is_no_echo_unless_the_settings_say_otherwise(bridge):
    """Rosbridge writes null for +inf; a NaN that is written as such stays invalid."""
    messages = bridge._messages()
    scan, range_ = messages["/scan"](), messages[RANGERS[0]]()
    scan["ranges"][3:5] = [None, math.nan]
    topics, ten = (*RANGERS, "/8", "/9"), env_settings(None, model="rear_ultrasonics").sensors
    sensors = dataclasses.replace(SENSORS, ultrasonic=ten.ultrasonic)
    for null, wanted in (({}, math.inf), ({"null_range": "invalid"}, math.nan)):
        senses = RosSensors(RosSettings(ultrasonic=topics, **null), sensors, False)
        senses.receive("/scan", scan, 1.0)
        for topic, value in zip(topics, (None, math.nan, *[1.0] * 8), strict=True):
            senses.receive(topic, {**range_, "range": value}, 1.0)
        laser, sonar, _ = senses.ranges(1.0)
        np.testing.assert_equal(laser[3:5], np.array([wanted, math.nan], np.float32))
        np.testing.assert_equal(sonar, np.array([wanted, math.nan, *[1.0] * 8], np.float32))
        senses.receive("/scan", {**scan, "ranges": [None] * 181}, 2.0)
        assert "no range that is a number" in senses.describe_silence("/scan")


STAMPS = {
    "Infinity": ('{"secs": Infinity, "nsecs": 0}', "expected 0 to"),
    "NaN": ('{"sec": NaN, "nanosec": 0}', "expected 0 to"),
    "an infinite part": ('{"sec": 1, "nanosec": Infinity}', "expected 0 to"),
    "negative": ('{"sec": -5, "nanosec": 0}', "expected 0 to"),
    "beyond 32 bits": ('{"sec": 4294967296, "nanosec": 0}', "expected 0 to"),
    "an hour ahead": ('{"sec": 15946, "nanosec": 0}', "later than its clock showed"),
    "years behind": ('{"sec": 5, "nanosec": 0}', "older than the one before"),
}


def test_no_stamp_switches_freshness_off(bridge, caplog):
    """It is refused with one line, silence is still noticed, and what comes next is used."""
    bridge.skew = -time.monotonic()
    for text, why in STAMPS.values():
        senses = RosSensors(RosSettings(), SENSORS, False)
        for topic in ("/scan", "/ARDUINO1/Odom"):
            caplog.clear()
            message = bridge._messages()[topic]()
            wrong = {**message, "header": {**message["header"], "stamp": json.loads(text)}}
            senses.receive(topic, message, 1.0)
            senses.receive(topic, wrong, 1.05)
            assert why in senses.describe_silence(topic)
            senses.receive(topic, wrong, 1.06)
            assert len(caplog.records) == 1
            bridge.skew += 0.1
            senses.receive(topic, bridge._messages()[topic](), 1.1)
        assert senses.stale(1.15) == ""
        assert "/scan is silent" in senses.stale(60.0)
        senses.clear()
        for topic in ("/scan", "/ARDUINO1/Odom"):  # as the first of all
            message = bridge._messages()[topic]()
            senses.receive(
                topic, {**message, "header": {"frame_id": "", "stamp": json.loads(text)}}, 1
            )
        assert "is silent" in senses.stale(60.0)


def test_every_broadcaster_of_static_transforms_is_heard(bridge, chair_of):
    """Each says its own edges, all at the start; the laser is attached to a chain of them."""
    x, y, yaw = bridge.mounted
    links = ["base_link", *(f"link_{k}" for k in range(20)), "laser_link"]
    bridge.statics = [
        lambda pair=pair, k=k: bridge._edge(*pair, (x, y, yaw) if k == 0 else (0.0, 0.0, 0.0))
        for k, pair in enumerate(itertools.pairwise(links))
    ]
    chair = chair_of(bridge)
    chair.reset(None, 0)
    assert until(lambda: chair.senses.pose_in("laser_link", "base_link") is not None)
    assert until(lambda: chair.drive(np.zeros(2)).halted == "")


def test_a_transform_that_is_broken_costs_itself_only(bridge):
    senses = RosSensors(RosSettings(), SENSORS, True)
    good = bridge._edge("base_link", "laser_link", bridge.mounted)
    senses.receive("/tf_static", {"transforms": [{"header": {}}, good, 7]}, 1.0)
    assert senses.pose_in("laser_link", "base_link") is not None


def test_a_static_transform_that_comes_late_stops_it_until_the_next_scan(bridge, chair):
    begun(chair)
    bridge.mangle["/scan"] = muted
    late = {"transforms": [bridge._edge("base_link", "camera", (0.1, 0.0, 0.0))]}

    def driven():
        chair.senses.receive("/tf_static", late, chair.clock.now())
        return chair.drive(AHEAD)

    assert until(lambda: (one := driven()).halted and np.isnan(one.laser).all())
    bridge.mangle.clear()
    assert until(lambda: chair.drive(AHEAD).halted == "")


def test_a_latched_map_may_come_again(bridge):
    senses = RosSensors(RosSettings(), SENSORS, True)
    for came in (1.0, 9.0):
        senses.receive("/map", bridge._map(), came)
        assert senses.map is not None
        senses.clear()


def test_each_episode_has_the_map_that_is_published_then(bridge, chair):
    goal = bridge.episode.start[:2] + np.array([0.7, 0.2])
    x, y, _ = chair.episode(goal).map.origin
    origin = {"position": at(x - 0.5, y), "orientation": turned(0.0)}
    bridge.mangle["/map"] = lambda m: {**m, "info": {**m["info"], "origin": origin}}
    assert chair.episode(goal).map.origin == (x - 0.5, y, 0.0)


def test_a_guard_that_fails_sends_zero_until_a_reset(bridge, chair):
    """It is the only part that watches the chair; it fails here whenever it looks."""
    begun(chair)
    stale, guard = chair.senses.stale, f"{chair.url} guard"

    def fail(now):
        if threading.current_thread().name == guard:
            raise KeyError("/scan")
        return stale(now)

    chair.senses.stale = fail
    assert until(lambda: chair.latched == "the guard has failed (KeyError('/scan'))")
    assert until(lambda: bridge.still)
    assert chair.drive(AHEAD).halted == chair.latched
    chair.senses.stale = stale
    begun(chair)


def test_a_service_without_a_name_does_not_end_the_link(chair):
    assert chair._link._take('{"op": "call_service", "service": []}', 0.0) == ""


@pytest.mark.realtime
def test_silence_is_measured_in_simulated_time(chair_of):
    """A simulation at half of real time is driven; one that is paused is named as that."""
    with closing(FakeRosbridge(rate=0.5)) as slow:
        chair = chair_of(slow, clock_timeout=1.0)
        chair.reset(None, 0)
        begin, wall = slow.simulated, time.monotonic()
        halts = {chair.drive(AHEAD).halted for _ in range(5)}
        assert halts == {""}
        assert slow.simulated - begin > 0.35
        assert time.monotonic() - wall > 0.7
        slow.paused = True
        assert until(lambda: "/clock has stood still" in chair.drive(AHEAD).halted)
        assert until(lambda: slow.still)
        slow.paused = False
        assert until(lambda: chair.drive(AHEAD).halted == "")
        slow.skew -= 10.0  # the simulation begins anew
        assert until(lambda: chair.drive(AHEAD).halted == "")
        chair.close()
        slow.paused = True
        paused = chair_of(slow, clock_timeout=0.2, patience=0.2)
        with pytest.raises(InputError, match=r"/clock has (stood still|reported no time)"):
            paused.reset(None, 0)


def test_simulated_time_that_the_settings_do_not_know_of_is_named():
    senses = RosSensors(RosSettings(), SENSORS, False)
    assert senses.stale(1.0) == "/scan is silent: does its node run, is this its name?"
    senses.receive("/clock", {"clock": {"sec": 5, "nanosec": 0}}, 1.0)
    assert "simulated time: for a simulation set use_sim_time" in senses.stale(1.0)


FAULTS = {
    "scan is silent": ("/scan", muted, "/scan is silent"),
    "odometry is silent": ("/ARDUINO1/Odom", muted, "/ARDUINO1/Odom is silent"),
    "tf is silent": ("/tf", muted, "base_link"),
    "a beam too few": ("/scan", lengthened, "laser.fov"),
}


@pytest.mark.realtime
@pytest.mark.parametrize("fault", long_but(FAULTS, ["scan is silent", "tf is silent"]))
def test_what_is_silent_or_wrong_stops_it(bridge, chair, fault):
    """Zero within the limit and a period; the reading says why; it goes on when all is well."""
    topic, mangle, why = FAULTS[fault]
    begun(chair)
    bridge.mangle[topic] = mangle
    wrong = time.monotonic()
    while not (reading := chair.drive(AHEAD)).halted:
        assert time.monotonic() - wrong < PATIENCE
    assert why in reading.halted
    assert until(lambda: bridge.still)
    first = next(t for t, v, w in bridge.commands if t > wrong and (v, w) == (0.0, 0.0))
    limit = LATE["pose"] if topic == "/tf" else LATE["scan"]
    assert first - wrong < limit + chair.period + ROOM
    assert until(lambda: np.isnan(chair.drive(AHEAD).laser).all() == (topic == "/scan"))
    assert bridge.still  # in vain
    bridge.mangle.clear()
    assert until(lambda: chair.drive(AHEAD).halted == "")
    chair.drive(AHEAD)
    assert not bridge.still


BREAKS = {
    "garbage": lambda bridge: bridge.say('{"op": "publish", "topic": "/scan", "msg": {"ra'),
    "no object": lambda bridge: bridge.say("[1, 2]"),
    "no operation": lambda bridge: bridge.say('{"topic": "/scan"}'),
    "deep": lambda bridge: bridge.say("[" * 100_000),
    "bytes": lambda bridge: bridge.say(b"\x81\xa2op"),
    "fragment": lambda bridge: bridge.say('{"op": "fragment", "id": "0", "data": "", "num": 0}'),
    "png": lambda bridge: bridge.say('{"op": "png", "data": "iVBORw0"}'),
    "too large": lambda bridge: bridge.say('{"op": "publish", "topic": "/t"}'),
    "cut": FakeRosbridge.cut,
    "closed": lambda bridge: [c.close() for c in list(bridge._told)],
}


@pytest.mark.parametrize("way", BREAKS)
def test_a_link_that_cannot_be_trusted_is_given_up_with_a_last_word(bridge, way):
    hear = Mock(side_effect=MemoryError)
    link = Rosbridge("127.0.0.1", bridge.port, hear, RosbridgeSettings())
    link.farewell = ("/v", lambda: {"linear": {"x": 0.0}, "angular": {"z": 0.0}})
    link.advertise("/v", "geometry_msgs/Twist")
    link.publish("/v", {"linear": {"x": 1.0}, "angular": {"z": 0.0}})
    assert until(lambda: len(bridge.commands) == 1)
    BREAKS[way](bridge)
    assert link.closed.wait(PATIENCE)
    assert link.lost
    assert "\n" not in link.lost
    link.publish("/v", {"linear": {"x": 1.0}, "angular": {"z": 0.0}})  # nothing follows
    link.close()
    if way not in ("cut", "closed"):
        assert until(lambda: [v for _, v, _ in bridge.commands] == [1.0, 0.0])
    assert hear.called == (way == "too large")


@pytest.mark.parametrize("way", ["garbage", "cut"])
def test_a_link_that_breaks_is_one_line_and_a_last_zero(bridge, chair, way):
    begun(chair)
    count = len(bridge.commands)
    BREAKS[way](bridge)
    with pytest.raises(ConnectionError) as error:
        until(lambda: chair.drive(AHEAD) is None)
    said = str(error.value)
    assert "\n" not in said
    assert said.startswith(f"{bridge.url}: the link is lost")
    if way == "garbage":  # the words were heard: the last is to stand
        assert until(lambda: len(bridge.commands) > count and bridge.still)
    with pytest.raises(ConnectionError):  # it stays lost
        chair.reset(None, 0)


@pytest.mark.parametrize("way", ["close", "exception"])
def test_every_way_out_ends_with_zero(bridge, way):
    env = gym.make("wheelchair_gym/Navigation-v1", chair=spec(bridge), config=CONFIG, split="test")
    chair = env.unwrapped.chair
    env.reset(options={"episode": chair.episode(bridge.episode.start[:2] + np.array([2.0, 0.0]))})
    with suppress(ZeroDivisionError), closing(env):
        for _ in range(4):
            env.step(np.array([0.4, 0.0], np.float32))
        if way == "exception":
            raise ZeroDivisionError
    env.close()  # twice does no harm
    assert until(lambda: bridge.still)
    assert until(lambda: abs(bridge.reading.twist).max() < 0.01)
    with pytest.raises(ValueError, match="closed"):
        chair.drive(AHEAD)
    assert not [t for t in threading.enumerate() if t.name.startswith(bridge.url) and t.is_alive()]


SCRIPT = """
import sys, numpy as np
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.registry import make_chair
chair = make_chair({spec!r}, env_settings({config!r}))
chair.reset(None, 0)
while True:
    chair.drive(np.array([0.3, 0.0]))
    print("drives", flush=True)
"""


@pytest.mark.parametrize("end", long_but((signal.SIGINT, signal.SIGTERM), (signal.SIGTERM,)))
def test_a_program_that_is_ended_stops_it(bridge, end, tmp_path):
    """Ctrl-C in a script that never closes anything; a terminated command."""
    if end == signal.SIGINT:
        command = ["-c", SCRIPT.format(spec=spec(bridge), config=CONFIG)]
    else:
        x, y = bridge.episode.goal[:2]
        command = ["-m", "wheelchair_gym", "simulate", *words_of(bridge, tmp_path)]
        command += ["--policy", "straight", "--goal", f"{x},{y}"]
    program = subprocess.Popen(
        [sys.executable, *command], cwd=ROOT, stderr=subprocess.PIPE, text=True,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    assert until(lambda: not bridge.still)
    program.send_signal(end)
    said = program.communicate(timeout=PATIENCE)[1]
    assert until(lambda: bridge.still)
    assert program.returncode != 0
    if end == signal.SIGTERM:
        assert said.strip().splitlines()[-1] == "wheelchair: stopped"


def test_what_does_not_answer_is_one_line(tmp_path, capsys):
    plain = socket.create_server(("127.0.0.1", 0))  # listens, and says nothing
    taken = plain.getsockname()[1]
    free = socket.socket()  # bound, so that nobody else takes it, and refuses
    free.bind(("127.0.0.1", 0))
    nobody = free.getsockname()[1]
    chairs = tmp_path / "chairs.json"
    silent = {"name": f"ros://127.0.0.1:{taken}", "link": {"connect_timeout": 0.3}}
    chairs.write_text(json.dumps({"silent": silent}))
    for chair, why in (
        (f"ros://127.0.0.1:{nobody}", "no rosbridge answers"),
        (f"{chairs}:silent", "no rosbridge answers"),
        ("ros://", "expected ros://HOST:PORT"),
        ("ros://x:y", "expected ros://HOST:PORT"),
        *((f"ros://{x}", "expected ros://HOST:PORT") for x in ("x:99999", "me@x", "x:1?tls=true")),
        ("tcp://x:1", "there are hardware, ros, twin"),
    ):
        quick = ["--policy", "a_star+pure_pursuit"]  # its rehearsal is short
        assert why in refusal(["simulate", "--chair", chair, "--goal", "1,1", *quick], capsys)
    plain.close(), free.close()


@pytest.mark.parametrize("topic", ["/scan", "/tf", "/map", RANGERS[3]])
def test_what_never_comes_is_named(bridge, chair_of, topic):
    why = "base_link is on map" if topic == "/tf" else f"{topic} is silent"
    bridge.mangle[topic] = muted
    chair = chair_of(bridge, patience=0.3, ultrasonic=RANGERS)
    ask = chair.reset if topic in ("/scan", *RANGERS) else chair.episode
    assert until(lambda: why in refused(ask))  # where a machine is slow, others come late, too


def test_a_goal_must_be_on_free_ground(bridge, chair):
    solid = np.argwhere(bridge.episode.map.cells == OCCUPIED)[0]
    inside = bridge.episode.map.to_world(solid)
    for goal, start in ((inside, None), ([100.0, 1.0], None), ([1.0, 1.0], [-50.0, 1.0, 0.0])):
        with pytest.raises(InputError, match="free ground of /map"):
            chair.episode(goal, start)


def test_a_laser_that_sits_elsewhere_is_not_driven_by(bridge, chair_of):
    """Turned round in the settings or on the chair: obstacles would stand on the wrong side."""
    bridge.mounted = 0.66, 0.0, math.pi
    chair = chair_of(bridge)
    with pytest.raises(InputError, match=r"180 deg; sensors.laser says \(0.66, 0.00\) m, 0 deg"):
        chair.reset(None, 0)


def test_a_chair_that_rolls_on_is_not_begun_with(bridge, chair_of):
    chair = chair_of(bridge, patience=0.3)

    def rolls(message):
        message["twist"]["twist"]["linear"]["x"] = 0.4
        return message

    bridge.mangle["/ARDUINO1/Odom"] = rolls
    assert until(lambda: "does not come to rest (0.40 m/s" in refused(chair.reset))


def test_ages_do_not_depend_on_the_other_clock():
    """A message is as old as it took longer than the quickest one before it."""
    rng = np.random.default_rng(0)
    clock, now, quickest = ClockSync(drift=0.0), 0.0, math.inf
    for step, delay in rng.uniform((0.3, 0.0), (1.0, 0.3), (200, 2)).tolist():
        now += step
        taken = clock.host_time(now - delay + 1e6, now)
        quickest = min(quickest, delay)
        assert now - taken == pytest.approx(delay - quickest, abs=1e-6)
    with pytest.raises(ValueError, match="older"):
        clock.host_time(now - 10.0 + 1e6, now + 1.0)
    assert clock.host_time(math.nan, 5.0) == 5.0  # it says no time: when it came


WORDS = (
    "header", "stamp", "secs", "nsecs", "ranges", "angle_min", "pose", "transforms", "x", "info",
    "data", "width", "height", "range", "transform", "rotation", "translation", "voltage",
)  # fmt: skip


def anything(rng, depth=4):
    """Draw a random JSON value."""
    kind = int(rng.integers(8 if depth else 6))
    if kind == 6:
        return [anything(rng, depth - 1) for _ in range(rng.integers(4))]
    if kind == 7:
        return {str(key): anything(rng, depth - 1) for key in rng.choice(WORDS, 6)}
    return (None, True, 10**400, math.nan, "x", -1.5)[kind]


def test_no_message_does_harm(bridge):
    """Neither random ones, nor right ones with a part exchanged."""
    rng = np.random.default_rng(0)
    senses = RosSensors(RosSettings(ultrasonic=RANGERS, battery="/battery"), SENSORS, True)
    right = {topic: make() for topic, make in bridge._messages().items()}
    for _ in range(300):
        for topic in ("/scan", "/ARDUINO1/Odom", "/tf", "/map", "/battery", RANGERS[0]):
            senses.receive(topic, anything(rng), 1.0)
            message = json.loads(json.dumps(right.get(topic, {})))
            part = message
            while isinstance(part, dict) and part and rng.random() < 0.7:
                key = str(rng.choice(list(part)))
                if not isinstance(part[key], dict):
                    part[key] = anything(rng, 1)
                part = part[key]
            senses.receive(topic, message, 1.0)
            senses.map_pose()


def of_a_circle(beams, clockwise=False, first=-math.pi):
    """A scan of the whole circle, and the distance at each angle: 2 m, 1 m to the left."""
    step = 2.0 * math.pi / beams
    angles = first + step * np.arange(beams)
    ranges = np.where(np.abs(np.mod(angles, 2 * np.pi) - math.pi / 2) < 0.3, 1.0, 2.0)
    ends = (angles[0], angles[-1], step)
    if clockwise:
        ranges, ends = ranges[::-1], (angles[-1], angles[0], -step)
    header = {"frame_id": "laser", "stamp": {"sec": 1, "nanosec": 0}}
    names = ("angle_min", "angle_max", "angle_increment")
    return {
        "header": header, "range_min": 0.05, "range_max": 12.0, "ranges": ranges.tolist(),
        **dict(zip(names, ends, strict=True)),
    }  # fmt: skip


@pytest.mark.parametrize("beams", [90, 360, 1440])
@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("first", [-math.pi, 0.0, 1.0])
def test_scans_of_the_whole_circle_are_resampled(beams, clockwise, first):
    laser = SENSORS.laser
    out = ros.scan(of_a_circle(beams, clockwise, first), laser, math.inf)
    assert out.shape == (laser.beams,)
    off = np.abs(laser.angles - math.pi / 2)
    near = 2.0 * math.pi / beams + laser.fov / (laser.beams - 1)
    assert (out[off < 0.3 - near] == 1.0).all()
    assert (out[off > 0.3 + near] == 2.0).all()


def test_the_least_range_next_to_a_beam_counts_and_rep_117_holds():
    laser, message = SENSORS.laser, of_a_circle(3600)
    ahead = 1800
    message["ranges"][ahead - 3] = 0.7  # a leg of a chair, which a beam of ours alone would miss
    assert ros.scan(message, laser, math.inf)[90] == np.float32(0.7)
    wide = of_a_circle(3600)
    for value, wanted in (
        (math.inf, math.inf), (-math.inf, -math.inf), (math.nan, math.nan), (0.01, -math.inf),
        (0.0, math.nan), (50.0, math.inf),
    ):  # fmt: skip
        wide["ranges"][ahead - 20 : ahead + 20] = [value] * 40
        np.testing.assert_equal(ros.scan(wide, laser, math.inf)[90], np.float32(wanted))


@pytest.mark.parametrize("shift", [-0.9, -0.6, -0.4, 0.3, 0.7, 0.9])
def test_a_fan_that_is_off_by_part_of_a_beam_is_read_at_its_true_angles(shift):
    laser = LaserSettings(beams=2161)  # 0.125 deg apart
    step, beams = laser.fov / (laser.beams - 1), np.arange(laser.beams)
    ranges = 1.0 + beams / 1000
    angles = {"angle_min": shift * step - 0.5 * laser.fov, "angle_increment": step}
    message = of_a_circle(360) | angles | {"ranges": ranges.tolist()}
    nearest = np.clip(beams - round(shift), 0, laser.beams - 1)
    found = ros.scan(message, laser, math.inf)
    np.testing.assert_array_equal(found, ranges[nearest].astype(np.float32))


def test_two_lasers_have_topics_and_mounts_of_their_own(bridge):
    rear = LaserSettings(x=-0.1, yaw=math.pi, beams=91, fov=math.pi)
    sensors = dataclasses.replace(SENSORS, more_lasers=(rear,))
    senses = RosSensors(RosSettings(more_scans=("/scan_rear",)), sensors, False)
    scan = bridge._messages()["/scan"]()
    senses.receive("/scan", scan, 1.0)
    senses.receive("/ARDUINO1/Odom", bridge._messages()["/ARDUINO1/Odom"](), 1.0)
    assert "/scan_rear is silent" in senses.stale(1.0)
    senses.receive("/scan_rear", of_a_circle(360), 1.0)
    assert senses.stale(1.0) == ""
    laser, *_ = senses.ranges(1.0)
    assert laser.shape == (181 + 91,)
    assert (laser[181:] == np.where(np.abs(rear.angles - math.pi / 2) < 0.3, 1.0, 2.0)).mean() > 0.9
    senses.receive("/tf_static", {"transforms": [
        bridge._edge("base_link", "laser_link", bridge.mounted),
        bridge._edge("base_link", "laser", (0.4, 0.0, 0.0)),
    ]}, 1.0)  # fmt: skip
    assert "sensors.more_lasers[0] says (-0.10, 0.00) m" in senses.laser_mount_error()
    assert "/scan is silent" in senses.stale(1.0)
    senses.receive("/scan", later(scan), 2.0)
    senses.receive("/scan_rear", later(of_a_circle(360)), 2.0)
    assert "/scan_rear is silent (its last message is of frame laser: " in senses.stale(2.0)


def test_a_topic_that_is_new_while_others_are_looked_at(bridge, monkeypatch):
    sensors = dataclasses.replace(SENSORS, more_lasers=(LaserSettings(beams=91, fov=math.pi),))
    senses = RosSensors(RosSettings(more_scans=("/scan_rear",)), sensors, False)

    class Busy(dict):
        def __contains__(self, topic):
            senses.receive("/scan_rear", of_a_circle(360), 1.0)
            return False

    def mount(topic, frame):
        return "" if topic == "/scan_rear" else str(topic in Busy() or ""), False

    for look in (senses.laser_mount_error, senses.clear):
        senses._frames, senses._clocks = {}, {}
        senses.receive("/scan", bridge._messages()["/scan"](), 1.0)
        monkeypatch.setattr(senses, "_mount", mount)
        senses._wrong = Busy()
        assert not look()


def later(message, seconds=1):
    """The same message, made so much later."""
    header = message["header"]
    stamp = dict(header["stamp"])
    stamp["secs" if "secs" in stamp else "sec"] += seconds
    return message | {"header": header | {"stamp": stamp}}


@pytest.mark.parametrize("roll", [0.0, math.pi, 0.4])
def test_a_laser_upside_down_is_read_as_an_upright_one_and_a_tilted_one_is_refused(bridge, roll):
    senses, scan = RosSensors(RosSettings(), SENSORS, False), bridge._messages()["/scan"]()
    senses.receive("/scan", scan, 1.0)
    upright = ros.scan(scan, SENSORS.laser, math.inf)
    edge = bridge._edge("base_link", "laser_link", bridge.mounted)
    rotation = edge["transform"]["rotation"]
    assert rotation["z"] == 0.0
    rotation |= {"x": math.sin(0.5 * roll), "w": math.cos(0.5 * roll)}
    senses.receive("/tf_static", {"transforms": [edge]}, 1.0)
    hanging = scan | {"ranges": scan["ranges"][::-1]} if roll == math.pi else scan
    senses.receive("/scan", later(hanging), 2.0)
    if roll == 0.4:
        assert "tilted by 23 deg" in senses.stale(2.0)
        assert "tilted by 23 deg" in senses.laser_mount_error()
        return
    assert senses.laser_mount_error() == ""
    np.testing.assert_array_equal(senses._newest["/scan"].value, upright)


def test_the_preset_of_ros_2():
    chair = chair_settings("ros2://robot:9091")
    assert (chair.host, chair.port, chair.odometry, chair.velocity) == (
        "robot", 9091, "/odom", "/cmd_vel"
    )  # fmt: skip
    assert chair_settings({"name": "ros2", "stamped": True, "odometry": "/o"}).odometry == "/o"


@pytest.mark.realtime
@pytest.mark.parametrize("stamped", long_but([False, True], [True]))
def test_it_drives_the_robot_that_this_package_serves(stamped):
    """Both ends of rosbridge are ours; the shield is that of the chair's environment."""
    with closing(
        Served("--scene", "empty", "--shield", "off", "--rate", "20", "--scan-rate", "20")
    ) as served:
        port = int(served.url.rpartition(":")[2])
        chair = {"name": "ros2", "host": "127.0.0.1", "port": port, "limits": CALM}
        chair["stamped"] = stamped
        config = {"sensors": {"laser": {"beams": 541}}, "task": {"beams": 541}}
        env = NavigationEnv(chair=chair, config=config, pose_source="modelled", split="test")
        assert until(env.chair.senses.map_pose)
        episode = env.chair.episode(env.chair.senses.map_pose().value[:2])
        env.reset(options={"episode": dataclasses.replace(episode, tolerance=1e-9)})
        begin = env.reading.pose

        def turned():
            env.step(np.array([0.0, 0.6], np.float32))
            return abs(env.reading.pose[2] - begin[2]) > 0.2

        assert until(turned)
        assert env.reading.halted == ""
        env.close()
        assert until(lambda: served.errors)  # it left, and the robot says that it stands
