"""Laws of learning: runs resume exactly, actors see no secrets, networks act alike everywhere."""

import csv
import dataclasses
import inspect
import json
import os
import re
from collections import Counter
from importlib.util import find_spec
from unittest.mock import MagicMock

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import PPO

from agents.cli import main
from agents.cli.train import varied
from agents.learning import run as run_module
from agents.learning.demonstrations import imitate
from agents.learning.folder import POLICY, episode_row, publish, read_curve
from agents.learning.networks import AsymmetricPolicy, Teacher, actor_arrays
from agents.learning.run import BATCH, Run, evaluate_network, train
from agents.learning.sb3 import SaveModel
from agents.learning.settings import RECIPES, Imitation
from agents.learning.weights import Layout, Network, load_weights
from tests.agents.learning.tiny_runs import ENV, ON, PRIVY, tiny
from tests.conftest import ROOT, put, until
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.task.observations import PRIVILEGED


def numbers(rows):
    return [{k: v for k, v in row.items() if not k.endswith("_s")} for row in rows]


@pytest.mark.parametrize(
    "algorithm", ["ppo", *(pytest.param(name, marks=pytest.mark.long) for name in ("sac", "td3"))]
)
def test_a_run_that_was_killed_and_resumed_equals_one_that_was_not(algorithm, trained, tmp_path):
    own = tiny(algorithm)
    if algorithm == "ppo":
        own = tiny("ppo", kickstarting={"teacher": str(trained[1] / POLICY), "duration": 0.8})
    evaluated = []
    whole = train(
        own, 3, tmp_path / "whole", on_evaluated=lambda done, total: evaluated.append((done, total))
    )
    assert len(whole) == 3
    total = own.evaluation.episodes
    assert evaluated[0] == (0, total)
    assert evaluated[-1] == (total, total)
    killed = Run(own, 3, tmp_path / "killed")
    killed.learn()

    class KilledError(Exception):
        pass

    def kill(frames):
        if frames > killed.frames_per_checkpoint + killed.frames_per_checkpoint // 2:
            raise KilledError

    with pytest.raises(KilledError):
        killed.learn(kill)  # in the midst of the second part
    killed.close()
    resumed = train(own, 3, tmp_path / "killed")
    assert numbers(resumed) == numbers(whole) == numbers(read_curve(tmp_path / "killed"))
    ends = [load_weights(tmp_path / name / POLICY) for name in ("whole", "killed")]
    for name, array in ends[0].arrays.items():
        assert np.array_equal(array, ends[1].arrays[name]), name
    curves = [end.card["curve"] for end in ends]
    assert curves[0] == curves[1]  # numbers are numbers, not their texts
    assert {type(value) for row in curves[0] for value in row if value != ""} <= {int, float}
    assert numbers(train(own, 3, tmp_path / "whole")) == numbers(whole)  # nothing more to do
    other = train(own, 4, tmp_path / "other")
    assert numbers(other) != numbers(whole)


class ReferencePolicy(AsymmetricPolicy):
    """The policy for the library's own PPO, whose rollouts hold observations."""

    def evaluate_actions(self, obs, actions):
        return super().evaluate_actions(self.extract_features(obs), actions)


def test_ppo_equals_that_of_the_library(tmp_path):
    exact = {**ON, "n_steps": 24, "precision": "float32", "batch_size": 96, "learning_rate": 0.01}
    run = Run(tiny("ppo", env=PRIVY, on_policy=exact, evaluation={"episodes": 0}), 0, tmp_path)
    model = run.model
    theirs = PPO(
        ReferencePolicy, run.env, learning_rate=0.01, policy_kwargs=model.policy_kwargs,
        n_steps=model.n_steps, batch_size=96, n_epochs=model.n_epochs, gamma=model.gamma,
        gae_lambda=model.gae_lambda, ent_coef=model.ent_coef, vf_coef=model.vf_coef,
        max_grad_norm=model.max_grad_norm, device="cpu",
    )  # fmt: skip
    theirs.policy.load_state_dict(model.policy.state_dict())
    model.lr_schedule = theirs.lr_schedule
    assert run.env.num_envs * model.n_steps == 96  # one batch: its order does not matter
    ends = []
    for each in (model, theirs):
        torch.manual_seed(3)
        run.env.seed(5)
        each.learn(2 * 96)
        ends.append(each.rollout_buffer)
    ours, reference = ends
    assert (ours.episode_starts[1:] > 0).any()  # an episode ended: also by its time limit
    for name in ("actions", "rewards", "values", "log_probs", "advantages", "returns"):
        seen, wanted = (getattr(end, name) for end in (ours, reference))
        if name != "rewards":  # theirs are by environment, ours by step
            wanted = wanted.reshape(4, 24, -1).swapaxes(0, 1)
        assert seen.reshape(96, -1) == pytest.approx(wanted.reshape(96, -1), abs=2e-4), name
    for ours_of, reference_of in zip(
        model.policy.parameters(), theirs.policy.parameters(), strict=True
    ):
        assert ours_of.detach().numpy() == pytest.approx(reference_of.detach().numpy(), abs=1e-3)
    run.close()


