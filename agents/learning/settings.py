"""Settings of a training run: one file is the whole run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from wheelchair_gym.config import InputError, dump, load, setting, settings
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.errors import shown

Algorithm = Literal["ppo", "recurrent_ppo", "sac", "td3", "tqc"]
ON_POLICY = ("ppo", "recurrent_ppo")


@settings
class OnPolicy:
    """Proximal policy optimisation (Schulman et al. 2017), and its recurrent kin."""

    steps: int = setting(default=64, source="of each environment between updates", low=2)
    batch: int = setting(default=4096, source="the quickest on a processor", low=2)
    epochs: int = setting(default=2, source="over what was gathered", low=1)
    rate: float = setting(default=1e-3, source="of learning; falls to 0 in a line", low=0.0)
    discount: float = setting(default=0.99, source="per step", low=0.0, high=1.0)
    trace: float = setting(
        default=0.95, source="lambda of the advantage's estimate", low=0.0, high=1.0
    )
    clip: float = setting(default=0.2, source="Schulman et al. 2017", low=0.0)
    entropy: float = setting(default=0.002, source="its weight; tuned", low=0.0)
    log_deviation: float = setting(default=-0.5, source="of actions, at first; tuned")
    critic: float = setting(default=0.5, source="weight of the critic's loss", low=0.0)
    gradient: float = setting(default=0.5, source="largest norm", low=0.0)
    memory: int = setting(default=128, source="units of the recurrent layer", low=1)


@settings
class OffPolicy:
    """Soft actor-critic, TD3, truncated quantile critics: what was seen is learned from again."""

    buffer: int = setting(default=500_000, source="steps kept", low=100)
    batch: int = setting(default=1024, source="steps replayed at a time", low=2)
    begin: int = setting(default=20_000, source="steps at random before anything is learned", low=0)
    updates: int = setting(default=4, source="for each step of all environments; tuned", low=1)
    rate: float = setting(default=1e-3, source="of learning; falls to 0 in a line", low=0.0)
    discount: float = setting(default=0.99, source="per step", low=0.0, high=1.0)
    follow: float = setting(
        default=0.01, source="of targets; half or twice: alike", low=0.0, high=1.0
    )
    noise: float = setting(default=0.1, source="of TD3's actions, sigma", low=0.0)


@settings
class Curriculum:
    """Starts that move away from the goal as the chair learns; needs the guidance 'poses'."""

    begin: float = setting(default=12.0, unit="s", source="of plan time; 0: none", low=0.0)
    factor: float = setting(default=1.15, source="farther by", low=1.0)
    above: float = setting(default=0.75, source="share of success", low=0.0, high=1.0)
    episodes: int = setting(default=1024, source="that it is judged by", low=1)
    most: float = setting(default=120.0, unit="s", source="longer than plans are", low=0.0)


@settings
class Trials:
    """Evaluation on worlds that training never sees, always the same ones, without noise added."""

    episodes: int = setting(default=128, source="0: none", low=0)
    every: int = setting(default=2, source="checkpoints", low=1)
    seed: int = setting(default=1_000_003, source="of the worlds, apart from training's", low=0)


@settings
class Teaching:
    """A trained policy that ppo's actor is drawn to at first (kickstarting: Schmitt et al. 2018).

    It is told what the actor does not see: `env.task.unguided` hides the way from the actor alone.
    """

    teacher: str | None = setting(default=None, source="its weights: a file or name; none")
    weight: float = setting(default=4.0, source="of the squared distance, at first", low=0.0)
    until: float = setting(
        default=0.6,
        source="share of the frames; the weight falls to 0 in a line",
        low=0.01,
        high=1.0,
    )


@settings
class Training:
    """A whole training run."""

    algorithm: Algorithm = setting(default="ppo", source="the best of them here")
    env: Any = setting(default=None, source="as a file of --config of simulate")
    envs: int = setting(default=512, source="at once", low=1)
    frames: int = setting(default=24_000_000, source="control periods in all", low=1)
    checkpoint: int = setting(
        default=10, source="updates between two; all environments begin anew at each", low=1
    )
    hidden: tuple[int, ...] = setting(default=(256, 256), source="units of each layer", low=1)
    threads: int = setting(default=2, source="of torch and of the environments", low=1)
    warm_start: str | None = setting(default=None, source="weights to begin with: a file or name")
    on_policy: OnPolicy = OnPolicy()
    off_policy: OffPolicy = OffPolicy()
    teaching: Teaching = Teaching()
    curriculum: Curriculum = Curriculum()
    trials: Trials = Trials()

    def __post_init__(self) -> None:
        made = self.env_settings()
        if made.task.privileged and self.algorithm != "ppo":
            raise InputError(f"env.task.privileged is for ppo's critic, not for {self.algorithm}")
        taught = self.teaching.teacher is not None
        if taught and (self.algorithm != "ppo" or self.on_policy.entropy == 0.0):
            raise InputError("teaching.teacher is for ppo, with on_policy.entropy above 0")
        if self.curriculum.begin > 0.0 and not posed(made):
            raise InputError("curriculum.begin needs env.guidance 'poses', or 0")

    def env_settings(self) -> EnvSettings:
        """The settings of the environments."""
        return environment(self.env)


def environment(spec: Any) -> EnvSettings:
    """Settings of an environment; of None, those of `ppo_guided` without what only its critic sees.

    Raises:
        InputError: a setting is wrong.
    """
    if isinstance(spec, EnvSettings):
        return spec
    return load(EnvSettings, _env(True, False) if spec is None else spec, "env")


def posed(env: EnvSettings) -> bool:
    """Whether an environment knows the ways of the outline."""
    spec = env.guidance
    return (spec.get("call") if isinstance(spec, Mapping) else spec) == "poses"


_WORLDS = {
    "name": "mixture",
    "scenes": [
        {"name": "floor_plan", "doors": [0.85, 1.2]},
        {"name": "floor_plan", "kind": "home", "doors": [0.85, 1.1], "corridors": [1.1, 1.6]},
        "clutter",
        {"name": "clutter", "density": 0.6, "gap": 0.8, "margin": 0.05},
        "barn",
        "crowd",
    ],
    "shares": [0.25, 0.25, 0.05, 0.18, 0.15, 0.12],
}


def _env(guided: bool, privileged: bool, trail: bool = False, **reward: float) -> dict[str, Any]:
    """Training's environment: 5 Hz, all noise, every chair another, half of them shielded."""
    task: dict[str, Any] = {
        "beams": 64,
        "aim": "time",
        "last_action": True,
        "shield_state": True,
        "gaps": True,
        "privileged": privileged,
        "reward": {"progress": 0.1, "withheld": -0.02, "haste": -0.3} | reward,
    }
    if not guided:
        task["unguided"] = True
    if trail:
        task["trail"] = [1.0, 2.0, 4.0, 8.0, 15.0]
    return {
        "scene": _WORLDS,
        "rate": 5.0,
        "guidance": {"call": "poses", "share": 0.2 if guided else 0.0},
        "bank": {"size": 1024, "turnover": 0.0, "seed": 1, "cache": "runs/worlds"},
        "chair": {"randomise": True},
        "sensors": {"pose_source": "modelled"},
        "shield": {},
        "unshielded": 0.5,
        "task": task,
    }


