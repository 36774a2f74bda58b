"""Every reader of files, valid files for each, and mutations of them that may never do harm.

A reader either reads a file or says in one line what is wrong with it (`InputError`). Each input is
a pure function of the reader's name and a number. A worker process, limited in memory, reads
inputs; who started it notices when it hangs or dies. `python -m tests.fuzz FIRST LAST` prints what
became of these inputs of every reader.
"""

import contextlib
import hashlib
import io
import json
import os
import re
import resource
import select
import shutil
import subprocess
import sys
import tempfile
import traceback
import zipfile
import zlib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from agents.benchmarks import tracks
from agents.benchmarks.entrants import stored_cases
from agents.benchmarks.planner_benchmark import FORMAT, check_result
from agents.cli.arguments import spec
from agents.evaluation.evaluate import env_settings as checked
from agents.evaluation.map_evaluation import by_odometry
from agents.evaluation.runs import compute, stored_line
from agents.learning import folder as runs_folder
from agents.learning.export import export_onnx
from agents.learning.settings import read_training
from agents.learning.weights import _digest, save_weights
from agents.people.folder import Chain, current_protocol, read_chain
from agents.people.protocol import Protocol
from agents.policies import make_policy
from agents.policies.sb3 import _algorithm
from agents.studies.plan_pictures import problem_of
from agents.studio.plan_session import loaded
from planners import PLANNERS, Problem, Space, make_planner
from planners.problem_files import read_problems
from planners.rrt_star_woa.thesis import read_thesis
from tests.agents.learning.tiny_runs import random_weights
from tests.conftest import ROOT, put
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.files import read_json
from wheelchair_gym.base.settings import dump, read
from wheelchair_gym.envs.settings import EnvSettings, env_settings
from wheelchair_gym.hardware.ros.make_messages import typestore
from wheelchair_gym.hardware.twin.plant import PlantSettings
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid, read_any_map, write_map
from wheelchair_gym.perception.logs import LASER, read_log
from wheelchair_gym.perception.slam import SlamSettings
from wheelchair_gym.recording.read_bags import bag_messages
from wheelchair_gym.recording.record import RecordEpisodes, RecordingSettings
from wheelchair_gym.recording.replay import read_recording, replay_env, sensor_log
from wheelchair_gym.scenes import SCENES, make_scene
from wheelchair_gym.scenes.barn import world_numbers
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings

TIMEOUT = 120.0  # s for one input, where a machine is busy
READY = 300.0  # s until a worker has read its valid file: kernels may be compiled
MEMORY = 3 * 2**30  # bytes that a worker may have beside what it has when ready
LONGEST = 2000  # characters of a message
SCENE_NAMES = ("empty", "clutter", "grey_wolf", "mixture", "doorway", "thesis_3")


class Reader(NamedTuple):
    """Functions that make, mutate and read a kind of file."""

    make: Callable[[Path], Path]  # writes a valid file into a folder
    read: Callable[[Path], Any]  # reads it, and uses what was read
    covers: tuple[str, ...]  # functions of the project that open files and are exercised so
    mutate: Callable[[bytes, np.random.Generator], bytes] | None = None  # None: `mutated`


# Values that numbers and words are replaced by.
EXTREMES = (
    "0", "-1", "1", "0.5", "-0.0", "1e155", "-1e155", "1e308", "1e400", "-1e400", "NaN", "Infinity",
    "-Infinity", "5e-324", "2147483648", "9223372036854775807", "9223372036854775808", "-1e9",
    "18446744073709551616", "9" * 400, "9" * 4301, "1e5", "100001", "1e9", "1000000",
    "null", "true", "false", '""', "[]", "{}", "[[]]", '"\\u0000"', '"\\ud800"', '"nan"',
    '"../../../../../../dev/zero"', "[1, 2, 3]", '{"name": {}}', "[" * 90 + "]" * 90,
    "[" * 5000 + "]" * 5000, '{"a": ' * 500 + "1" + "}" * 500, '"' + "x" * 5000 + '"',
)  # fmt: skip
_TOKEN = re.compile(rb'-?[0-9][0-9.eE+-]*|"[^"\n]*"|\b[A-Za-z_]+\b')


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes with some bits flipped, cut out, doubled, put in, or cut off."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, len(out) + 1))
        size = int(2 ** rng.uniform(0, 8))
        match int(rng.integers(0, 6)):
            case 0 | 1 if out:
                out[min(at, len(out) - 1)] ^= 1 << int(rng.integers(0, 8))
            case 2:
                del out[at:]
            case 3:
                del out[at : at + size]
            case 4:
                out[at:at] = out[at : at + size]
            case _:
                out[at:at] = rng.bytes(min(size, 16))
    return bytes(out)


