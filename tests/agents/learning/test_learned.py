"""Laws of learned policies: they drive as they were trained, and are whole or refused."""

import dataclasses
import json
import shutil
import sys
from itertools import chain, islice
from types import SimpleNamespace

import numpy as np
import pytest

from agents.cli import main
from agents.evaluation.compare import SUITES
from agents.evaluation.evaluate import episode_key, evaluate
from agents.learning.folder import (
    BEST,
    CHECKPOINT,
    CURVE,
    POLICY,
    load_checkpoint,
    model_card,
    read_curve,
)
from agents.learning.run import Run, train
from agents.learning.weights import Network, load_weights, save_weights, shipped
from agents.policies import GymPolicy, make_policy
from agents.policies.learned import BACK, LearnedDriver
from tests.agents.fakes import infos_of
from tests.agents.learning.tiny_runs import ENV, random_weights, tiny
from tests.conftest import ROOT, at_start, put, refusal, steps_of
from wheelchair_gym.base.files import file_digest
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv


@pytest.fixture
def folder(trained):
    return trained[1]


def test_a_driver_sees_the_tracks_that_it_saw_in_training(tmp_path):
    task = {**ENV["task"], "tracks": 2}
    run = Run(tiny("ppo", env={**ENV, "task": task}), 0, tmp_path)
    run.learn()
    run.close()
    people = {"density": [0.3, 0.3]}
    hall = {"name": "crowd", "place": "hall", "hall_size": [8.0, 10.0], "people": people}
    sensors = {**ENV["sensors"], "pose_source": "truth"}
    env = NavigationEnv(
        config={**ENV, "scene": hall, "sensors": sensors, "task": task}, split="test"
    )
    driver, seen = make_policy(str(tmp_path / POLICY)), 0
    policy = GymPolicy(driver, env)
    for seed in range(3):
        begun = env.reset(seed=seed)
        policy.reset()
        for observation, *_ in chain([begun], steps_of(env, np.array([0.1, 0.2]), 19)):
            policy.act(observation)
            tracks = driver.task.observation["tracks"]
            assert tracks == pytest.approx(observation["tracks"], abs=1e-5)
            seen += bool(tracks.any())
    assert seen > 10


def test_a_driver_sees_and_acts_as_in_training(trained):
    """It is told the action that was driven, shielded or not, and what the shield withheld."""
    run, folder = trained
    settings = {**ENV, "sensors": {**ENV["sensors"], "pose_source": "truth"}, "shield": {},
                "unshielded": 0.5, "task": {**ENV["task"], "time_base": 20.0}}  # fmt: skip
    env = NavigationEnv(config=settings, split="test")
    policy, network = make_policy(str(folder / POLICY)), Network(load_weights(folder / POLICY))
    maximum = {True: 0.0, False: 0.0}
    for seed in range(8):
        begun = env.reset(seed=seed)
        policy.reset(env.mission)
        for observation, *_ in chain([begun], steps_of(env, np.array([1.0, 0.1]), 39)):
            command = policy.act(env.reading)
            flat = np.concatenate([observation[key] for key in env.task.spaces])
            assert policy.observation == pytest.approx(flat, abs=1e-6)
            action = command.as_action(env.settings.chair.limits)
            assert action == pytest.approx(network(flat[None])[0], abs=1e-6)
            maximum[env.task.is_shielded] = max(
                maximum[env.task.is_shielded], abs(observation["shield"][1])
            )
    assert maximum[True] > 0.1
    assert maximum[False] == 0.0
    assert run.layout.size == len(flat) + 3


def test_a_driver_is_told_what_was_withheld_in_all_the_time_since_it_acted(folder):
    env = NavigationEnv("clutter", shield=True, split="test")
    policy = make_policy(str(folder / POLICY))
    maximum = 0.0
    for seed in range(4):
        env.reset(seed=seed)
        policy.reset(env.mission)
        withheld = [np.zeros(2), np.zeros(2)]
        for k in range(60):
            policy.act(env.reading)
            if k and k % 2 == 0:
                seen = policy.observation[policy.layout.slice_of("shield")]
                mean = np.mean(withheld[-2:], axis=0) / (0.8, 1.0)
                assert seen == pytest.approx([1.0, *mean], abs=1e-6)
                maximum = max(maximum, abs(withheld[-1][0] - withheld[-2][0]))
            _, _, terminated, truncated, _ = env.step(np.array([1.0, 0.0]))
            withheld.append(np.array(env.task.shield_intervention))
            if terminated or truncated:
                break
    assert maximum > 0.0


