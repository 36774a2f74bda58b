"""Laws of many chairs at once: row i is the single env seeded with seed + i, bit for bit."""

import math
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest
import scipy.stats
from gymnasium.vector import AutoresetMode

import wheelchair_gym
from tests.conftest import ROOT, at_start
from tests.copies import differences
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv, world_banks
from wheelchair_gym.envs.batch import step_chairs
from wheelchair_gym.envs.guidance import PoseGuidance
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sim.randomization import RANDOMIZED

NEXT, SAME = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP
QUICK = {"scene": {"name": "clutter"}, "beams": 64, "bank": {"size": 6, "turnover": 0.5}}
SHORT = {"task": {"time_base": 4.0, "time_factor": 0.0}}  # episodes of at most 40 steps


def flat(info):
    """Flatten an info, including reward terms and a shield's decision."""
    nested = {name: value for name, value in info.items() if isinstance(value, dict)}
    return {
        **{name: value for name, value in info.items() if name not in nested},
        **{f"{name}.{key}": value for name, of in nested.items() for key, value in of.items()},
    }


def assert_same(row, n, batch, single):
    """Observation and info of one row of a batch are those of a single env."""
    (observations, infos), (observation, info) = batch, single
    for key, value in observation.items():
        assert value.dtype == observations[key].dtype == np.float32
        assert np.array_equal(value, observations[key][row]), key
    rows = flat(infos)
    for name, value in flat(info).items():
        assert np.array_equal(value, rows[name][row]), name
        assert rows[name].shape[0] == n


def compare(mode, threads, n, steps, seed=7, shared=False, **settings):
    """Drive a batch and single envs with the same actions; returns how many episodes ended.

    If `shared`, each world is made once for all.
    """
    settings.setdefault("split", "test")
    batch = NavigationVectorEnv(n, num_threads=threads, autoreset_mode=mode, **settings)
    singles = [NavigationEnv(**settings) for _ in range(n)]
    for env in singles if shared else ():
        env.worlds = batch.worlds
        env.worlds.drop_before = lambda episode: None
    rng = np.random.default_rng(seed)
    observations, infos = batch.reset(seed=seed)
    for i, env in enumerate(singles):
        assert_same(i, n, (observations, infos), env.reset(seed=seed + i))
    over = np.zeros(n, bool)
    ends = 0
    for _ in range(steps):
        actions = rng.uniform(-1.3, 1.3, (n, 2)).astype(np.float32)
        actions[:, 0] = np.abs(actions[:, 0])
        observations, rewards, terminated, truncated, infos = batch.step(actions)
        for i, env in enumerate(singles):
            if over[i]:  # NEXT_STEP: this step only began the next episode
                assert (rewards[i], terminated[i], truncated[i]) == (0.0, False, False)
                assert_same(i, n, (observations, infos), env.reset())
                over[i] = False
                continue
            observation, *outcome, info = env.step(actions[i])
            assert outcome == [rewards[i], terminated[i], truncated[i]]
            if not (terminated[i] or truncated[i]):
                assert_same(i, n, (observations, infos), (observation, info))
                continue
            ends += 1
            if mode is NEXT:
                assert_same(i, n, (observations, infos), (observation, info))
                over[i] = True
            else:
                assert infos["_final_obs"][i]
                assert infos["_final_info"][i]
                final = infos["final_obs"], infos["final_info"]
                assert_same(i, n, final, (observation, info))
                assert_same(i, n, (observations, infos), env.reset())
    batch.close()
    return ends


HALL = {"name": "crowd", "place": "hall", "people": {"density": (0.05, 0.1)}}
DEAR = SHORT["task"] | {"reward": {"shield_intervention": -0.3}, "shield_state": True}
SHIELDED = QUICK | {"scene": HALL, "shield": True, "config": {"task": DEAR}}
SHARES = {"density": (0.05, 0.15), "crossing_share": 0.3, "inattentive_share": 0.3}
CROWD = {"name": "crowd", "people": SHARES}
TRACKED = {"task": SHORT["task"] | {"tracks": 4}}
APPEAR = {"scene": {"name": "temporary", "count": (3, 6)}, "pose_source": "modelled",
          "guidance": "geodesic"}  # fmt: skip
