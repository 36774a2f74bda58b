"""Laws of recordings: any reader opens them; replayed, they are judged the same to the bit."""

import errno
import json
import resource
from operator import itemgetter
from pathlib import Path
from typing import get_args, get_type_hints

import gymnasium as gym
import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from agents.cli import main
from agents.policies import GymPolicy, make_policy
from tests.conftest import ROOT, at_start, refusal
from tests.copies import same_fields
from tests.envs.test_gymnasium import IDS
from wheelchair_gym import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.planar import compose
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.recording.read_bags import mcap_messages
from wheelchair_gym.recording.record import RecordEpisodes, RecordingSettings
from wheelchair_gym.recording.replay import read_recording, replay_env, sensor_log
from wheelchair_gym.recording.sink import McapFile
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.types import Belief

OLD = Path(__file__).parent / "data" / "first.mcap"  # as the first release wrote it
NAMES = [name for name in IDS if "driver" not in gym.spec(name).kwargs]  # people below
SOURCES = get_args(get_type_hints(SensorSettings)["pose_source"])
# Every variant with every pose source, each once at least.
KINDS = [(NAMES[k % len(NAMES)], source) for k, source in enumerate(SOURCES)]
KINDS += [(name, SOURCES[k]) for k, name in enumerate(NAMES[1:])]
KINDS += [("wheelchair_gym/AssistedNavigation-v1", "modelled")]
STEPS = 25
POLICY = "visibility+window"


@pytest.fixture(scope="module", params=KINDS, ids=lambda kind: "-".join(kind).split("/")[1])
def run(request, tmp_path_factory):
    """A recording of two episodes, and what the environment handed out."""
    name, pose_source = request.param
    file = tmp_path_factory.mktemp("runs") / f"{name.partition('/')[2]}-{pose_source}.mcap"
    env = gym.make(name, pose_source=pose_source, render_mode="rgb_array", shield=True)
    env = RecordEpisodes(env, file, recording=RecordingSettings(image_rate=2.0))
    policy = GymPolicy(make_policy(POLICY), env)
    seen = []
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        policy.reset()
        chapter = [(observation, None, None)]
        for _ in range(STEPS):
            action = policy.act(observation)
            observation, reward, _, _, info = env.step(action)
            chapter.append((observation, reward, info))
        seen.append(chapter)
    env.close()
    return file, seen


def test_a_replayed_run_is_seen_and_judged_the_same(run):
    file, seen = run
    chapters = read_recording(file)
    assert len(chapters) == len(seen)
    for chapter, (first, *steps) in zip(chapters, seen, strict=True):
        assert len(chapter.actions) == len(steps) == STEPS
        assert chapter.split == steps[0][2]["split"] == "train"
        env = replay_env(chapter)
        observation, _ = env.reset(options={"episode": chapter.episode})
        assert same_fields(observation, first[0])
        for action, verdict, (was, reward, told) in zip(
            chapter.actions, chapter.verdicts, steps, strict=True
        ):
            observation, again, _, _, info = env.step(action)
            assert same_fields(observation, was)
            assert again == reward == verdict["reward"]
            assert info["reward_terms"] == told["reward_terms"] == verdict["terms"]
            np.testing.assert_array_equal(info["pose"], told["pose"])
        with pytest.raises(ValueError, match="ends here"):
            env.step(action)
        for moment in chapter.states:  # kernels are compiled for arrays that can be written to
            arrays = [value for value in moment.reading if isinstance(value, np.ndarray)]
            assert len(arrays) >= 5
            assert all(array.flags.writeable for array in arrays)


def test_a_recording_holds_what_identification_needs(run):
    """Counts, duties, volts and commands of each period, and the time of each scan."""
    for chapter in read_recording(run[0]):
        rows = np.concatenate([each["reports"] for each in chapter.wheels])
        stamps = [state.reading.stamp for state in chapter.states]
        assert len(rows) == STEPS + 1
        assert np.allclose(rows["stamp"], stamps)
        assert [each["scans"].tolist() for each in chapter.wheels] == [[t] for t in stamps]
        travel = np.diff(rows["counts"], axis=0).mean(axis=1) / 4346.0
        twists = [state.reading.twist[0] for state in chapter.states[1:]]
        assert np.allclose(travel, np.array(twists) * np.diff(stamps), atol=1e-9)
        limits = chapter.settings.chair.limits
        assert (np.abs(rows["command"]) <= (limits.forward, limits.turn)).all()
        assert np.abs(rows["command"]).max() > 0.05
        assert (rows["voltage"] > 30.0).all()
        assert np.abs(rows["duties"]).max() > 0.01