def test_a_driver_holds_its_action_where_control_is_faster(folder):
    env = at_start(NavigationEnv("clutter", rate=10.0, split="test"))
    policy = {"name": str(folder / POLICY)}
    actions = np.array([env.task.action for _ in islice(infos_of(env, policy), 8)])
    assert np.array_equal(actions[::2], actions[1::2])
    assert len(np.unique(actions, axis=0)) == 4
    env = at_start(NavigationEnv("clutter", rate=4.0, split="test"))
    with pytest.raises(InputError, match="the policy acts at 5 Hz, the environment at 4 Hz"):
        make_policy(policy).reset(env.mission)


def test_a_driver_is_guided_through_a_narrow_door_as_in_training():
    weights = random_weights(posed=False)
    weights.card["env"]["guidance"] = "geodesic"
    weights.card["env"]["task"]["look_ahead"] = np.linspace(0.5, 5.0, 10)
    env = NavigationEnv({"name": "doorway", "door_width": 0.65}, guidance="geodesic", split="test")
    env.reset(seed=0)
    driver = LearnedDriver(Network(weights), weights.card)
    driver.reset(env.mission)
    assert len(driver.task.path) > 2
    assert np.array_equal(driver.task.path, env.task.path)


def test_on_a_map_that_grows_the_way_leads_beyond_what_is_drawn():
    env = NavigationEnv({"name": "floor_plan", "kind": "home"}, pose_source="slam", split="test")
    env.reset(seed=5)
    x0, y0, x1, y1 = env.task.map.bounds
    gx, gy = env.task.goal[:2]
    assert not (x0 < gx < x1 and y0 < gy < y1)
    policy = make_policy("ppo_guided")
    policy.reset(env.mission)
    path = policy.act(env.reading).shown.path
    assert len(path) > 2  # where no way is known, it is one straight line
    assert np.hypot(*(path[-1] - (gx, gy))) < env.task.tolerance


def test_on_a_map_that_grows_a_policy_remembers_where_it_has_been():
    env = NavigationEnv({"name": "floor_plan", "kind": "home"}, pose_source="slam", split="test")
    env.reset(seed=1)
    policy, been = make_policy("ppo_goal"), []
    for _ in islice(infos_of(env, SimpleNamespace(make=lambda: policy)), 50):
        been.append(np.hypot(*policy.observation[policy.layout.slice_of("trail")][-2:]))
    assert been[-1] > 0.1  # of 15 s ago: the start, from soon after it on
    assert (np.diff(been) > -0.15).all()  # never forgotten