def test_gradients_in_bfloat16_point_where_those_in_float32_do(trained):
    run, _ = trained
    buffer, policy = run.model.rollout_buffer, run.model.policy
    seen, actions = (
        torch.from_numpy(of.reshape(-1, of.shape[-1]))
        for of in (buffer.observations, buffer.actions)
    )
    found = []
    for policy.in_bfloat16 in (False, True):
        values, log_prob, _ = policy.evaluate_actions(seen, actions)
        policy.zero_grad()
        (log_prob.mean() + values.mean()).backward()
        gradients = [p.grad.flatten() for p in policy.parameters() if p.grad is not None]
        found.append(torch.cat(gradients))
    policy.in_bfloat16 = False
    assert not torch.equal(*found)
    assert torch.cosine_similarity(*found, dim=0) > 0.999


def test_the_actor_never_reads_what_only_the_critic_may_see(trained):
    run, _ = trained
    layout, rng = run.layout, np.random.default_rng(0)
    assert layout.privileged_size == 3
    seen = rng.uniform(0.1, 3.0, (64, layout.size)).astype(np.float32)
    other = seen.copy()
    other[:, -layout.privileged_size :] += 5.0
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


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
def test_numpy_acts_as_every_algorithm_does(algorithm, tmp_path):
    run = Run(tiny(algorithm, evaluation={"episodes": 0}), 0, tmp_path)
    network, rng = Network(run.weights({})), np.random.default_rng(1)
    seen = rng.uniform(0.1, 3.0, (5, run.layout.size)).astype(np.float32)
    actions, _ = run.model.predict(seen, deterministic=True)
    assert network(seen) == pytest.approx(actions, abs=1e-5)
    run.close()


def test_the_curriculum_moves_starts_away_where_enough_succeed(trained):
    run, _ = trained
    within = [row["curriculum_time"] for row in run.rows]
    assert within[0] >= 3.0
    assert within == sorted(within)


def test_worlds_are_drawn_while_it_learns_with_the_same_result(tmp_path, monkeypatch):
    """At each checkpoint episodes draw from twice as many worlds, whichever process made them."""
    monkeypatch.setattr(run_module, "FIRST_WORLDS", 1)
    limits, digests = [], []
    for name in ("whole", "stopped"):
        bank = {"size": BATCH + 2, "turnover": 0.0, "cache": str(tmp_path / name / "worlds")}
        config = tiny("ppo", env={**PRIVY, "bank": bank}, threads=2)
        run = Run(config, 0, tmp_path / name)
        while not run.done:
            run.learn()
            limits.append(run.worlds.limit)
            if name == "stopped":  # and resumed
                run.close()
                run = Run(config, 0, tmp_path / name)
        digests.append(load_weights(tmp_path / name / POLICY).digest)
        run.close()
    assert limits == 2 * [1, 2, 4]
    assert digests[0] == digests[1]


@pytest.mark.long
def test_processes_share_the_drawing_of_worlds(tmp_path):
    reports, starts = [], []
    for threads, cache in ((2, str(tmp_path / "worlds")), (1, None)):
        bank = {"size": BATCH + 2, "turnover": 0.0, "cache": cache}
        config = tiny("ppo", env={**PRIVY, "bank": bank}, threads=threads)
        run = Run(config, 0, tmp_path / str(threads), lambda *now: reports.append(now))
        starts.append([run.worlds._made[n].episode.start for n in range(BATCH + 2)])
        run.close()
    assert np.array_equal(*starts)
    assert len(list(tmp_path.glob("worlds/*/*.joblib"))) == BATCH + 2
    assert reports[1] == (BATCH + 2, BATCH + 2)  # the first is of the batch that was ready first
    assert len(reports) == 2 + BATCH + 2


