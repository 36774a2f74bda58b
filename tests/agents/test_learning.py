"""Laws of learning: runs resume exactly, actors see no secrets, weights are whole or refused."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import torch

import wheelchair_gym
from agents.cli import main
from agents.evaluate import drive_episode, episode_key
from agents.learned import file_digest
from agents.learning.checkpoint import NAME, load_checkpoint
from agents.learning.curves import read_curve
from agents.learning.demonstrations import Imitation, imitate
from agents.learning.features import Layout, features
from agents.learning.networks import Features, arrays_of
from agents.learning.run import BEST, POLICY, Run, train
from agents.learning.settings import RECIPES, Training, read_training
from agents.learning.weights import FORMAT, Network, Weights, load_weights, save_weights
from agents.policy import make_policy
from wheelchair_gym.config import InputError
from wheelchair_gym.envs import NavigationEnv

ENV = {
    "scene": "clutter",
    "rate": 5.0,
    "guidance": "poses",
    "bank": {"size": 2, "turnover": 0.0},
    "chair": {"randomise": True},
    "sensors": {"laser": {"beams": 48}, "pose_source": "modelled"},
    "task": {"beams": 32, "aim": "time", "last_action": True, "time_base": 4.0, "time_factor": 0.0},
}
PRIVY = {**ENV, "task": {**ENV["task"], "privileged": True}}
ON = {"steps": 8, "batch": 32, "epochs": 1, "memory": 8}
OFF = {"buffer": 400, "batch": 16, "begin": 32, "updates": 1}


MORE = ("recurrent_ppo", "td3", "tqc")


def tiny(algorithm, **changes):
    """A run of three checkpoints that takes a second."""
    on_policy = algorithm in ("ppo", "recurrent_ppo")
    content = {
        "env": PRIVY if algorithm == "ppo" else ENV,
        "envs": 4,
        "frames": 192 if on_policy else 96,
        "checkpoint": 2 if on_policy else 8,
        "hidden": [16, 16],
        "threads": 1,
        "on_policy": ON,
        "off_policy": OFF,
        "trials": {"episodes": 3, "every": 3},
        "curriculum": {"begin": 3.0, "episodes": 4, "above": 0.0},
        **changes,
    }
    return read_training(content, "tiny.json", algorithm)


def numbers(rows):
    """A curve without the columns that tell of wall-clock time."""
    return [{k: str(v) for k, v in row.items() if not k.endswith("_s") and v != ""} for row in rows]


@pytest.mark.parametrize(
    "algorithm",
    ["ppo", "sac", *(pytest.param(name, marks=pytest.mark.long) for name in MORE)],
)
def test_a_run_that_was_killed_and_resumed_equals_one_that_was_not(algorithm, tmp_path):
    if algorithm in ("recurrent_ppo", "tqc"):
        pytest.importorskip("sb3_contrib")
    own = tiny(algorithm)
    whole = train(own, 3, tmp_path / "whole")
    assert len(whole) == 3
    killed = Run(own, 3, tmp_path / "killed")
    killed.learn()

    class KilledError(Exception):
        pass

    def kill(frames):
        if frames > killed.part + killed.part // 2:
            raise KilledError

    with pytest.raises(KilledError):
        killed.learn(kill)  # in the midst of the second part
    killed.close()
    resumed = train(own, 3, tmp_path / "killed")
    assert numbers(resumed) == numbers(whole) == numbers(read_curve(tmp_path / "killed"))
    ends = [load_weights(tmp_path / name / POLICY).arrays for name in ("whole", "killed")]
    for name, array in ends[0].items():
        assert np.array_equal(array, ends[1][name]), name
    assert numbers(train(own, 3, tmp_path / "whole")) == numbers(whole)  # nothing more to do
    other = train(own, 4, tmp_path / "other")
    assert numbers(other) != numbers(whole)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    run = Run(tiny("ppo"), 0, folder)
    run.learn()
    run.learn()
    run.learn()
    run.close()
    return run, folder


def test_the_actor_never_reads_what_only_the_critic_may_see(trained):
    run, _ = trained
    layout, rng = run.layout, np.random.default_rng(0)
    assert layout.private == 3
    seen = rng.uniform(0.1, 3.0, (64, layout.room)).astype(np.float32)
    other = seen.copy()
    other[:, -layout.private :] += 5.0
    with torch.no_grad():
        policy = run.model.policy
        acts, values = zip(
            *(
                (policy.get_distribution(t).distribution.mean.numpy(), policy.predict_values(t))
                for t in map(torch.from_numpy, (seen, other))
            ),
            strict=True,
        )
    assert np.array_equal(*acts)
    assert not torch.equal(*values)
    network = Network(load_weights(run.folder / POLICY))
    assert np.array_equal(network(seen), network(other))


def test_evaluation_lacks_what_only_the_critic_may_see(trained):
    """A trained policy drives an env of its defaults, whose observations have no such key."""
    _, folder = trained
    env = NavigationEnv("clutter", pose_source="modelled")
    assert "privileged" not in env.observation_space.spaces
    policy = make_policy(str(folder / POLICY))
    record = drive_episode(env, policy, 0)
    assert record["outcome"] in ("success", "collision", "timeout", "missed")
    assert "privileged" not in policy._eye.observation


def test_numpy_and_torch_act_alike(trained):
    run, folder = trained
    network, rng = Network(load_weights(folder / POLICY)), np.random.default_rng(1)
    seen = rng.uniform(-1.0, 6.0, (2000, run.layout.room)).astype(np.float32)
    seen[:, : run.layout.place("goal").start + 1] = np.abs(
        seen[:, : run.layout.place("goal").start + 1]
    )
    actions = run.model.predict(seen, deterministic=True)[0]
    assert network(seen) == pytest.approx(actions, abs=1e-5)


@pytest.mark.parametrize("algorithm", ["sac", "td3", "tqc", "recurrent_ppo"])
def test_numpy_acts_as_every_algorithm_does(algorithm, tmp_path):
    if algorithm in ("recurrent_ppo", "tqc"):
        pytest.importorskip("sb3_contrib")
    run = Run(tiny(algorithm, trials={"episodes": 0}), 0, tmp_path)
    network, rng = Network(run.weights({})), np.random.default_rng(1)
    network.reset(5)
    state = None
    for k in range(4):
        seen = rng.uniform(0.1, 3.0, (5, run.layout.room)).astype(np.float32)
        first = np.full(5, k == 0)
        actions, state = run.model.predict(seen, state, first, deterministic=True)
        assert network(seen) == pytest.approx(actions, abs=1e-5)
    run.close()


def test_a_driver_sees_and_acts_as_in_training(trained):
    """In the env that it was trained in, a driver does what the network does on the env's own."""
    run, folder = trained
    settings = {**ENV, "sensors": {**ENV["sensors"], "pose_source": "truth"}}
    env = NavigationEnv(config=settings)
    observation, _ = env.reset(seed=4)
    policy, network = make_policy(str(folder / POLICY)), Network(load_weights(folder / POLICY))
    policy.reset(env.task)
    for _ in range(6):
        flat = np.concatenate([observation[key] for key in env.task.boxes()])
        action = policy.act(observation)
        assert action == pytest.approx(network(flat[None])[0], abs=1e-6)
        observation, *_ = env.step(action)
    assert run.layout.room == len(flat) + 3


