"""Learned assistants: a network observes and adds as in training, for every driver."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from agents.cli import main
from agents.learning import weights as learned
from agents.learning.settings import RECIPES
from agents.people import make_assistant
from agents.policies import GymPolicy, make_policy
from agents.policies.learned import weights_digest
from tests.benchmarks.assisted_drives import Helpers
from tests.conftest import output_of, put
from tests.copies import differences
from tests.laws.test_policies import driven
from wheelchair_gym.base.files import file_digest
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.people.drivers import DRIVERS

RESIDUAL = RECIPES["residual"]
HELD_OUT = {"ataxia", "hemineglect", "head_array", "bci", "scanning", "blind", "hostile"}


def settings_of(**changes):
    env = replace(RESIDUAL.env_settings(), scene="clutter", **changes)
    return replace(env, bank=replace(env.bank, size=2, cache=None))


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """Weights of a network that adds at random; an assistant that drives has to have some."""
    env = NavigationEnv(config=settings_of(), split="test")
    layout, rng = learned.Layout.of_task(env.task), np.random.default_rng(1)
    arrays = {
        "dense0.w": rng.normal(0.0, 0.1, (16, layout.actor_size)),
        "dense0.b": np.zeros(16),
        "dense1.w": rng.normal(0.0, 0.2, (2, 16)),
        "dense1.b": np.zeros(2),
    }
    card = learned.make_card("ppo", "clip", layout, env.settings, RESIDUAL, 0, limits="none")
    path = tmp_path_factory.mktemp("weights") / "policy.npz"
    learned.save_weights(
        path, learned.Weights({k: v.astype(np.float32) for k, v in arrays.items()}, card)
    )
    return str(path)


def test_a_drive_is_that_of_the_training_environment(weights):
    """There the environment holds the base and the network gives residuals: equal to the bit."""
    trained = NavigationEnv(config=settings_of(), split="test")
    public = replace(trained.settings.task, privileged=False)
    other = NavigationEnv(config=settings_of(assistant=None, task=public), split="test")
    network = learned.Network(learned.load_weights(weights))
    policy = GymPolicy(make_policy({"name": "assisted", "assist": weights}), other)
    interfaces, maximum = set(), 0.0
    for seed in range(4):
        ours, theirs = trained.reset(seed=seed), other.reset(seed=seed)
        policy.reset()
        interfaces.add(trained.drivers.driver.interface.kind)
        for _ in range(60):
            flat = np.concatenate([ours[0][key] for key in trained.task.spaces])
            residual = network(flat[None])[0]
            maximum = max(maximum, float(np.abs(residual).max()))
            ours, theirs = trained.step(residual), other.step(policy.act(theirs[0]))
            assert ours[-1]["pose"].tolist() == theirs[-1]["pose"].tolist()
            assert trained.reading.action == other.reading.action
            public_keys = {key: ours[0][key] for key in theirs[0]}
            assert not list(differences(public_keys, theirs[0]))
    assert len(interfaces) > 1
    assert maximum > 0.1


def test_a_batch_is_driven_as_by_the_network_in_it(weights):
    def poses(by_network):
        # With a stick: one of few signals may change by the rounding of what is observed.
        config = settings_of(driver="essential_tremor")
        if not by_network:  # it sees all beams
            config = replace(config, assistant=None, task=replace(config.task, beams=1081))
        env = NavigationVectorEnv(3, num_threads=1, config=config, split="test")
        network = learned.Network(learned.load_weights(weights))
        helpers, begin, found = Helpers(weights, env), np.ones(3, bool), []
        seen, info = env.reset(seed=0)
        for _ in range(60):
            inside = network(np.concatenate(list(seen.values()), axis=1))
            acts = inside if by_network else helpers.actions(seen, info, begin)
            seen, _, terminated, truncated, info = env.step(acts)
            assert not (terminated | truncated).any()
            begin = np.zeros(3, bool)
            found.append(info["pose"].copy())
        env.close()
        return np.array(found)

    np.testing.assert_allclose(poses(True), poses(False), rtol=0.0, atol=2e-3)


def test_it_acts_as_often_as_in_training_and_lets_go_at_once(weights):
    env = NavigationEnv("clutter", driver="expert", rate=50.0, shield=True, split="test")
    policy = make_policy({"name": "assisted", "assist": weights})
    env.reset(seed=1)
    policy.reset(env.mission)
    decisions = 0
    before = None
    for _ in range(100):
        policy.act(env.reading)
        now = policy._assistant.observation
        decisions += now is not before
        before = now
        env.step(np.zeros(2))
    assert decisions == 10
    slow = NavigationEnv("clutter", driver="expert", rate=12.5, shield=True, split="test")
    slow.reset(seed=1)
    with pytest.raises(InputError, match="acts at 5 Hz"):
        make_policy({"name": "assisted", "assist": weights}).reset(slow.mission)
    assert make_assistant(weights).freedom.backward == 0.045


def test_an_exported_assistant_answers_as_its_weights_do(weights, tmp_path):
    pytest.importorskip("onnx", reason="pip install 'wheelchair_gym[learn]'")
    pytest.importorskip("onnxruntime", reason="pip install 'wheelchair_gym[learn]'")
    file = str(tmp_path / "assistant.onnx")
    assert main(["export", weights, "--onnx", file]) == 0
    own, exported = (make_policy({"name": "assisted", "assist": it}) for it in (weights, file))
    env = NavigationEnv("clutter", driver="expert", rate=5.0, shield=True, split="test")
    mission, readings, commands = driven(own, env, 20)
    exported.reset(mission)
    answers = [command.as_action(mission.limits) for command in commands]
    others = [exported.act(reading).as_action(mission.limits) for reading in readings]
    assert len(answers) == 20
    np.testing.assert_allclose(answers, others, rtol=0.0, atol=1e-5)
    assert np.ptp(answers) > 0.1


def test_weights_of_an_assistant_are_no_policy(weights):
    with pytest.raises(InputError, match="--driver NAME --assist"):
        make_policy(weights)


def test_other_weights_are_another_policy(weights):
    """A comparison that goes on does not mix drives of a file before and after training."""
    digest = file_digest(Path(weights))
    for assist in (weights, {"name": "residual", "weights": weights}):
        assert weights_digest({"name": "assisted", "assist": assist}) == digest
    residual = file_digest(learned.shipped(learned.SHIPPED_ASSISTANTS)["residual"])
    assert weights_digest({"name": "assisted", "assist": "residual"}) == residual
    assert weights_digest({"name": "assisted", "assist": "slide"}) is None


def test_one_of_several_people_is_recorded(tmp_path, capsys):
    config = put(tmp_path / "env.json", {"driver": ["scanning", "novice"]})
    file = str(tmp_path / "run.mcap")
    common = ["simulate", "--scene", "clutter", "--config", str(config), "--policy", "assisted"]
    assert main([*common, "--seed", "1", "--record", file]) == 0
    assert "the same rewards" in output_of(["replay", file], capsys)


def test_people_that_are_held_out_never_drive_in_training():
    for name in ("residual", "ppo_assist"):
        people = set(RECIPES[name].env_settings().driver)
        assert people == set(DRIVERS.built_in) - HELD_OUT
    for path in learned.shipped(learned.SHIPPED_ASSISTANTS).values():
        assert not HELD_OUT & set(learned.load_weights(path).card["env"]["driver"])


def test_a_person_drives_with_a_file_of_weights(weights, tmp_path):
    common = ["--driver", "novice", "--assist", weights]
    for words in (common, common[:2]):  # and with the assistant that is used where none is named
        assert main(["simulate", "--scene", "clutter", *words]) == 0
    where = ["--scenes", "clutter", "--episodes", "1", "--jobs", "1", "--quiet", "--no-video"]
    assert main(["compare", *common, *where, "--out", str(tmp_path / "c")]) == 0
    rows = json.loads((tmp_path / "c" / "results.json").read_text())["summary"]
    assert {row["policy"] for row in rows} == {weights}