FORCE = {"name": "people", "people": {"model": "social_force"}}
OWN = {"config": str(ROOT / "examples" / "own_robot.json"), "bank": 4, "max_episode_steps": 40}
EXPERT = {"beams": 32, "driver": "expert"}
BARE, DEAF = {"laser": {"beams": 0}}, {"ultrasonic": {"mounted": []}}
LATE = {"quantity": "command_delay", "distribution": "normal", "mean": 0.1, "std": 0.1}
AROUND = {"body.mass": (90.0, 150.0), "motor.gain": (0.9, 1.1), "motor.resistance": (0.8, 1.2)}
RANDOM = [
    {"quantity": name, "low": low, "high": high}
    for name in RANDOMIZED
    if name not in ("command_delay", "physics.slope", "laser.offset_error")
    for low, high in [AROUND.get(name, (0.0, 0.1))]
]
JOINT = {"quantities": ["physics.slope", "laser.offset_error"], "mean": [0.01, 0.02],
         "covariance": [[1e-4, 5e-5], [5e-5, 1e-4]]}  # fmt: skip
DRAWN = {"randomization": [*RANDOM, LATE], "joint": JOINT, "randomize": True}
ROWS = {  # threads, rows, periods, how many episodes end at least, and settings
    "one thread": (1, 6, 150, 20, QUICK),
    "two threads": (2, 6, 150, 20, QUICK),
    "a shield": (2, 4, 120, 8, SHIELDED),
    "half without it": (2, 4, 120, 8, SHIELDED | {"config": {"unshielded": 0.5, "task": DEAR}}),
    # Worlds with many actors, few and none in one batch, over thousands of steps and resets.
    "actors": (2, 6, 300, 25, QUICK | {"scene": CROWD, "config": TRACKED}),
    "things that appear": (2, 3, 80, 3, APPEAR),  # each episode has a world of its own
    "all people by orca": (2, 4, 120, 4, QUICK | {"scene": "people", "pose_source": "modelled"}),
    "all people by social force": (2, 4, 120, 4, QUICK | {"scene": FORCE}),
    "own chair": (2, 4, 90, 8, OWN),
    "own chair and a shield": (2, 4, 90, 8, OWN | {"shield": True}),
    "docking": (2, 3, 60, 3, EXPERT | {"scene": {"name": "skill", "course": "dock"}}),
    "people to pass": (2, 3, 60, 3, EXPERT | {"scene": {"name": "skill", "course": "people"}}),
    "no laser": (1, 3, 90, 3, QUICK | {"config": SHORT | {"sensors": BARE}}),
    "odometry only": (1, 3, 90, 3, QUICK | {"config": SHORT | {"sensors": BARE | DEAF}}),
    "all that can be drawn": (2, 4, 90, 6, QUICK | {"config": SHORT | {"chair": DRAWN}}),
}


@pytest.mark.parametrize("mode", [NEXT, SAME])
@pytest.mark.parametrize("name", ROWS)
def test_each_row_is_a_single_env(name, mode):
    threads, n, steps, ends, settings = ROWS[name]
    settings = {"config": SHORT, "randomize": True} | settings
    assert compare(mode, threads, n=n, steps=steps, **settings) >= ends


PARTS = {
    "array": lambda array: array,
    "part": lambda array: array[1:],
    "part of a part": lambda array: array[1:][:, None][::-1],
    "element": lambda array: array[:1].reshape(-1)[:1],
    "bytes": lambda array: memoryview(array),
    "base": lambda array: array.base[:],
}


@pytest.mark.parametrize("mode", [NEXT, SAME])
@pytest.mark.parametrize("part", PARTS)
def test_a_held_part_keeps_its_values(part, mode):
    """One array of many is kept, or what refers to it, for a random while."""
    env = NavigationVectorEnv(3, config=SHORT, autoreset_mode=mode, shield=True, **QUICK)
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    kept = []
    for _ in range(150):
        observations, rewards, *ends, infos = env.step(rng.uniform(-1, 1, (3, 2)))
        assert env.observation_space.contains(observations)
        given = [*observations.values(), rewards, *ends, *flat(infos).values()]
        given += flat(infos.pop("final_info", {})).values()
        given = [a for a in given if isinstance(a, np.ndarray) and a.dtype.kind != "U"]
        array = given[rng.integers(len(given))]
        if part != "base" or array.base is not None:
            held = PARTS[part](array)
            kept.append((held, np.array(held, copy=True)))
            assert part == "array" or held is not array
        del observations, rewards, ends, infos, given, array
        if len(kept) > rng.integers(8):
            held, copied = kept.pop(rng.integers(len(kept)))
            assert np.array_equal(held, copied)
            del held
    for held, copied in kept:
        assert np.array_equal(held, copied)