def retold(data: bytes, rng: np.random.Generator) -> bytes:
    """A text with one to three of its numbers, words or strings replaced by extremes."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        tokens = list(_TOKEN.finditer(data))
        if tokens:
            found = tokens[int(rng.integers(len(tokens)))]
            extreme = EXTREMES[int(rng.integers(len(EXTREMES)))].encode()
            data = data[: found.start()] + extreme + data[found.end() :]
    return data


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner: Any = value.items() if isinstance(value, dict) else ()
    inner = enumerate(value[:50]) if isinstance(value, list) else inner
    return [path, *(place for key, item in inner for place in _places(item, (*path, key)))]


def rebuilt(data: bytes, rng: np.random.Generator) -> bytes:
    """JSON with a value replaced, dropped, doubled, wrapped or nested, or a key put in."""
    try:
        value = json.loads(data)
    except ValueError:
        return retold(data, rng)
    places = _places(value)
    *above, last = ("root", *places[int(rng.integers(len(places)))])
    whole: Any = {"root": value}
    holder = whole
    for key in above:
        holder = holder[key]
    extreme = EXTREMES[int(rng.integers(len(EXTREMES)))]
    match int(rng.integers(0, 6)):
        case 0:
            holder[last] = f"%{extreme}%"
        case 1 if last != "root":
            del holder[last]
        case 2 if isinstance(holder, list):
            holder.extend([holder[last]] * int(rng.integers(1, 200)))
        case 3:
            holder[last] = [holder[last]]
        case 4 if isinstance(holder, dict) and last != "root":
            holder[f"{last}_"] = holder[last]
        case _:
            other = places[int(rng.integers(len(places)))]
            found = value
            for key in other:
                found = found[key]
            holder[last] = json.loads(json.dumps(found))
    text = json.dumps(whole["root"]) if "root" in whole else ""
    return re.sub(r'"%((?:[^"\\]|\\.)*)%"', lambda m: json.loads(f'"{m[1]}"'), text).encode(
        errors="replace"
    )


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """A mutation of any kind."""
    return (flipped, retold, rebuilt)[int(rng.integers(3))](data, rng)


def input_of(name: str, valid: bytes, number: int) -> bytes:
    """The mutation of a reader's valid file with a number."""
    rng = np.random.default_rng((zlib.crc32(name.encode()), number))
    return (READERS[name].mutate or mutated)(valid, rng)


def _shipped(name: str) -> Callable[[Path], Path]:
    """Return a function that copies a file of `configs/` into a folder."""
    return lambda folder: Path(shutil.copy(ROOT / "configs" / name, folder))


def _written(name: str, content: Any) -> Callable[[Path], Path]:
    """Return a function that puts a file of this content into a folder."""
    return lambda folder: put(folder / name, content)


# A chair that a twin hides from its computer.
BELIEVED = PlantSettings(ChairSettings(), SensorSettings(), PhysicsSettings())
HIDDEN = {
    "chair": {
        "drive": {"wheel_ratio": 1.02, "track": 0.55},
        "body": {"mass": 180.0},
        "motor": {"gain": 0.8, "resistance": 1.2},
        "randomization": [{"quantity": "laser.sigma", "low": 0.01, "high": 0.02}],
        "joint": {"quantities": ["laser.x_error"], "mean": [0.01], "covariance": [[1e-4]]},
    },
    "sensors": {"laser": {"offset": 0.03, "x": 0.6}},
    "physics": {"slope": 0.02, "downhill": 1.0},
}