def test_imitation_comes_near_its_expert_and_warms_a_run(tmp_path):
    task = {key: value for key, value in ENV["task"].items() if key != "trail"}
    env, privy = {**ENV, "task": task}, {**ENV, "task": {**task, "privileged": True}}
    own = Imitation(
        expert="straight", env=env, episodes=4, rounds=2, n_epochs=40, net_arch=(16, 16)
    )
    told = imitate(own, 0, tmp_path, progress=False)
    assert told["driver"] == "student"
    first = json.loads((tmp_path / "rounds.json").read_text())[0]
    assert told["steps"] > first["steps"]
    assert told["loss"] < 0.05
    with pytest.raises(InputError, match="imitated weights"):
        publish(tmp_path, [], tmp_path / "mine.npz")
    file = str(tmp_path / POLICY)
    run = Run(tiny("ppo", env=privy, warm_start=file), 0, tmp_path / "warm")
    for name, array in actor_arrays(run.model, "ppo").items():
        assert np.array_equal(array, load_weights(file).arrays[name])
    run.close()
    with pytest.raises(InputError, match="warm_start: layers are"):
        Run(tiny("ppo", env=privy, warm_start=file, net_arch=[8]), 0, tmp_path / "other")


def test_a_teacher_tells_its_student_what_it_would_do_where_it_sees_the_way(trained):
    guided = load_weights(trained[1] / POLICY)
    env = {**PRIVY, "task": {**PRIVY["task"], "hide_guidance": True}}
    tasks = [
        NavigationVectorEnv(3, config=env_settings({**own, "starts_within": 0.0})).task
        for own in (PRIVY, env)
    ]
    shown, hidden = (
        Layout(tuple((key, box.shape[0]) for key, box in task.spaces.items()), True)
        for task in tasks
    )
    seen = np.random.default_rng(3).uniform(0.1, 3.0, (20, hidden.size)).astype(np.float32)
    told = np.zeros((20, shown.size), np.float32)
    for key, _ in shown.sizes:
        secret = hidden.slice_of(f"privileged_{key}")
        told[:, shown.slice_of(key)] = seen[:, secret if secret.stop else hidden.slice_of(key)]
    wanted, student = Network(guided)(told), env_settings({**env, "starts_within": 0.0})
    assert np.abs(wanted).max() > 0.01
    assert Teacher(guided, hidden, student)(torch.from_numpy(seen)).numpy() == pytest.approx(
        wanted, abs=1e-5
    )
    blind = Layout(tuple(pair for pair in hidden.sizes if pair[0] not in PRIVILEGED), True)
    with pytest.raises(InputError, match="teacher: it needs 20 numbers of path; observed are 0"):
        Teacher(guided, blind, student)
    with pytest.raises(InputError, match=r"teacher: its rate is 5\.0; expected 10\.0"):
        Teacher(guided, hidden, dataclasses.replace(student, rate=10.0))


def test_an_actor_imitates_its_teacher_with_a_weight_that_anneals(trained, tmp_path):
    env = {**PRIVY, "task": {**PRIVY["task"], "hide_guidance": True}}
    kickstarting = {"teacher": str(trained[1] / POLICY), "coefficient": 50.0, "duration": 0.8}
    changes = {"env": env, "frames": 1920, "evaluation": {"episodes": 0}}
    runs, weights = [], []
    for own in (kickstarting, {}):
        rates = {**ON, "learning_rate": 0.01}
        run = Run(
            tiny("ppo", **changes, on_policy=rates, kickstarting=own), 0, tmp_path / str(len(own))
        )
        while not run.done:
            run.learn()
            weights.append(run.model.policy.kickstart_weight)
        run.close()
        runs.append(run)
    full = 50.0 / runs[0].config.on_policy.ent_coef
    annealed = [full * max(0.0, 1.0 - k / 24) for k in range(30)]
    assert weights == pytest.approx([*annealed, *[0.0] * 30])
    buffer = runs[0].model.rollout_buffer
    seen = torch.from_numpy(buffer.observations.reshape(-1, buffer.obs_shape[0]))
    wanted = seen[:, -2:]
    with torch.no_grad():
        means = [r.model.policy.action_distribution(seen).distribution.mean for r in runs]
    near, far = (float(((mean - wanted) ** 2).mean()) for mean in means)
    assert near < 0.3 * far
    assert runs[0].weights({}).card["teacher"] == load_weights(trained[1] / POLICY).digest


@pytest.mark.parametrize("name", sorted(RECIPES))
def test_recipes_are_whole_runs(name):
    own = RECIPES[name]
    assert dataclasses.replace(own) == own
    assert own.env_settings().bank.turnover == 0.0  # each checkpoint begins episodes anew


def test_a_row_without_an_episode_that_ended_has_no_share_of_success():
    assert episode_row(Counter()) == {"episodes": 0}
    assert episode_row(Counter(episodes=2, success=1))["success"] == 0.5