def test_memory_that_nobody_holds_is_used_again():
    env = at_start(NavigationVectorEnv(2, config=SHORT, autoreset_mode=SAME, **QUICK))
    seen, ended = set(), 0
    for _ in range(90):
        observations, *_, infos = env.step(np.full((2, 2), 0.4))
        ended += "final_info" in infos
        seen.add(observations["laser"].ctypes.data)
    assert ended >= 2
    assert len(seen) == 2
    kept = [env.step(np.zeros((2, 2)))[0]["laser"] for _ in range(40)]
    assert len({array.ctypes.data for array in kept}) == 40


def test_actions_of_any_kind_are_taken_by_the_same_compiled_function():
    env = at_start(NavigationVectorEnv(2, **QUICK))
    env.step(np.zeros((2, 2)))
    compiled = len(step_chairs.signatures)
    frozen = np.full((2, 2), 0.1)
    frozen.flags.writeable = False
    for actions in (frozen, frozen.T, frozen.astype(">f4"), [[0, 1], [1, 0]], frozen[::-1] > 0):
        env.step(actions)
    assert len(step_chairs.signatures) == compiled
    env.step(np.full((2, 2), 1.7e308))  # finite, though their sum is not


def test_refused_actions_change_nothing():
    envs = [NavigationVectorEnv(4, config=SHORT, num_threads=2, **QUICK) for _ in range(2)]
    for env in envs:
        env.reset(seed=3)
    wrong = np.zeros((4, 2))
    for k in range(8):
        wrong[k % 4, k % 2] = (np.nan, np.inf)[k % 2]
        with pytest.raises(InputError, match="expected finite"):
            envs[0].step(wrong)
        assert not list(differences(*(env.step(np.full((4, 2), 0.3)) for env in envs)))


def test_a_mask_begins_some_rows_and_leaves_the_others():
    whole, part = (NavigationVectorEnv(4, config=SHORT, **QUICK) for _ in range(2))
    actions = np.full((4, 2), 0.3)
    for env in (whole, part):
        env.reset(seed=3)
        for _ in range(5):
            env.step(actions)
    mask = np.array([True, False, True, False])
    observations, _ = part.reset(options={"reset_mask": mask})
    after = part.step(actions)[0]["laser"]
    expected = whole.step(actions)[0]["laser"]
    assert np.array_equal(after[~mask], expected[~mask])
    assert not np.array_equal(after[mask], expected[mask])
    single = at_start(NavigationEnv(config=SHORT, **QUICK), 5)
    observation, _ = single.reset()  # the next episode of row 2
    assert np.array_equal(observation["laser"], observations["laser"][2])


@pytest.mark.parametrize("single", [True, False])
def test_seeds_that_are_told_begin_the_same_episodes_again(single):
    """After any reset, `np_random_seed` and `info` tell how to get there again."""
    own = [{}, {"seed": 7}, {"seed": np.int64(2**63 - 4)}]
    rows = [{"seed": [None, 5, None]}, {"seed": [np.int64(3), None, 2**62]}, {"seed": np.arange(3)}]
    for given in own + own[:1] if single else own + rows:
        env = NavigationEnv(**QUICK) if single else NavigationVectorEnv(3, **QUICK)
        observations, info = env.reset(**given)
        assert not np.any(info["is_success"])  # nobody begins in a world that does not exist
        assert (np.ravel(info["geodesic"]) > 0.5).all()
        assert np.ravel(info["seed"]).tolist() == np.ravel(env.np_random_seed).tolist()
        assert np.ravel(info["episode_number"]).tolist() == [0] * np.size(info["seed"])
        again, _ = env.reset(seed=env.np_random_seed)
        assert not list(differences(observations, again))
        for row, seed in enumerate(np.ravel(info["seed"]).tolist()):
            alone, _ = NavigationEnv(**QUICK).reset(seed=seed)
            for key, value in alone.items():
                assert np.array_equal(value, observations[key] if single else again[key][row])