def _use_map(path: Path) -> None:
    """A map as `plan` and an environment take it."""
    if path.suffix == ".yaml":
        loaded(path, 0.05)  # as it is loaded in the browser
    grid, _ = read_any_map(path)
    if grid.cells.size > 2_000_000:  # large and allowed: using it takes what it takes
        return
    scene = make_scene({"name": "map_file", "path": str(path)})
    episode = scene.sample(np.random.default_rng(0))
    problem = Problem(Space.from_grid(grid), episode.start, episode.goal, 0.36)
    make_planner({"name": "rrt_connect", "iterations": 200}).plan(problem, np.random.default_rng(0))


def _small_map(folder: Path, suffix: str = ".png") -> Path:
    cells = np.zeros((40, 60), np.int8)
    cells[:2] = cells[-2:] = OCCUPIED
    cells[:, :2] = cells[:, -2:] = cells[15:25, 20:30] = OCCUPIED
    write_map(OccupancyGrid(cells, 0.1), folder / "hall.yaml", suffix=suffix)
    return folder / "hall.yaml"


def _mutated_png(data: bytes, rng: np.random.Generator) -> bytes:
    """Half of the time a chunk's content is mutated and its checksum made right again."""
    if rng.random() < 0.4:
        return flipped(data, rng)
    at, chunks = 8, []
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    which = int(rng.integers(len(chunks)))
    kind, content = chunks[which]
    if kind == b"IHDR" and rng.random() < 0.7:
        sides = rng.choice([0, 1, 59, 1000, 20_000, 2**31 - 1, 2**32 - 1, 100_000], 2)
        head = b"".join(int(side).to_bytes(4, "big") for side in sides)
        content = head + bytes([int(rng.choice([1, 8, 16])), int(rng.choice([0, 2, 6])), 0, 0, 0])
    elif kind == b"IDAT" and rng.random() < 0.5:
        content = zlib.compress(bytes(int(rng.choice([10, 10**6, 10**8]))), 9)
    else:
        content = flipped(content, rng)
    chunks[which] = kind, content
    return data[:8] + b"".join(png_chunk(*chunk) for chunk in chunks)


def png_chunk(kind: bytes, content: bytes) -> bytes:
    """A chunk of a PNG, with its checksum."""
    check = zlib.crc32(kind + content).to_bytes(4, "big")
    return len(content).to_bytes(4, "big") + kind + content + check


YARD = ["." * 40] * 12 + ["." * 15 + "@T" * 5 + "." * 15] * 8 + ["." * 20 + "GS" * 10] * 10
OCTILE = "type octile\nheight 30\nwidth 40\nmap\n" + "\n".join(YARD) + "\n"
ROOM = {"bounds": [0, 0, 8, 6], "polygons": [[[3, 0], [3.2, 0], [3.2, 3.5]]], "name": "room"}
HOUSE = {
    "verts": [[0, 0], [8, 0], [8, 4], [5, 4], [4, 6.5], [0, 6]],
    "room_category": {"Kitchen": [[0, 0, 3, 3]], "Hall": []},
    "id": "abc",
}


def _sb3_model(folder: Path) -> Path:
    path = folder / "model.zip"
    data = {"policy_class": {"__module__": "stable_baselines3.sac.policies"}, "gamma": 0.99}
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("data", json.dumps(data))
        scale = {"epsilon": 1e-8, "clip": 10.0, "keys": {"goal": [[0.0, 1.0], [1.0, 2.0]]}}
        record = {"env": {"rate": 5.0}, "flat": False, "wrappers": ["VecNormalize"]}
        file.writestr("wheelchair.json", json.dumps(record | {"normalization": scale}))
    return path