def test_any_contact_of_an_evaluation_is_a_collision():
    """Of four rows: a light touch on the way, a success, a timeout, a contact in a next episode."""
    columns = "terminated", "truncated", "is_success", "bumped", "contact"
    steps = [
        dict(zip(columns, map(np.array, rows), strict=True))
        for rows in (
            ([0, 1, 0, 0], [0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]),
            ([1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]),
        )
    ]
    steps = [{name: row.astype(bool) for name, row in step.items()} for step in steps]
    env = MagicMock(num_envs=4)
    env.reset.return_value = {"pose": np.zeros((4, 3))}, {}
    env.step.side_effect = [
        (env.reset()[0], None, step["terminated"], step["truncated"],
         {**step, "final_info": {**step, "time": np.full(4, 7.0)}})
        for step in steps
    ]  # fmt: skip
    found = evaluate_network(env, lambda observations: None, 0)
    assert found == {"success": 0.25, "collision": 0.25, "timeout": 0.5, "time": 7.0}


def test_values_that_vary_are_taken_as_they_were_typed():
    assert varied("env.guidance=geodesic, my.ways:guide ,") == (
        "env.guidance", ["geodesic", "my.ways:guide"],
    )  # fmt: skip
    assert varied("env.task.trail=[], [1,2.5]") == ("env.task.trail", ["[]", "[1,2.5]"])
    assert varied("on_policy.learning_rate=1e-3,0.001") == (
        "on_policy.learning_rate",
        ["1e-3", "0.001"],
    )
    assert varied(None) == ("", [""])


@pytest.mark.parametrize(("ended", "code"), [((2, 0), 2), ((-9, 0), 137)])
def test_runs_beside_each_other_are_of_a_module_that_runs(tmp_path, monkeypatch, ended, code):
    """One that fails, or is killed, is no success. Each ends with the process that began it."""
    started = MagicMock()
    started.return_value.wait.side_effect = ended
    monkeypatch.setattr("subprocess.Popen", started)
    assert main(["train", "bc", "--seeds", "0,1", "--jobs", "2", "--out", str(tmp_path)]) == code
    for call in started.call_args_list:
        assert find_spec(f"{call.args[0][2]}.__main__")
    name, ends = "WHEELCHAIR_TRAIN_PARENT", MagicMock()
    monkeypatch.setenv(name, call.kwargs["env"][name])  # as in these runs
    monkeypatch.setattr("agents.cli.train.end_with", ends)
    monkeypatch.setattr("agents.learning.demonstrations.imitate", lambda *_, **__: {})
    main(["train", "bc", "--out", str(tmp_path)])
    assert until(lambda: ends.called)
    ends.assert_called_with(os.getpid())


def test_runs_that_differ_in_a_setting_are_told_side_by_side(tmp_path, capsys):
    own = put(tmp_path / "own.json", dump(tiny("ppo")))
    varied = ["train", "ppo", "--config", str(own), "--vary", "env.bank.size=1,2", "--quiet"]
    assert main([*varied, "--seeds", "0,1", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    short = "after 3.2 s of driving (16 steps at 5 Hz), and episodes may last 4 s and longer"
    assert said.err.count(short) == 1
    assert re.search(r"success in evaluation \d\.\d\d, in training .*\(.*episode", said.out)
    with (tmp_path / "out" / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["env.bank.size"], row["seed"]) for row in rows] == [
        ("1", "0"), ("1", "1"), ("2", "0"), ("2", "1"),
    ]  # fmt: skip
    for row in rows:
        curve = read_curve(
            tmp_path / "out" / f"size_{row['env.bank.size']}" / f"seed_{row['seed']}"
        )
        assert float(row["success"]) == float(curve[-1]["eval_success"])
        assert float(row["low"]) <= float(row["success"]) <= float(row["high"])
    assert (tmp_path / "out" / "sweep.svg").read_text().startswith("<?xml")


def test_rl_zoo_trains_the_same_id_with_settings_that_exist():
    """Keys of rl-zoo3's own apart, each is an argument of stable-baselines3's PPO."""
    content = yaml.safe_load((ROOT / "configs" / "rl_zoo3_ppo.yml").read_text())
    ((name, own),) = content.items()
    assert gym.spec(name).id == "wheelchair_gym/GuidedNavigation-v1"
    known = set(inspect.signature(PPO).parameters)
    assert set(own) - known == {"n_envs", "n_timesteps", "normalize", "callback"}
    assert own["callback"] == [{f"{SaveModel.__module__}.SaveModel": {"path": "runs/zoo.zip"}}]