def test_rows_without_a_seed_go_on():
    envs = [NavigationVectorEnv(2, **QUICK) for _ in range(2)]
    for env, seeds in zip(envs, ([4, 9], [None, 9]), strict=True):
        env.reset(seed=[4, 5])
        _, info = env.reset(seed=seeds)
        assert info["seed"].tolist() == [4, 9]
        assert info["episode_number"].tolist() == [int(seeds[0] is None), 0]


@pytest.mark.parametrize("mode", [NEXT, SAME])
def test_no_kernel_gets_a_record_that_nobody_filled(mode):
    """A row whose next world could not be drawn is not driven in another one."""
    env = at_start(NavigationVectorEnv(2, **QUICK, max_episode_steps=2, autoreset_mode=mode), 3)
    make, ahead = env.worlds.episode, np.full((2, 2), 0.1)
    env.worlds.episode = Mock(side_effect=InputError("no world fits"))

    def drive():
        for _ in range(3):
            env.step(ahead)

    with pytest.raises(InputError, match="no world fits"):
        drive()
    with pytest.raises(gym.error.ResetNeeded, match=r"rows \[0, 1\] have no next episode"):
        env.step(ahead)
    with pytest.raises(InputError, match="no world fits"):
        env.reset()
    env.worlds.episode = make
    _, infos = env.reset()
    assert infos["episode_number"].tolist() == [2, 2]


def test_a_bank_shares_its_worlds_and_turns_over():
    task = {"scene": "clutter", "beams": 16, "config": SHORT}
    env = NavigationEnv(bank={"size": 3, "turnover": 0.5, "seed": 1}, **task)
    seen = []
    for episode in range(40):
        env.reset(seed=0 if episode == 0 else None)
        seen.append(env.episode.discs.tobytes())
        assert len(env.worlds) <= 3
    assert 10 <= len(set(seen)) <= 23  # of 40 episodes; the window has moved by 20
    other = at_start(NavigationEnv(bank={"size": 3, "turnover": 0.5, "seed": 2}, **task))
    assert other.episode.discs.tobytes() not in seen
    still = NavigationEnv(bank={"size": 3, "turnover": 0.0, "seed": 1}, **task)
    few = set()
    for seed in range(40):
        still.reset(seed=seed)
        few.add(still.episode.discs.tobytes())
    assert len(few) == 3


def test_a_bank_kept_in_a_folder_is_the_same_and_is_not_made_again(tmp_path, monkeypatch):
    bank = {"size": 3, "turnover": 1.0, "cache": str(tmp_path)}
    settings = {**QUICK, "guidance": "geodesic", "bank": bank}

    def drive(**settings):
        env = NavigationVectorEnv(2, config=SHORT, **settings)
        results = [env.reset(seed=0)[0]]
        results += [env.step(np.full((2, 2), 0.4))[0] for _ in range(90)]
        return np.array([np.hstack([o[k] for k in sorted(o)]) for o in results])

    fresh = drive(**settings)
    files = sorted(tmp_path.rglob("*.joblib"))
    assert len(files) >= 3
    made = []
    monkeypatch.setattr(world_banks.WorldBank, "_make", lambda self, entropy: made.append(entropy))
    assert np.array_equal(drive(**settings), fresh)
    assert made == []
    monkeypatch.undo()
    plain = {**settings, "bank": {**bank, "cache": None}}
    assert np.array_equal(drive(**plain), fresh)
    other = {**settings, "scene": {"name": "clutter", "length": 13.0}}
    drive(**other)
    assert len({path.parent for path in tmp_path.rglob("*.joblib")}) == 2
    with pytest.raises(wheelchair_gym.InputError, match=r"bank.cache needs a scene and a guidance"):
        NavigationEnv(**{**settings, "guidance": lambda task: np.zeros((2, 2))})
    for named in ({"scene": make_scene("clutter")}, {"guidance": PoseGuidance()}):
        with pytest.raises(InputError, match=r"that are given by name"):  # not told by settings
            NavigationEnv(**{**settings, **named}).worlds.missing()