OTHERS = {  # settings of an environment, and how many episodes
    "some without a shield": (6, {"shield": True, "config": {
        "unshielded": 0.5, "task": {"shield_state": True, "reward": {"shield_intervention": -0.3}},
    }}),
    "three scanners": (1, {"config": str(ROOT / "examples" / "own_robot.json")}),
    "ways of the outline": (
        1, {"scene": "clutter", "guidance": "poses", "config": {"task": {"aim": "time"}}}
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_runs_with_other_settings_are_seen_and_judged_the_same(name, tmp_path):
    count, settings = OTHERS[name]
    env = RecordEpisodes(gym.make(KINDS[0][0], **settings), tmp_path / "run.mcap")
    seen, lasers = [], env.unwrapped.settings.sensors.lasers
    for seed in range(count):
        first, _ = env.reset(seed=seed)
        steps = [env.step(np.array([1.0, 0.05 * k]))[:2] for k in range(15)]
        seen.append((first, steps, env.unwrapped.task.is_shielded))
    env.close()
    chapters = read_recording(tmp_path / "run.mcap")
    for chapter, (first, steps, shielded) in zip(chapters, seen, strict=True):
        env = replay_env(chapter)
        assert same_fields(env.reset(options={"episode": chapter.episode})[0], first)
        for action, (observation, reward) in zip(chapter.actions, steps, strict=True):
            again, worth, *_ = env.step(action)
            assert same_fields(again, observation)
            assert worth == reward
        assert env.task.is_shielded == shielded
    assert len({shielded for *_, shielded in seen}) == (2 if count > 1 else 1)
    scans = ["/scan", *(f"/scan_{k}" for k in range(1, len(lasers)))]
    topics = {topic for topic, _, _ in told(tmp_path / "run.mcap", *scans, f"/scan_{len(lasers)}")}
    assert topics == set(scans)
    log, laser = sensor_log(tmp_path / "run.mcap")
    assert laser == lasers[0]
    assert log.ranges.shape == (16, laser.beams)  # of an episode


def test_every_reader_opens_it(run):
    """Check sums hold, messages are as their schemas say, in the order of time; none is missing."""
    file, seen = run
    counts: dict[str, int] = {}
    schemas, times, validators = {}, [], {}
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_summary() is not None
        for schema, channel, message in reader.iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            schemas[channel.topic] = schema.name
            times.append(message.log_time)
            if channel.message_encoding == "json":
                validators.setdefault(schema.id, Draft202012Validator(json.loads(schema.data)))
                validators[schema.id].validate(json.loads(message.data))
    steps = len(seen) * (STEPS + 1)
    for topic in ("/scan", "/tf", "/pose", "/ultrasonic", "/odometry", "/battery", "/reading"):
        assert counts[topic] == steps, topic
    assert counts["/episode"] == len(seen)
    for topic in ("/map", "/goal", "/tf_static", "/footprint"):  # again with a map that grows
        assert (counts[topic] > len(seen)) == file.stem.endswith("slam"), topic
    assert counts["/command"] == counts["/shield"] == counts["/verdict"] == len(seen) * STEPS
    assert counts["/trail"] == len(seen) * (STEPS // 10 + 1)
    assert counts["/image"] == len(seen) * (STEPS // 5 + 1)
    assert counts["/path"] >= len(seen)
    assert counts["/note"] >= len(seen)
    assert counts.get("/lookahead", 0) == (steps if "Guided" in file.stem else 0)
    assert schemas["/scan"] == "foxglove.LaserScan"
    assert schemas["/tf"] == "foxglove.FrameTransforms"
    assert schemas["/map"] == "foxglove.Grid"
    assert times == sorted(times)


def told(file, *topics):
    """Messages as another reader decodes them: topic, message."""
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics):
            yield channel.topic, message.log_time, decoded


def test_the_tree_leads_from_the_map_to_the_sensors(run):
    """The tree map -> odom -> base_link is the believed pose."""
    file, seen = run
    poses = [info["pose_estimate"] for _, *steps in seen for *_, info in steps]
    chains, rigid = [], {}
    for topic, _, message in told(file, "/tf", "/tf_static"):
        edges = {
            t.child_frame_id: (
                t.parent_frame_id,
                (t.translation.x, t.translation.y, 2.0 * np.arctan2(t.rotation.z, t.rotation.w)),
            )
            for t in message.transforms
        }  # fmt: skip
        if topic == "/tf":
            assert (edges["odom"][0], edges["base_link"][0]) == ("map", "odom")
            chains.append((edges["odom"][1], edges["base_link"][1]))
        else:
            rigid |= edges
    per = STEPS + 1
    believed = [compose(*chain) for k, chain in enumerate(chains) if k % per]
    np.testing.assert_allclose(believed, poses, atol=1e-9)
    sensors = SensorSettings()
    mounted = {"laser": sensors.laser}
    mounted |= {f"ultrasonic_{k}": one for k, one in enumerate(sensors.ultrasonic.mounted)}
    for name, one in mounted.items():
        parent, place = rigid[name]
        assert parent == "base_link"
        np.testing.assert_allclose(place, (one.x, one.y, one.yaw), atol=1e-9)
    corrections = np.array([chain[0] for chain in chains])
    if file.stem.endswith(("truth", "odometry")):
        np.testing.assert_allclose(corrections, 0.0, atol=1e-9)
    else:
        assert np.abs(corrections).max() > 1e-4


def test_viewers_see_what_the_chair_was_told(run):
    """Cones as long as the ranges, particles round the pose, an outline, the voltage."""
    file, _ = run
    messages = {}
    for topic, _, message in told(file, "/ultrasonic", "/particles", "/footprint", "/odometry"):
        messages.setdefault(topic, []).append(message)
    moments = [moment for chapter in read_recording(file) for moment in chapter.states]
    rangers = SensorSettings().ultrasonic
    for update, moment in zip(messages["/ultrasonic"], moments, strict=True):
        assert len(update.entities) == len(rangers.mounted)
        for entity, value, one in zip(
            update.entities, moment.reading.ultrasonic, rangers.mounted, strict=True
        ):
            model = rangers.narrow if one.model == "narrow" else rangers.wide
            points = [(p.x, p.y) for fan in entity.triangles for p in fan.points]
            longest = np.hypot(*np.array(points).T).max() if points else 0.0
            assert longest == pytest.approx(min(value, model.reach) if value > 0 else 0.0)
    clouds = messages.get("/particles", [])
    finds = "mcl" in file.stem or "slam" in file.stem
    assert len(clouds) == (len(moments) if finds else 0)
    for cloud, moment in zip(clouds, moments, strict=False):
        places = np.frombuffer(cloud.data, "<f4").reshape(-1, cloud.point_stride // 4)
        np.testing.assert_array_equal(places, moment.belief.particles)
        assert np.hypot(*(places[:, :2] - moment.reading.pose[:2]).T).min() < 0.3
    corners = messages["/footprint"][0].entities[0].lines[0].points
    assert len(corners) == 4


class Surveyor(SimulatedChair):
    """A chair that maps as it goes: cells become known one by one."""

    built_maps = 0

    @property
    def belief(self):
        def built_map():
            self.built_maps += 1
            cells = np.full((4, 5), -1)
            cells.flat[: self.built_maps] = 0
            return OccupancyGrid(cells, 0.5, (1.0, 2.0, 0.3))

        return Belief(super().belief.odometry, np.ones((3, 3)), built_map)


def test_a_map_that_grows_is_sent_again_slowly_and_kept(tmp_path, monkeypatch):
    chair, file = Surveyor(), tmp_path / "grows.mcap"
    monkeypatch.setattr("wheelchair_gym.recording.record.REFRESH_PERIOD", 0.5)
    env = at_start(RecordEpisodes(NavigationEnv("empty", chair=chair), file))
    for _ in range(20):
        env.step(np.zeros(2, np.float32))
    env.close()
    maps = [(stamp, np.frombuffer(m.data, np.int8)) for _, stamp, m in told(file, "/map")]
    assert chair.built_maps == 5  # at 0.0, 0.5, ... 2.0 s
    assert [int((cells == 0).sum()) for _, cells in maps[1:]] == [1, 2, 3, 4, 5]
    np.testing.assert_array_equal(np.diff([stamp for stamp, _ in maps[1:]]), 500_000_000)
    (chapter,) = read_recording(file)
    for k, moment in enumerate(chapter.states):
        grid = moment.belief.built_map()
        assert (grid.cells == 0).sum() == k // 5 + 1
        assert grid.origin == (1.0, 2.0, 0.3)
    assert (chapter.episode.map.cells != -1).any()


def test_the_command_records_and_replays(tmp_path, capsys):
    file, picture = tmp_path / "a.mcap", tmp_path / "a.png"
    drive = ["simulate", "--scene", "empty", "--policy", "straight", "--record", str(file)]
    assert main(drive) == 0
    assert main(["replay", str(file), "--policy", "straight", "--picture", str(picture)]) == 0
    said = capsys.readouterr().out.splitlines()[-1]
    assert "the same rewards" in said
    assert said.endswith("difference of straight's action: 0.000")
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_a_recording_of_another_release_is_refused(capsys):
    """The first release wrote no size of actors; the line says what to do."""
    told = refusal(["replay", OLD], capsys)
    assert "another release wrote it (actor_size is None, expected" in told
    assert "read it with that one" in told


@pytest.mark.parametrize("damage", ["flipped", "empty", "text", "missing", "other"])
def test_what_is_no_recording_is_one_line(run, damage, tmp_path, capsys):
    file = tmp_path / "b.mcap"
    broken = bytearray(run[0].read_bytes())
    broken[len(broken) // 3] ^= 0xFF
    damaged = {"flipped": broken, "empty": b"", "text": b"no recording at all\n" * 50}
    if damage in damaged:
        file.write_bytes(damaged[damage])
    elif damage == "other":
        from mcap.writer import Writer

        with file.open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            writer.finish()
    assert "b.mcap" in refusal(["replay", file], capsys)


def recorded(file):
    """An environment without things that is recorded to a file."""
    return RecordEpisodes(gym.make("wheelchair_gym/Navigation-v1", scene="empty"), file)


def driven(env, steps):
    """Rewards of an episode of turning on the spot, nearly."""
    env.reset(seed=1)
    return [env.step(np.array([0.05, 0.3], np.float32))[1] for _ in range(steps)]


class SmallDisk:
    """A file on a disk with so much room; it takes what still fits, as disks do."""

    def __init__(self, file, room):
        self._file, self._room = file, room

    def __getattr__(self, name):
        return getattr(self._file, name)

    def write(self, data):
        left = self._room - self._file.tell()
        if left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._file.write(data[:left])


@pytest.mark.parametrize("room", [300, 300_000, 500_001, 650_000, 700_003])
@pytest.mark.parametrize("kind", ["disk", "limit"])
def test_a_full_disk_ends_the_recording_and_not_the_run(room, kind, tmp_path, monkeypatch, caplog):
    """One line says so; the file is whole up to there. The limit is the kernel's, of any file."""
    file, limits = tmp_path / "run.mcap", resource.getrlimit(resource.RLIMIT_FSIZE)
    env = recorded(file)
    if kind == "disk":
        disk = env._out._output
        monkeypatch.setattr(disk, "_file", SmallDisk(disk._file, room))
    else:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        rewards = driven(env, 80)
        env.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(rewards) == 80
    (line,) = [record.message for record in caplog.records]
    assert "run.mcap: " in line
    assert "the recording ends here" in line
    assert file.stat().st_size <= room
    if room < 300_000:  # nothing that was driven is in it
        with pytest.raises(InputError, match=r"run\.mcap"):
            read_recording(file)
        return
    (chapter,) = read_recording(file)
    assert 3 < len(chapter.verdicts) < 80
    for verdict, reward in zip(chapter.verdicts, rewards, strict=False):
        assert verdict["reward"] == reward
    with file.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert {"/scan", "/reading", "/map"} <= topics


def test_a_full_disk_ends_the_run_where_that_is_wanted(tmp_path, monkeypatch, capsys):
    def small(path):
        made = McapFile(path)
        made._file = SmallDisk(made._file, 200_000)
        return made

    monkeypatch.setattr("wheelchair_gym.recording.sink.McapFile", small)
    file = tmp_path / "run.mcap"
    words = ["simulate", "--scene", "empty", "--policy", "straight", "--record", str(file)]
    assert refusal([*words, "--when-full", "end"], capsys) == (
        f"wheelchair: {file}: No space left on device; the recording ends here, and the run, too"
    )
    assert len(read_recording(file)[0].verdicts) > 3


def test_a_recording_never_replaces_another(tmp_path, caplog):
    names = []
    for steps in (3, 4, 5):
        env = recorded(tmp_path / "a.mcap")
        driven(env, steps)
        env.close()
        names.append(env.file.name)
    assert names == ["a.mcap", "a-1.mcap", "a-2.mcap"]
    assert "a.mcap exists; the recording is " in caplog.text
    assert "a-2.mcap" in caplog.text
    assert [len(read_recording(tmp_path / name)[0].verdicts) for name in names] == [3, 4, 5]


def test_a_run_that_an_error_ends_is_readable(tmp_path):
    file = tmp_path / "run.mcap"
    env = recorded(file)
    driven(env, 5)
    env._log_reading = lambda: 1 / 0
    with pytest.raises(ZeroDivisionError):
        env.step(np.zeros(2, np.float32))
    env.close()
    assert len(read_recording(file)[0].verdicts) == 5


def test_a_run_that_is_killed_is_readable_up_to_its_last_second(tmp_path):
    """Nothing is closed; the last messages are in memory alone."""
    file, copy = tmp_path / "run.mcap", tmp_path / "copy.mcap"
    env = recorded(file)
    rewards = driven(env, 60)
    copy.write_bytes(file.read_bytes())
    env.close()
    (chapter,) = read_recording(copy)
    assert 60 - 25 < len(chapter.verdicts) < 60
    assert [v["reward"] for v in chapter.verdicts] == rewards[: len(chapter.verdicts)]
    assert len(read_recording(file)[0].verdicts) == 60


def test_what_was_driven_is_recorded_whatever_wrappers_change(tmp_path):
    """With actions and rewards of any finite size; /command tells the assistant's twist, too."""
    inner = NavigationEnv(
        "clutter", driver="expert", assistant="shared_dwa",
        reward=lambda verdict, sensed, action: 1e12 + action[1],
    )  # fmt: skip
    scaled = gym.wrappers.RescaleAction(inner, np.float32(-2.0), np.float32(2.0))
    negated = gym.wrappers.TransformReward(scaled, lambda reward: -reward)
    env = at_start(RecordEpisodes(negated, tmp_path / "run.mcap"))
    rewards, twists, given = [], [], [*[0.0] * 25, 0.5, -1.0, 1e9]
    for turn in given:
        rewards.append(-env.step(np.array([0.0, 2.0 * turn]))[1])
        twists.append(inner.task.limits.twist_of(*inner.task.action))
    env.close()
    (chapter,) = read_recording(tmp_path / "run.mcap")
    assert [action.tolist() for action in chapter.actions] == [[0.0, turn] for turn in given]
    assert [verdict["reward"] for verdict in chapter.verdicts] == rewards
    assert rewards == [1e12 + turn for turn in given]
    told = mcap_messages(tmp_path / "run.mcap", lambda topic, _: topic == "/command")
    assert [itemgetter("v", "w")(json.loads(one.data)) for one in told] == twists
    assert max(v for v, _ in twists) > 0.05  # of the assistant


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        RecordEpisodes(gym.make("wheelchair_gym/Navigation-v1"), tmp_path)


def test_movers_are_recorded_and_replayed_where_they_were(tmp_path):
    """Doors, people and what comes and goes; the picture of a replay is that of the run."""
    scene = {"name": "crowd", "people": {"density": (0.06, 0.08)}, "furniture_density": 0.05}
    env = RecordEpisodes(
        gym.make("wheelchair_gym/Navigation-v1", scene=scene, render_mode="rgb_array"),
        tmp_path / "run.mcap",
    )
    env.reset(seed=2)
    seen = []
    for _ in range(5):
        env.step(np.zeros(2, np.float32))
        seen.append(env.unwrapped.chair.truth.actor_poses)
    picture, actors = env.render(), env.unwrapped.episode.actors
    env.close()
    (chapter,) = read_recording(tmp_path / "run.mcap")
    assert same_fields(chapter.episode.actors.rows, actors.rows)
    np.testing.assert_array_equal(chapter.episode.actors.routes, actors.routes)
    again = at_start(replay_env(chapter, "rgb_array"), None, options={"episode": chapter.episode})
    for action, poses in zip(chapter.actions, seen, strict=True):
        again.step(action)
        np.testing.assert_array_equal(again.chair.truth.actor_poses, poses)
    assert len(seen[-1]) >= 3
    np.testing.assert_array_equal(again.render(), picture)
    assert len(list(told(tmp_path / "run.mcap", "/actors"))) == 6