def test_a_driver_holds_its_action_where_control_is_faster(trained):
    _, folder = trained
    env = NavigationEnv("clutter", rate=10.0)
    observation, _ = env.reset(seed=0)
    policy = make_policy({"name": str(folder / POLICY)})
    policy.reset(env.task)
    actions = []
    for _ in range(8):
        actions.append(policy.act(observation))
        observation, *_ = env.step(actions[-1])
    actions = np.array(actions)
    assert np.array_equal(actions[::2], actions[1::2])
    assert len(np.unique(actions, axis=0)) == 4
    env = NavigationEnv("clutter", rate=4.0)
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"the policy acts at 5 Hz; a control period of 0.25 s"):
        policy.reset(env.task)


def test_files_that_are_not_whole_are_refused_in_one_line(trained, tmp_path, capsys):
    _, folder = trained
    content = (folder / POLICY).read_bytes()
    for k, broken in enumerate(
        (
            content[:-100],
            b"",
            content[: len(content) // 2] + b"\x01" + content[len(content) // 2 + 1 :],
            b"no weights",
        )
    ):
        file = tmp_path / f"broken{k}.npz"
        file.write_bytes(broken)
        assert main(["simulate", "--scene", "clutter", "--policy", str(file)]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert file.name in told
    assert main(["simulate", "--policy", str(tmp_path / "none.npz")]) == 2
    assert "cannot be read" in capsys.readouterr().err
    run_of = tmp_path / "run"
    run_of.mkdir()
    data = bytearray((folder / NAME).read_bytes())
    data[len(data) // 2] ^= 1
    (run_of / NAME).write_bytes(bytes(data))
    with pytest.raises(InputError, match="expected a whole checkpoint"):
        load_checkpoint(run_of)
    with pytest.raises(InputError, match="holds a run of other settings or another seed"):
        Run(tiny("ppo"), 1, folder)


def test_weights_that_hold_code_are_refused(tmp_path):
    class Code:
        def __reduce__(self):
            return (open, (str(tmp_path / "executed"), "w"))

    file = tmp_path / "evil.npz"
    np.savez(file, card=np.array([Code()], dtype=object))
    with pytest.raises(InputError, match="expected whole weights of a policy"):
        load_weights(file)
    assert not (tmp_path / "executed").exists()


def test_a_record_depends_on_the_weights_and_a_digest_may_be_asked_for(trained, tmp_path):
    _, folder = trained
    file = tmp_path / "mine.npz"
    file.write_bytes((folder / POLICY).read_bytes())
    spec = {"name": str(file), "digest": file_digest(file)}
    make_policy(spec)
    before = episode_key(str(file), "clutter", 0, {})
    weights = load_weights(file)
    weights.arrays["dense0.b"] = weights.arrays["dense0.b"] + np.float32(1.0)
    save_weights(file, weights)
    assert episode_key(str(file), "clutter", 0, {}) != before
    with pytest.raises(InputError, match="SHA-256 differs"):
        make_policy(spec)


def test_the_card_tells_where_weights_come_from(trained):
    run, folder = trained
    card = load_weights(folder / BEST).card
    assert card["trials"].keys() >= {"success", "collision", "timeout", "episodes", "seed"}
    assert card["training"] == json.loads((folder / "settings.json").read_text())
    for key in ("command", "seed", "frames", "versions", "limits", "env", "commit"):
        assert key in card
    assert (folder / POLICY).stat().st_size < 3_000_000
    assert run.rows[-1]["trial_success"] == card["trials"]["success"]


def test_the_curriculum_moves_starts_away_where_enough_succeed(trained):
    run, _ = trained
    within = [row["within"] for row in run.rows]
    assert within[0] >= 3.0
    assert within == sorted(within)


def random_weights(memory=0, posed=True, head="clip"):
    sizes = [
        ["laser", 64], ["ultrasonic", 8], ["twist", 2], ["goal", 3], ["action", 2], ["path", 20],
    ]  # fmt: skip
    layout = Layout.of(sizes, posed)
    rng = np.random.default_rng(5)

    def draw(*shape):
        return (rng.normal(size=shape) / np.sqrt(shape[-1])).astype(np.float32)

    told, arrays = layout.told, {}
    if memory:
        arrays = {"lstm.x": draw(4 * memory, told), "lstm.h": draw(4 * memory, memory)}
        arrays["lstm.b"], told = draw(4 * memory), memory
    for k, (before, after) in enumerate(((told, 32), (32, 32), (32, 2))):
        arrays[f"dense{k}.w"], arrays[f"dense{k}.b"] = draw(after, before), draw(after)
    env = {"sensors": {"laser": {"beams": 1081}}}
    card = {"format": FORMAT, "head": head, "env": env}
    return Weights(arrays, {**card, "layout": {"sizes": sizes, "posed": posed}})


@pytest.mark.parametrize(("memory", "head"), [(0, "clip"), (0, "tanh"), (16, "clip")])
def test_onnx_acts_as_numpy_from_raw_readings(memory, head, tmp_path):
    """10,000 scans as a laser gives them, with missing and invalid echoes among them."""
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    from agents.learning.export import OnnxNetwork, export_onnx
    from wheelchair_gym.task.observe import pool, see

    weights = random_weights(memory, head=head)
    file = tmp_path / "policy.onnx"
    sidecar = export_onnx(weights, file)
    n, rng = 2500, np.random.default_rng(0)
    exact, plain = OnnxNetwork(file), Network(weights)
    exact.reset(n)
    plain.reset(n)
    for _ in range(4):
        raw = {
            key: rng.uniform(-1.0, 1.0, (n, width)).astype(np.float32)
            for key, width in sidecar["inputs"].items()
            if key not in ("h", "c")
        }
        raw["goal"][:, 0] = rng.uniform(0.0, 30.0, n)
        for key in ("laser", "ultrasonic"):
            scan = rng.uniform(0.02, 14.0, raw[key].shape)
            for value in (np.inf, -np.inf, np.nan):
                scan[rng.random(scan.shape) < 0.02] = value
            raw[key] = scan.astype(np.float32)
        pooled = np.empty((n, 64), np.float32)
        for row, scan in zip(pooled, raw["laser"], strict=True):
            pool(scan, 10.0, row)
        reaches = [4.0] * 4 + [6.0] * 4
        heard = [[see(r, most) for r, most in zip(row, reaches, strict=True)]
                 for row in raw["ultrasonic"]]  # fmt: skip
        parts = [pooled, heard, *(raw[key] for key in ("twist", "goal", "last_action", "path"))]
        actions = plain(np.concatenate(parts, axis=1).astype(np.float32))
        found = exact.run(raw)
        assert np.abs(found["action"] - actions).max() < 1e-5
        scale = np.where(found["action"] > 0.0, [0.8, 1.0], [0.3, 1.0])
        assert found["twist_asked"] == pytest.approx(found["action"] * scale, abs=1e-6)


def test_an_exported_policy_drives_as_its_weights_do(trained, tmp_path, capsys):
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    _, folder = trained
    file = tmp_path / "policy.onnx"
    assert main(["export", str(folder / POLICY), "--onnx", str(file)]) == 0
    actions = {}
    for name in (str(folder / POLICY), str(file)):
        env = NavigationEnv(config={**ENV, "sensors": {"laser": {"beams": 48}}})
        observation, _ = env.reset(seed=0)
        policy = make_policy(name)
        policy.reset(env.task)
        actions[name] = []
        for _ in range(5):
            actions[name].append(policy.act(observation))
            observation, *_ = env.step(actions[name][-1])
    first, second = actions.values()
    assert np.array(first) == pytest.approx(np.array(second), abs=1e-4)
    file.write_bytes(file.read_bytes()[:-1])
    capsys.readouterr()
    assert main(["simulate", "--policy", str(file)]) == 2
    assert "differs from what policy.onnx.json says" in capsys.readouterr().err


def test_features_are_the_same_numbers_in_numpy_and_torch():
    layout = random_weights().layout
    seen = np.random.default_rng(2).uniform(0.01, 9.0, (50, layout.room)).astype(np.float32)
    told = Features(
        __import__("gymnasium").spaces.Box(0.0, 10.0, (layout.room,)), layout
    )(torch.from_numpy(seen))  # fmt: skip
    plain = features(np, seen, layout, layout.scaled, layout.scales)
    assert plain.shape == (50, layout.told)
    assert plain.dtype == np.float32
    assert told.numpy() == pytest.approx(plain, abs=1e-5)


def test_imitation_comes_near_its_expert_and_warms_a_run(tmp_path):
    own = Imitation(expert="straight", env=ENV, episodes=4, rounds=2, epochs=40, hidden=(16, 16))
    told = imitate(own, 0, tmp_path, progress=False)
    assert told["driver"] == "student"
    first = json.loads((tmp_path / "rounds.json").read_text())[0]
    assert told["steps"] > first["steps"]
    assert told["loss"] < 0.05
    file = str(tmp_path / POLICY)
    run = Run(tiny("ppo", warm_start=file), 0, tmp_path / "warm")
    for name, array in arrays_of(run.model, "ppo").items():
        assert np.array_equal(array, load_weights(file).arrays[name])
    run.close()
    with pytest.raises(InputError, match="warm_start: layers are"):
        Run(tiny("ppo", warm_start=file, hidden=[8]), 0, tmp_path / "other")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"algorithm": "sac"}, "x.json.algorithm is 'sac'; the command says ppo"),
        ({"frame": 3}, "x.json.frame is not a setting; it has"),
        ({"env": {"task": {"beamz": 3}}}, "beamz is not a setting"),
        ({"env": {}}, "curriculum.begin needs env.guidance 'poses', or 0"),
        ({"on_policy": {"discount": 2.0}}, "discount is 2.0; it must be at least 0.0 and at most"),
    ],
)
def test_wrong_settings_of_a_run_are_refused_by_name(content, message):
    with pytest.raises(wheelchair_gym.InputError, match=message):
        read_training(content, "x.json", "ppo")


@pytest.mark.parametrize("name", sorted(RECIPES))
def test_recipes_are_whole_runs(name):
    own = RECIPES[name]
    assert dataclasses.replace(own) == own
    assert own.env_settings().bank.turnover == 0.0  # each checkpoint begins episodes anew
    with pytest.raises(InputError, match="privileged is for ppo's critic"):
        Training(algorithm="sac", env=PRIVY)