@pytest.mark.parametrize(
    ("task", "others"),
    [({"reward": {"bumped": -9.0}}, False), ({"beams": 9}, False), ({"margin": 0.2}, True)],
)
def test_what_is_seen_and_rewarded_leaves_kept_worlds_as_they_are(task, others, tmp_path):
    for own in ({}, task):
        bank = {"size": 1, "cache": str(tmp_path)}
        config = {**SHORT, "task": {**SHORT["task"], **own}}
        NavigationVectorEnv(1, config=config, **{**QUICK, "bank": bank}).reset(seed=0)
    assert len(list(tmp_path.iterdir())) == 1 + others


def test_wrong_actions_and_seeds_are_refused():
    env = NavigationVectorEnv(2, **QUICK)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros((2, 2)))
    single = -1, 2**63, 2**63 - 1, 1.0, True, "12", {1, 2}, np.array(1)
    rows = [1], [1, 2, 3], [-1, 2], [2, 1.5], [np.ones(1), 2], [[1], [2]], np.array([-1, 3])
    for seed in (*single, *rows):
        with pytest.raises(wheelchair_gym.InputError, match=r"seed"):
            env.reset(seed=seed)
    env.reset(seed=[4, 2])
    words, ragged, complex_ = np.full((2, 2), "0.5"), [[0.0, 1.0], [0.0]], np.full((2, 2), 1j)
    for wrong in (np.zeros(2), np.zeros((3, 2)), np.full((2, 2), np.nan), words, ragged, complex_):
        with pytest.raises(wheelchair_gym.InputError, match=r"expected finite \(2, 2\)"):
            env.step(wrong)


@pytest.mark.long
@pytest.mark.parametrize("mode", [NEXT, SAME])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_million_steps_in_all_are_those_of_single_envs(mode, threads):
    """A quarter of a million in each case: floor plans, all noise, a bank that turns over."""
    settings = {
        "config": {"task": {"time_base": 20.0, "time_factor": 0.0}},
        "bank": {"size": 64, "turnover": 1.0},
        "beams": 181,
        "pose_source": "modelled",
        "guidance": "geodesic",
        "randomize": True,
    }
    assert compare(mode, threads, n=50, steps=5_000, seed=11, shared=True, **settings) >= 1000


def test_rows_that_are_over_wait_for_their_reset_where_autoreset_is_disabled():
    envs = NavigationVectorEnv(
        3, scene="clutter", beams=16, max_episode_steps=2, autoreset_mode="Disabled"
    )
    envs.reset(seed=0)
    ahead = np.full((3, 2), 0.3)
    assert not envs.step(ahead)[3].any()
    assert envs.step(ahead)[3].all()
    with pytest.raises(gym.error.ResetNeeded, match=r"rows \[0, 1, 2\]"):
        envs.step(ahead)
    mask = np.array([True, False, True])
    envs.reset(options={"reset_mask": mask})
    with pytest.raises(gym.error.ResetNeeded, match=r"rows \[1\]"):
        envs.step(ahead)
    envs.reset(options={"reset_mask": ~mask})
    assert not envs.step(ahead)[3].any()


def test_a_limit_of_steps_is_that_of_gymnasium():
    short = {"scene": "clutter", "beams": 16, "max_episode_steps": 5}
    many = gym.make_vec("wheelchair_gym/Navigation-v1", 2, **short)
    wrapped = gym.make("wheelchair_gym/Navigation-v1", **short)
    ours = NavigationEnv(**short)
    many.reset(seed=0)
    wrapped.reset(seed=1)
    ours.reset(seed=1)
    for step in range(1, 6):
        action = np.array([0.4, -0.1], np.float32)
        rows = [many.step(np.tile(action, (2, 1))), wrapped.step(action), ours.step(action)]
        rewards = [rows[0][1][1], rows[1][1], rows[2][1]]
        ended = [bool(rows[0][3][1]), rows[1][3], rows[2][3]]
        assert len(set(rewards)) == 1
        assert ended == [step == 5] * 3