def _off(algorithm: Algorithm) -> Training:
    """What a period wins must stand out from how a critic of returns errs: five times ppo's.

    What a change of the action costs, too: an actor that climbs such a critic jitters otherwise.
    """
    return Training(
        algorithm=algorithm, env=_env(True, False, progress=0.5, change=-0.2), frames=4_000_000,
        checkpoint=250,
        curriculum=Curriculum(factor=1.25, above=0.6, episodes=512),
    )  # fmt: skip


# What was tuned, by the name of its file in configs/.
RECIPES: dict[str, Training] = {
    "ppo_guided": Training(env=_env(True, True)),
    "ppo_goal": Training(
        env=_env(False, True, True),
        on_policy=OnPolicy(discount=0.995, log_deviation=-1.5),
        teaching=Teaching(teacher="ppo_guided"),
        curriculum=Curriculum(begin=120.0),  # who is taught needs none
    ),
    "recurrent_ppo": Training(
        algorithm="recurrent_ppo",
        env=_env(False, False),
        frames=8_000_000,
        on_policy=OnPolicy(discount=0.995),
    ),
    "sac": _off("sac"),
    "td3": _off("td3"),
    "tqc": _off("tqc"),
}


def recipe(algorithm: Algorithm) -> Training:
    """The first recipe of an algorithm."""
    return next(own for own in RECIPES.values() if own.algorithm == algorithm)


def read_training(content: Mapping[str, Any], where: str, algorithm: Algorithm) -> Training:
    """Settings of a run from a file's content, over the recipe of the algorithm.

    Raises:
        InputError: a setting is wrong, or the file is for another algorithm.
    """
    if not isinstance(content, Mapping):
        raise InputError(f"{where}: expected an object with keys, got {type(content).__name__}")
    named = content.get("algorithm", algorithm)
    if named != algorithm:
        raise InputError(f"{where}.algorithm is {shown(named)}; the command says {algorithm}")
    return load(Training, {"algorithm": algorithm, **content}, where, recipe(algorithm))


def plain(own: Training) -> dict[str, Any]:
    """A run's settings as JSON."""
    values: dict[str, Any] = dump(own)
    return values


@settings
class Imitation:
    """How a scripted policy is imitated."""

    expert: Any = setting(default="lattice+window", source="the best scripted policy")
    env: Any = setting(default=None, source="as of a training run; none: that of ppo_guided")
    episodes: int = setting(default=200, source="in each round", low=1)
    rounds: int = setting(default=3, source="the expert drives in the first one", low=1)
    epochs: int = setting(default=20, source="over all that was shown, after each round", low=1)
    batch: int = setting(default=1024, source="steps at a time", low=1)
    rate: float = setting(default=1e-3, source="of learning (Adam)", low=0.0)
    hidden: tuple[int, ...] = setting(default=(256, 256), source="units of each layer", low=1)
    jobs: int = setting(default=1, source="processes that drive", low=1)