BARN = [
    {"world": k, "start": [0, 0, 0.3], "goal": [5, 0], "reference_path_length": 5.5,
     "circles": [[1.5, y, 0.075], [3.0, -y, 0.2]]}
    for k, y in ((3, 1.5), (8, 2.0))
]  # fmt: skip
PROBLEM = {
    "name": "hall", "size": 5, "rects": [[2.0, 1.5, 3.0, 2.5], [0, 4, 1, 4.5]],
    "start": [1, 2], "goal": [4, 2], "optimum": 3.2361,
}  # fmt: skip
THESIS = (
    '{"ReturnOnFirstPath": true, "MapProcessor_Obstacles_Dilation": 4, '
    '"MapProcessor_Epsilon": 0.5, "MapProcessor_Map_Name": "5", '
    '"PathPlanner_Iterations": 300, "PathPlanner_Step_Size": 2.0, '
    '"PathOptimizer_Population": 10, "PathOptimizer_b_Parameter": 1,}'
)
ENV = dump(EnvSettings()) | {"scene": {"name": "empty", "size": [6.0, 5.0]}}
del ENV["hardware"]
PROTOCOL = {
    "title": "a", "consent": "b",
    "conditions": [{"name": "with help", "assist": {"name": "slide", "latency": 0.1}}],
    "tasks": [{"name": "home", "scene": "floor_plan", "seed": 1}],
}  # fmt: skip


def _use_barn(path: Path) -> None:
    for world in world_numbers(path)[:2]:
        scene = make_scene({"name": "barn", "path": str(path), "world": world})
        episode = scene.sample(np.random.default_rng(0))
        if episode.map.cells.size < 1_000_000:
            episode.map.traversable(0.36)


def _use_problems(path: Path) -> None:
    for problem, _ in read_problems(path)[:2]:
        for planner in ({"name": "rrt_connect", "iterations": 200}, {"name": "visibility"}):
            make_planner(planner).plan(problem, np.random.default_rng(0), deadline=1.0)
    stored_cases(path)


def _use_thesis(path: Path) -> None:
    file = read_thesis(path)
    make_planner(file.planner())
    problem_of(file)
    make_planner(spec(f"{path}:rrt_star"))


def _use_env(path: Path) -> None:
    """Settings, and the world that they name; stepping is for who chose the settings."""
    checked(config=path)
    own = env_settings(path)
    if own.scene != "crowd":
        make_scene(own.scene).sample(np.random.default_rng(0))


def _use_each(path: Path, names: Iterable[str], use: Callable[[Any], Any]) -> None:
    """Use the settings of each name in a file; raise the last refusal."""
    refused = None
    for name in names:
        try:
            use(spec(f"{path}:{name}"))
        except InputError as error:
            refused = error
    if refused is not None:
        raise refused


def _amendment(folder: Path) -> Path:
    put(folder / "protocol.json", PROTOCOL)
    return put(folder / "amendment_001.json", {"at": "", "changed": [], "protocol": PROTOCOL})


def _chain(folder: Path) -> Path:
    chain = Chain(folder / "steps.jsonl")
    for text in ("a", "b"):
        chain.append("note", text=text)
    chain.close()
    return chain.path


RECORD = {"key": "abc", "planner": "rrt", "seed": 0, "curve": [[0.1, 3.0]]}
COMPARISON = {
    "command": "wheelchair compare --policies mine.npz --out x", "title": "homes",
    "provenance": {"commit": "abc"},
    "summary": [
        {"policy": "mine.npz", "scene": "all"} | dict.fromkeys(runs_folder.RESULT_KEYS, 0.5)
    ],
}  # fmt: skip


def _entry(folder: Path) -> Path:
    one = dict.fromkeys(tracks.FIGURES, 0) | {"scene": "crowd", "seed": 0, "success": False}
    episodes = [one | {"clearance_min": 0.1, "plan_ms": 1.0, "act_ms_p50": 1.0}]
    result = dict.fromkeys(tracks.NEEDED - {"digest"}, "")
    result |= {"benchmark": tracks.VERSION, "machine": {"cpu": ""}, "episodes": episodes}
    result |= tracks.summary(episodes)
    return put(folder / "people.json", result | {"digest": tracks._digest(result)})