def test_rows_draw_worlds_by_weights():
    """Each world as often as its weight says, by the seed alone; scenes of a mixture likewise."""
    scene = {"name": "mixture", "scenes": ["empty", "clutter"], "weights": [3.0, 1.0]}
    env = NavigationVectorEnv(2, scene=scene, beams=8, bank={"size": 32, "turnover": 0.0})
    scenes, worlds = env.worlds.scenes, env.worlds
    assert [len(worlds.episode(0, 0, j).episode.discs) > 0 for j in range(32)] == scenes.tolist()
    assert 0 < np.count_nonzero(scenes) < 16
    share = np.array([0.2, 0.8])  # of the scenes, in place of those of the mixture
    weights = share[scenes] / np.bincount(scenes)[scenes]
    drawn = np.array([worlds.draw(7, k, np.cumsum(weights)) for k in range(4000)])
    assert scipy.stats.binomtest(int((scenes[drawn] == 1).sum()), 4000, 0.8).pvalue > 1e-3
    assert scipy.stats.chisquare(np.bincount(drawn, minlength=32), 4000 * weights).pvalue > 1e-3
    env.reset(seed=7)
    for wrong in ([1.0] * 31, [0.0] * 32, [-1] + [1] * 31, [math.nan] * 32, ["a"] * 32, 1.0):
        with pytest.raises(InputError, match="expected one of 0 or more for each of 32"):
            env.set_next([0], weights=wrong)
    only = (np.arange(32) == 9).astype(int)
    env.set_next([1], weights=only)
    for _ in range(2):
        _, info = env.reset()
        assert info["level"].tolist() == [worlds.draw(7, int(info["episode_number"][0])), 9]


def test_every_row_has_a_picture_and_shares_its_attributes():
    size = {"render_width": 120, "render_height": 80}
    envs = NavigationVectorEnv(2, scene="crowd", beams=16, render_mode="rgb_array", **size)
    envs.reset(seed=0)
    before = envs.render()
    for _ in range(10):
        envs.step(np.full((2, 2), 0.5))
    after = envs.render()
    assert [picture.shape for picture in after] == [(80, 120, 3)] * 2
    assert all((a != b).any() for a, b in zip(before, after, strict=True))
    assert envs.get_attr("num_envs") == envs.call("num_envs") == (2, 2)
    envs.set_attr("num_threads", [1, 1])
    assert envs.num_threads == 1
    with pytest.raises(InputError, match="one value for all"):
        envs.set_attr("num_threads", [1, 2])
    with pytest.raises(InputError, match="no attribute 'absent'"):
        envs.set_attr("absent", 1)