def test_a_run_goes_on_only_from_a_whole_checkpoint_and_with_its_own_settings(folder, tmp_path):
    run_of = tmp_path / "run"
    run_of.mkdir()
    data = bytearray((folder / CHECKPOINT).read_bytes())
    data[len(data) // 2] ^= 1
    (run_of / CHECKPOINT).write_bytes(bytes(data))
    with pytest.raises(InputError, match="expected a complete checkpoint"):
        load_checkpoint(run_of)
    with pytest.raises(InputError, match="holds a run with seed 0, not 1; choose another folder"):
        Run(tiny("ppo"), 1, folder)
    (run_of / CHECKPOINT).unlink()
    shutil.copy(folder / CURVE, run_of)
    anew = Run(tiny("ppo"), 0, run_of)
    anew.learn()
    anew.close()
    assert [row["frames"] for row in read_curve(run_of)] == [anew.frames]  # and no old ones
    other = dataclasses.replace(tiny("ppo"), checkpoint_frequency=77)
    with pytest.raises(InputError, match=r"holds a run with checkpoint_frequency .*, not 77"):
        Run(other, 0, folder)


def test_a_finished_run_is_extended_by_asking_for_more_frames(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "run")
    finished = Run(tiny("ppo"), 0, copy)
    assert finished.done
    longer = dataclasses.replace(tiny("ppo"), frames=tiny("ppo").frames + 1)
    run = Run(longer, 0, copy)
    assert not run.done
    run.learn()
    assert run.done
    with pytest.raises(InputError, match="holds a run with frames"):
        Run(tiny("ppo"), 0, copy)  # fewer than it has


def test_a_damaged_byte_of_weights_is_noticed_or_changes_nothing(folder, tmp_path):
    """An archive's own bytes, the time that it was written, say, are no part of what it holds."""
    content, whole = (folder / POLICY).read_bytes(), load_weights(folder / POLICY)
    file, noticed = tmp_path / "damaged.npz", 0
    places = range(0, len(content), max(1, len(content) // 400))
    for place in (*range(200), *places):
        damaged = bytearray(content)
        damaged[place] ^= 1 << place % 8
        file.write_bytes(damaged)
        try:
            weights = load_weights(file)
        except InputError:
            noticed += 1
            continue
        assert weights.card == whole.card
        assert weights.digest == whole.digest
    assert noticed > len(places) // 2


def test_weights_that_hold_code_are_refused(tmp_path):
    class Code:
        def __reduce__(self):
            return (open, (str(tmp_path / "executed"), "w"))

    file = tmp_path / "evil.npz"
    np.savez(file, card=np.array([Code()], dtype=object))
    with pytest.raises(InputError, match="expected complete weights of a policy"):
        load_weights(file)
    assert not (tmp_path / "executed").exists()


def test_a_record_depends_on_the_weights_and_a_digest_may_be_asked_for(folder, tmp_path):
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
    assert card["evaluation"].keys() >= {"success", "collision", "timeout", "episodes", "seed"}
    assert card["training"] == json.loads((folder / "settings.json").read_text())
    for key in ("command", "seed", "frames", "versions", "limits", "env", "commit"):
        assert key in card
    assert (folder / POLICY).stat().st_size < 3_000_000
    assert run.rows[-1]["eval_success"] == card["evaluation"]["success"]


@pytest.mark.parametrize(("head", "rear"), [("clip", 541), ("tanh", 0)])
def test_onnx_acts_as_numpy_from_raw_readings(head, rear, tmp_path):
    """10,000 scans as a laser gives them, with missing and invalid echoes among them."""
    pytest.importorskip("onnx", reason="pip install 'wheelchair_gym[learn]'")
    pytest.importorskip("onnxruntime", reason="pip install 'wheelchair_gym[learn]'")
    from agents.learning.export import OnnxNetwork, export_onnx
    from wheelchair_gym.task.observations import observed_range, pool_beams

    weights = random_weights(head=head, rear=rear)
    file = tmp_path / "policy.onnx"
    sidecar = export_onnx(weights, file)
    n, rng = 2500, np.random.default_rng(0)
    exact, plain = OnnxNetwork(file), Network(weights)
    for _ in range(4):
        raw = {
            key: rng.uniform(-1.0, 1.0, (n, width)).astype(np.float32)
            for key, width in sidecar["inputs"].items()
        }
        raw["goal"][:, 0] = rng.uniform(0.0, 30.0, n)
        for key in ("laser", "ultrasonic"):
            scan = rng.uniform(0.02, 14.0, raw[key].shape)
            for value in (np.inf, -np.inf, np.nan):
                scan[rng.random(scan.shape) < 0.02] = value
            raw[key] = scan.astype(np.float32)
        pooled = np.empty((n, 96 if rear else 64), np.float32)
        for row, scan in zip(pooled, raw["laser"], strict=True):
            pool_beams(scan[:1081], 10.0, row[:64])
            if rear:
                pool_beams(scan[1081:], 10.0, row[64:])
        reaches = [4.0] * 4 + [6.0] * 4
        heard = [[observed_range(r, maximum) for r, maximum in zip(row, reaches, strict=True)]
                 for row in raw["ultrasonic"]]  # fmt: skip
        rest = ("twist", "goal", "last_action", "shield", "path")
        parts = [pooled, heard, *(raw[key] for key in rest)]
        flat = np.concatenate(parts, axis=1).astype(np.float32)
        actions = plain(flat)
        assert np.abs(exact(flat) - actions).max() < 1e-5
        action, twist = exact._session.run(["action", "twist_asked"], raw)
        assert np.abs(action - actions).max() < 1e-5
        scale = np.where(action > 0.0, [0.8, 1.0], [0.3, 1.0])
        assert twist == pytest.approx(action * scale, abs=1e-6)


def test_an_exported_policy_drives_as_its_weights_do(folder, tmp_path, capsys):
    pytest.importorskip("onnx", reason="pip install 'wheelchair_gym[learn]'")
    pytest.importorskip("onnxruntime", reason="pip install 'wheelchair_gym[learn]'")
    file = tmp_path / "policy.onnx"
    mine = {"name": str(folder / POLICY), "patience": 5.0}
    own = put(tmp_path / "own.json", {"mine": mine})
    assert main(["export", f"{own}:mine", "--onnx", str(file)]) == 0
    actions = []
    for name in (str(folder / POLICY), str(file)):
        env = NavigationEnv(config={**ENV, "sensors": {"laser": {"beams": 48}}}, split="test")
        env.reset(seed=0)
        actions.append([env.task.action for _ in islice(infos_of(env, name), 5)])
    assert np.array(actions[0]) == pytest.approx(np.array(actions[1]), abs=1e-4)
    file.write_bytes(file.read_bytes()[:-1])
    capsys.readouterr()
    said = refusal(["simulate", "--policy", file], capsys)
    assert "differs from what policy.onnx.json says" in said


def test_weights_are_published_with_a_card_of_all_seeds_and_results(tmp_path, capsys, monkeypatch):
    for seed in (0, 1):
        train(tiny("ppo"), seed, tmp_path / f"seed_{seed}")
    files = [str(tmp_path / f"seed_{seed}" / POLICY) for seed in (0, 1)]
    compared = ["compare", "--suite", "demo", "--scenes", "clutter", "--episodes", "1"]
    compared += ["--no-video", "--jobs", "1", "--quiet", "--policies", ",".join(files)]
    compared += ["--out", str(tmp_path / "results")]
    monkeypatch.setattr(sys, "argv", ["wheelchair", *compared])
    assert main(compared) == 0
    out = tmp_path / "mine.npz"
    told = ["--results", str(tmp_path / "results" / "results.json")]
    assert main(["export", str(tmp_path), "--npz", str(out), *told]) == 0
    weights = load_weights(out)
    assert out.stat().st_size < 3_000_000
    best = max((0, 1), key=lambda seed: float(weights.card["curves"][str(seed)][-1][1]))
    ours = load_weights(files[best])
    assert weights.card["seed"] == best
    for name, array in ours.arrays.items():
        assert np.array_equal(array, weights.arrays[name])
    rows = weights.card["results"]
    assert [row["seed"] for row in rows] == ["0", "1"]
    assert all(row["episodes"] == 1 and "--policies mine" in row["command"] for row in rows)
    card = out.with_suffix(".md").read_text()
    parts = "# mine", "wheelchair", "seed 0 | seed 1", '"n_envs": 4', "drive it behind a shield"
    for part in parts:
        assert part in card
    capsys.readouterr()
    for words in ([tmp_path, "--results", out], [tmp_path / "none"], [files[0]]):
        refusal(["export", *words, "--npz", out], capsys)
    half = Run(tiny("ppo"), 0, tmp_path / "half")
    half.learn()
    half.close()
    words = ["export", tmp_path / "half", "--npz", out]
    assert "the run has not ended" in refusal(words, capsys)


@pytest.mark.parametrize("name", sorted(shipped()))
def test_weights_that_come_with_the_package_are_small_told_of_and_drive(name, tmp_path):
    path = shipped()[name]
    assert path.stat().st_size < 3_000_000
    card = load_weights(path).card
    assert model_card(name, card) == path.with_suffix(".md").read_text()
    assert {row["seed"] for row in card["results"]} == set(card["curves"])
    assert f"`{name}`" in (ROOT / "README.md").read_text()
    records = evaluate(
        [name], SUITES["homes"].scenes, range(3), folder=tmp_path, progress=False,
        env={"pose_source": "modelled", "model": "rear" if name == "ppo_rear" else "thesis"},
    )  # fmt: skip
    assert sum(record["success"] for record in records) >= 2


@pytest.mark.parametrize("sensors", [{"ultrasonic": {"mounted": []}}, {"laser": {"beams": 0}}])
def test_a_chair_with_fewer_sensors_learns_and_drives(sensors, tmp_path):
    env = {"scene": "empty", "sensors": sensors, "guidance": "geodesic", "task": {"beams": 1}}
    config = tiny("ppo", env=env, curriculum={"initial_time": 0.0})
    run = Run(config, 0, tmp_path / "run")
    run.learn()
    world = NavigationEnv(
        "empty", config={"sensors": {**sensors, "pose_source": "modelled"}}, split="test"
    )
    world.reset(seed=0)
    # The environment refuses an action that is not finite.
    assert next(infos_of(world, str(tmp_path / "run" / POLICY)))


def test_a_chair_that_stays_at_a_place_backs_out_if_it_is_impatient(monkeypatch):
    monkeypatch.setattr("agents.policies.learned.BACKING", 1.0)
    env = at_start(NavigationEnv("clutter", rate=5.0, pose_source="modelled", split="test"))
    first = env.mission.reading
    for patience in (0.0, 2.0):
        policy = make_policy({"name": "ppo_guided", "patience": patience})
        policy.reset(env.mission)
        # The same reading again and again: the chair stays at every command.
        readings = [first._replace(stamp=first.stamp + 0.25 * k) for k in range(30)]
        twists = [policy.act(reading).twist.tolist() for reading in readings]
        back = [k for k, twist in enumerate(twists) if twist == [-BACK, 0.0]]
        # After 2 s for 1 s, and again 2 s after it has ended.
        assert back == ([*range(9, 13), *range(22, 26)] if patience else [])