def _use_comparison(path: Path) -> None:
    from agents.studio.session import CompareSession

    with contextlib.suppress(InputError):  # which the card's minimal results are for it
        CompareSession._results(SimpleNamespace(_runs={"mine": path}), "mine")
    runs_folder._results(path, {"mine.npz": "0"}, "mine")


def _curve(folder: Path) -> Path:
    rows = [{"frames": k * 100, "success": 0.1 * k, "eval_success": 0.5} for k in range(5)]
    runs_folder.write_curve(folder, rows)
    return folder / "curve.csv"


def _work(job: int) -> dict[str, Any]:
    return {"outcome": "success", "time": 3.5 + job, "names": ["a", None]}


JOBS = {f"{k}": k for k in range(6)}
STORE = "".join(stored_line(key, _work(job)) for key, job in JOBS.items())


def _use_store(path: Path) -> None:
    """The resume never stops, and what is stored is what was computed or is computed again."""
    with contextlib.redirect_stderr(io.StringIO()):
        found = compute(JOBS, _work, path, progress=False)
    assert found == {key: _work(job) for key, job in JOBS.items()}


def _log(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    lines = []
    for k in range(6):
        head = [k * 100_000, 0, k * 20, k * 21, *([0] * 20)]
        ranges = rng.integers(100, 5000, LASER.beams).tolist()
        lines.append(" ".join(map(str, head + ranges)))
    return put(folder / "log.dat", "\n".join(lines) + "\n")


def _recording(folder: Path, format: Any = "foxglove") -> Path:
    import gymnasium as gym

    config = {"sensors": {"laser": {"beams": 31}}, "task": {"beams": 16}, "shield": {}}
    scene = {"name": "empty", "size": [5.0, 4.0]}
    env: Any = gym.make(
        "wheelchair_gym/Navigation-v1", scene=scene, config=config, guidance="geodesic"
    )
    settings = RecordingSettings(format=format)
    env = RecordEpisodes(env, folder / "run.mcap", recording=settings)
    env.reset(seed=1)
    for _ in range(4):
        env.step(np.array([0.5, 0.2]))
    env.close()
    return Path(env.file)


def _mutated_mcap(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes of the file, or, in most inputs, messages in a file that is whole again."""
    if rng.random() < 0.3:
        return flipped(data, rng)
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer

    out, reader = io.BytesIO(), make_reader(io.BytesIO(data))
    is_bag = reader.get_header().profile == "ros2"
    kinds = list(CompressionType)
    writer = Writer(out, compression=kinds[int(rng.integers(len(kinds)))])
    writer.start(profile="ros2" if is_bag else "")
    topics = None if is_bag else ("/episode", "/reading", "/command", "/verdict")
    messages = list(reader.iter_messages(topics))
    which = set(rng.integers(0, len(messages), int(rng.integers(1, 9 if is_bag else 3))).tolist())
    ids: dict[int, int] = {}
    for k, (schema, channel, message) in enumerate(messages):
        if channel.id not in ids:
            of = writer.register_schema(schema.name, schema.encoding, schema.data)
            ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, of)
        body = message.data
        if k in which:
            body = (flipped if is_bag else rebuilt)(body, rng)
        writer.add_message(ids[channel.id], message.log_time, body, message.publish_time)
    writer.finish()
    return out.getvalue()


def _use_recording(path: Path) -> None:
    for chapter in read_recording(path)[:2]:
        env = replay_env(chapter)
        env.reset(options={"episode": chapter.episode})
        for action in chapter.actions[:6]:
            env.step(action)
        env.close()
    sensor_log(path)


_bag = partial(_recording, format="ros2")


def _use_bag(path: Path) -> None:
    sensor_log(path)
    _use_recording(path)


def _sqlite_bag(folder: Path) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer

    path = folder / "old"
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        topics: dict[str, Any] = {}
        for one in bag_messages(_bag(folder), lambda *_: True):
            if one.topic not in topics:
                topics[one.topic] = bag.add_connection(one.topic, one.type, typestore=typestore())
            bag.write(topics[one.topic], one.time, one.data)
    return path / "old.db3"


def _weights(folder: Path) -> Path:
    save_weights(folder / "mine.npz", random_weights())
    return folder / "mine.npz"


def _mutated_weights(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes of the file; in most inputs its arrays or its card, with a digest that is right."""
    if rng.random() < 0.3:
        return flipped(data, rng)
    with np.load(io.BytesIO(data)) as file:
        arrays = {name: file[name] for name in file.files}
    card = arrays.pop("card").tobytes()
    arrays.pop("digest")
    if rng.random() < 0.5:
        card = rebuilt(card, rng)
    else:
        name = list(arrays)[int(rng.integers(len(arrays)))]
        array = arrays[name]
        match int(rng.integers(0, 8)):
            case 0:
                del arrays[name]
            case 1:
                arrays[name] = array[..., :-1]
            case 2:
                arrays[name] = array.T if array.ndim == 2 else array[:, None]
            case 3:
                arrays[name] = array.astype(str(rng.choice(["f8", "i8", "S8", "c8", "f2", "?"])))
            case 4:
                arrays[name] = np.zeros((0, 0), np.float32)
            case 5:
                arrays[name] = np.full_like(array, rng.choice([np.nan, np.inf, 3e38]))
            case 6:
                arrays[f"dense{int(rng.integers(3, 9))}.w"] = array
            case _:
                arrays[name] = np.float32(3.0) * np.ones(())
    extra = {"card": card, "digest": _digest(arrays, card.decode()).encode()}
    out = io.BytesIO()
    save = np.savez_compressed if rng.random() < 0.5 else np.savez
    save(out, **arrays, **{key: np.frombuffer(text, np.uint8) for key, text in extra.items()})
    return out.getvalue()


def _use_weights(path: Path) -> None:
    policy: Any = make_policy({"name": str(path)})
    policy.network(np.ones((1, policy.layout.size), np.float32))


def _onnx(folder: Path) -> Path:
    export_onnx(random_weights(), folder / "mine.onnx")
    return folder / "mine.onnx"


def _use_onnx(path: Path) -> None:
    """The graph, with a sidecar that says its digest is right."""
    side = Path(f"{path}.json")
    card = json.loads(side.read_text())
    card["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    side.write_text(json.dumps(card))
    _use_weights(path)


def _checkpoint(folder: Path) -> Path:
    import torch

    content = {"identity": "x", "number": 2, "model": {"modules": {"a": {"w": torch.ones(3, 4)}}}}
    runs_folder.save_checkpoint(folder, content)
    return folder / runs_folder.CHECKPOINT


def _mutated_checkpoint(data: bytes, rng: np.random.Generator) -> bytes:
    """Mostly with a digest that is right."""
    if rng.random() < 0.3:
        return flipped(data, rng)
    head = data.index(b"\n") + 1
    body = flipped(data[head + 65 :], rng)
    return data[:head] + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


READERS: dict[str, Reader] = {
    "map yaml": Reader(
        _small_map, _use_map, ("maps.io.map_server._description", "studio.plan_session.loaded")
    ),
    "map png": Reader(
        lambda folder: _small_map(folder).with_suffix(".png"),
        lambda path: _use_map(path.with_suffix(".yaml")),
        ("maps.io.map_server.read_picture",), _mutated_png,
    ),
    "map pgm": Reader(
        lambda folder: _small_map(folder, ".pgm").with_suffix(".pgm"),
        lambda path: _use_map(path.with_suffix(".yaml")),
        ("maps.io.map_server.read_picture",),
    ),
    "octile map": Reader(
        _written("yard.map", OCTILE), _use_map, ("maps.io.map_server.read_moving_ai_map",)
    ),
    "polygons": Reader(_written("room.json", ROOM), _use_map, ("maps.io.__init__._read",)),
    "model of stable-baselines3": Reader(
        _sb3_model, _algorithm, ("policies.sb3._algorithm",), flipped
    ),
    "house": Reader(_written("house.json", HOUSE), _use_map, ("maps.io.floor_plan.read_house",)),
    "barn worlds": Reader(_written("barn.json", BARN), _use_barn, ("scenes.barn._worlds",)),
    "problems": Reader(
        _written("problem_files.json", [PROBLEM, PROBLEM | {"name": "again", "size": 6.5}]),
        _use_problems, ("problem_files.read_problems",),
    ),
    "thesis settings": Reader(
        _written("thesis_settings.json", THESIS), _use_thesis,
        ("rrt_star_woa.thesis.read_thesis", "cli.arguments.spec"),
    ),
    "env settings": Reader(
        _written("env.json", ENV), _use_env,
        ("envs.settings.env_settings", "base.settings.read", "evaluation.evaluate.env_settings",
         "cli.arguments.shield_of", "cli.hardware.calibrate", "cli.compare.trained_in"),
    ),
    "hidden chair": Reader(
        _written("hidden.json", HIDDEN),
        lambda path: PlantSettings.read(path, BELIEVED),
        ("hardware.twin.plant.read", "cli.compare.compare"),
    ),
    "scene settings": Reader(
        _written("scenes.json", {name: dump(SCENES[name]()) for name in SCENE_NAMES}),
        lambda path: _use_each(
            path, SCENE_NAMES, lambda one: make_scene(one).sample(np.random.default_rng(1))
        ),
        ("cli.arguments.spec",),
    ),
    "planner settings": Reader(
        _shipped("planners.json"), lambda path: _use_each(path, PLANNERS, make_planner),
        ("cli.arguments.spec",),
    ),
    "protocol": Reader(
        _written("protocol.json", PROTOCOL), lambda path: read(Protocol, path),
        ("base.settings.read",),
    ),
    "amendment": Reader(
        _amendment, lambda path: current_protocol(path.parent), ("people.folder.current_protocol",)
    ),
    "records of a participant": Reader(_chain, read_chain, ("people.folder.read_chain",)),
    "training settings": Reader(
        _shipped("ppo_guided.json"),
        lambda path: read_training(read_json(path), path.name, "ppo"),
        ("cli.train.training_content",),
    ),
    "planner results": Reader(
        _written("bench.json", {"format": FORMAT, "records": [RECORD]}), check_result,
        ("benchmarks.planner_benchmark.check_result",),
    ),
    "benchmark entry": Reader(_entry, tracks.read_result, ("benchmarks.tracks.read_result",)),
    "comparison": Reader(
        _written("results.json", COMPARISON), _use_comparison,
        ("learning.folder._results", "studio.session._results"),
    ),
    "curve": Reader(
        _curve,
        lambda path: runs_folder.write_curve(
            path.parent / "again", runs_folder.read_curve(path.parent)
        ),
        ("learning.folder.read_curve",),
    ),
    "store": Reader(
        _written("episodes.jsonl", STORE), _use_store, ("evaluation.runs.read_store",)
    ),
    "log": Reader(
        _log, lambda path: by_odometry(read_log(path), LASER, SlamSettings()),
        ("perception.logs.read_log",),
    ),
    "recording": Reader(
        _recording, _use_recording, ("recording.read_bags.mcap_messages",), _mutated_mcap
    ),
    "bag": Reader(
        _bag, _use_bag,
        ("recording.read_bags.is_bag", "recording.read_bags.mcap_messages"), _mutated_mcap,
    ),
    "bag in SQLite": Reader(_sqlite_bag, _use_bag, ("recording.read_bags._rows",), flipped),
    "weights": Reader(
        _weights, _use_weights, ("learning.weights.load_weights",), _mutated_weights,
    ),
    "onnx": Reader(_onnx, _use_onnx, ("learning.export.__init__",), flipped),
    "onnx card": Reader(
        lambda folder: Path(f"{_onnx(folder)}.json"),
        lambda path: _use_weights(path.with_suffix("")), ("learning.export.__init__",),
    ),
    "checkpoint": Reader(
        _checkpoint, lambda path: runs_folder.load_checkpoint(path.parent),
        ("learning.folder.load_checkpoint",), _mutated_checkpoint,
    ),
}  # fmt: skip


# ---- the worker, and who watches it


def judged(name: str, path: Path) -> str:
    """Read a file: '' if it was read, 'refused', or what went wrong."""
    try:
        READERS[name].read(path)
    except InputError as error:
        text = str(error)
        if "\n" in text or len(text) > LONGEST:
            lines = text.count("\n") + 1
            return f"a message of {len(text)} characters, {lines} lines: {text[:200]!r}"
        return "refused"
    except Exception as error:
        where = ""
        for frame, line in traceback.walk_tb(error.__traceback__):
            file = Path(frame.f_code.co_filename)
            if file.is_relative_to(ROOT) and "site-packages" not in file.parts:
                where = f"{file.relative_to(ROOT)}:{line}"
        return f"{type(error).__name__} at {where}: {str(error)[:200]}"
    return ""


def work() -> None:
    """Answer each line NAME, NUMBER of standard input with a line of JSON."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    valid: dict[str, bytes] = {}
    paths: dict[str, Path] = {}
    with tempfile.TemporaryDirectory() as top:
        for line in sys.stdin:
            (name, number), said = json.loads(line), ""
            if name not in valid:
                resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY,) * 2)
                folder = Path(top) / name.replace(" ", "_")
                folder.mkdir()
                paths[name] = READERS[name].make(folder)
                valid[name] = paths[name].read_bytes()
                said = judged(name, paths[name])
                hard = resource.getrlimit(resource.RLIMIT_AS)[1]
                held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
                resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY, hard))
                said = said and f"the valid file: {said}"
            if number >= 0 and not said:
                paths[name].write_bytes(input_of(name, valid[name], number))
                said = judged(name, paths[name])
            answers.write(json.dumps({"said": said}) + "\n")


class Watched:
    """A worker that is started anew after a hang or a crash."""

    def __init__(self) -> None:
        self._running: Any = None
        self._ready: set[str] = set()

    def ask(self, name: str, number: int) -> str:
        """Return what became of an input (`judged`); a hang or a crash has its own words."""
        if self._running is None:
            self._start()
        if name not in self._ready:
            first = self._answer(name, -1, READY)
            if first:
                return first
            self._ready.add(name)
        return self._answer(name, number, TIMEOUT)

    def _answer(self, name: str, number: int, limit: float) -> str:
        running = self._running
        running.stdin.write(json.dumps([name, number]) + "\n")
        running.stdin.flush()
        ready = select.select([running.stdout], [], [], limit)[0]
        line = running.stdout.readline() if ready else ""
        if line:
            return str(json.loads(line)["said"])
        code = running.poll() if not ready else running.wait()
        self.close()
        return f"crash with exit code {code}" if ready else f"hang: over {limit:g} s"

    def _start(self) -> None:
        environ = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        self._running = subprocess.Popen(
            [sys.executable, "-c", "from tests.fuzz import work; work()"], cwd=ROOT, env=environ,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._ready = set()

    def close(self) -> None:
        """End the worker."""
        if self._running is not None:
            self._running.kill()
            self._running.communicate()
            self._running = None


def fuzz(watched: Watched, name: str, numbers: range) -> dict[str, Any]:
    """How many of a reader's inputs were read and how many refused, and what failed."""
    found: dict[str, Any] = {"read": 0, "refused": 0, "failed": []}
    for number in numbers:
        said = watched.ask(name, number)
        if said in ("", "refused"):
            found[said or "read"] += 1
        else:
            found["failed"].append([number, said])
    return found


if __name__ == "__main__":
    with contextlib.closing(Watched()) as watched:
        for name in READERS:
            print(name, fuzz(watched, name, range(*map(int, sys.argv[1:]))), flush=True)