def test_worlds_and_starts_are_chosen_by_row():
    """A chosen world is the bank's, for any seed; info tells it; other rows are as before."""
    told = {"scene": "clutter", "beams": 8, "bank": 4, "guidance": "poses", "max_episode_steps": 5}
    env, other = (NavigationVectorEnv(3, autoreset_mode="SameStep", **told) for _ in range(2))
    _, info = env.reset(seed=5, options={"episodes": [2, None, 0]})
    _, drawn = other.reset(seed=5)
    assert info["level"].tolist() == [2, drawn["level"][1], 0]
    assert drawn["level"].tolist() == [other.worlds.draw(5 + i, 0) for i in range(3)]
    assert np.array_equal(info["pose"][1], drawn["pose"][1])
    assert np.array_equal(env.chairs.episodes[0].walls, env.worlds.episode(9, 0, 2).episode.walls)
    own = make_scene("empty").sample(np.random.default_rng(0))
    env.set_next([0, 1, 2], [3, own, None], [0.0, 0.0, 2.0])
    for _ in range(6):
        (_, _, _, _, info), (_, _, _, _, drawn) = (e.step(np.zeros((3, 2))) for e in (env, other))
    assert info["level"].tolist() == [3, -1, drawn["level"][2]]
    assert env.chairs.episodes[1] is own
    env.set_next([2], [1])  # with a start of its own
    prepared = env._next[2]
    assert 1.0 <= prepared.cost_to_go.time_to_goal(prepared.episode.start) <= 2.0
    env.set_next([0, 1], [3, None])
    _, info = env.reset(seed=8)  # keeps what was chosen, once
    assert info["level"].tolist() == [3, env.worlds.draw(9, 0), 1]
    _, info = env.reset(seed=8)
    assert info["level"].tolist() == [env.worlds.draw(8 + i, 0) for i in range(3)]
    for call, why in (
        (lambda: env.set_next([3], [0]), "expected 0 to 2"),
        *(
            (lambda rows=rows: env.set_next(rows), "rows .*expected 0 to 2, integers, each once")
            for rows in ([True, False, True], np.ones(3, bool), [0, 2.9], [1, 1], [2**63], "01")
        ),
        (lambda: env.set_next(1), "expected a list of each"),
        (lambda: env.set_next([0], [True]), "world True: expected a bank"),
        (lambda: env.set_next([0], [2**63]), "expected a bank, and a number from 0"),
        (lambda: env.reset(options={"episodes": 5}), "expected a list of each"),
        (lambda: env.set_next([0], [0, 1]), "2 worlds were given for 1 rows"),
        (lambda: env.set_next([0], [-1]), "expected a bank, and a number from 0"),
        (lambda: env.set_next([0], starts_within=-1.0), "expected at least 0"),
        (lambda: env.set_next([0, 1], starts_within=[1.0, 2.0, 3.0]), "as many as rows"),
        (lambda: env.set_next([0], weights=[1.0] * 4), "and bank.turnover 0"),
        (lambda: env.reset(seed=7, options={"episodes": [0, 1, "x"]}), "expected a number"),
    ):
        before, planned = env.np_random_seed, list(env._next)
        with pytest.raises(InputError, match=why):
            call()
        assert (env.np_random_seed, env._next) == (before, planned)  # nothing has changed


CROWDED = QUICK | {"scene": CROWD, "split": "test"}


def test_worlds_with_and_without_movers_share_a_batch():
    """A batch row that goes from a crowd to an empty floor and back is as fresh."""
    crowd = at_start(NavigationEnv(config=SHORT, **CROWDED), 3)
    episode = crowd.episode
    plain = type(episode)(episode.map, episode.start, episode.goal, episode.walls, episode.discs)
    seen = []
    for given in (episode, plain, episode, plain):
        crowd.reset(seed=5, options={"episode": given})
        seen.append(np.array([crowd.step(np.array([0.6, 0.1]))[0]["laser"] for _ in range(20)]))
    assert np.array_equal(seen[0], seen[2])
    assert np.array_equal(seen[1], seen[3])
    assert not np.array_equal(seen[0], seen[1])


def test_a_narrow_world_is_the_same_given_as_drawn():
    narrow = {"scene": {"name": "doorway", "door_width": 0.65}, "split": "test"}
    drawn, given = NavigationEnv(**narrow), NavigationEnv(**narrow)
    drawn.reset(seed=0)
    given.reset(options={"episode": drawn.episode})
    assert given.task.time_limit == drawn.task.time_limit
    guidance = Mock(side_effect=lambda task: np.stack([task.start, task.goal]), poses=False)
    NavigationEnv(**narrow, guidance=guidance).reset(seed=0)
    guidance.assert_called_once()  # with the radius that passes
    rows = at_start(NavigationVectorEnv(1, **narrow), 1)
    rows.set_next([0], [drawn.episode])
    assert rows._next[0].geodesic.at(drawn.episode.start[:2]) < np.inf


def test_truth_reaches_info_and_never_the_observation():
    env = NavigationEnv(config={"task": {"time_base": 60.0}}, **CROWDED)
    observation, info = env.reset(seed=1)
    assert set(observation) == {"laser", "ultrasonic", "twist", "goal"}
    told = [
        info[name]
        for name in ("at_fault", "contact_with", "approach_speed", "other_approach_speed")
    ]
    assert told == [False, -1, 0.0, 0.0]
    assert env.chair.truth.actor_poses.shape == (len(env.episode.actors), 3)
    batch = NavigationVectorEnv(2, config=SHORT, **CROWDED)
    _, infos = batch.reset(seed=1)
    assert infos["approach_speed"].shape == infos["other_approach_speed"].shape == (2,)
    assert infos["contact_with"].tolist() == [-1, -1]
