"""Settings of a training run, all in one file."""

from collections.abc import Mapping
from typing import Any, Literal

from agents import read_data
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError, load, setting, settings
from wheelchair_gym.envs.settings import EnvSettings, read_env_settings

_CONTENT: dict[str, Any] = read_data("recipes.yaml")
Algorithm = Literal["ppo", "sac", "td3"]
SB3 = "default of stable-baselines3"
TUNED = "tuned on training worlds"


def _check_layers(net_arch: tuple[int, ...]) -> None:
    if not net_arch:
        raise InputError("net_arch is empty; expected the units of one hidden layer or more")


@settings
class OnPolicy:
    """Parameters of PPO (Schulman et al. 2017), named as in stable-baselines3."""

    n_steps: int = setting(default=64, low=2)
    """Steps of each environment between two updates."""
    batch_size: int = setting(
        default=4096, low=2, source="measured: the fastest on a processor without a GPU"
    )
    """Steps in a minibatch."""
    n_epochs: int = setting(default=2, low=1, source=TUNED)
    """Passes over the collected steps in an update."""
    learning_rate: float = setting(default=1e-3, low=0.0, source=TUNED)
    """Initial learning rate; it decreases linearly to 0 over the run."""
    gamma: float = setting(default=0.99, low=0.0, high=1.0, source=SB3)
    """Discount factor per step."""
    gae_lambda: float = setting(default=0.95, low=0.0, high=1.0, source="Schulman et al. 2016")
    """Lambda of generalized advantage estimation."""
    clip_range: float = setting(default=0.2, low=0.0, source="Schulman et al. 2017")
    """Bound of the change of the probability ratio in an update."""
    ent_coef: float = setting(default=0.002, low=0.0, source=TUNED)
    """Weight of the entropy in the loss."""
    log_std_init: float = setting(default=-0.5, source=TUNED)
    """Initial logarithm of the standard deviation of the actions."""
    vf_coef: float = setting(default=0.5, low=0.0, source=SB3)
    """Weight of the critic's loss."""
    max_grad_norm: float = setting(default=0.5, low=0.0, source=SB3)
    """Norm to which gradients are clipped."""
    precision: Literal["auto", "float32", "bfloat16"] = setting(
        default="auto",
        source="measured: learning takes half the time, along gradients 0.001 apart at most",
    )
    """Numbers with which ppo computes hidden layers while it learns; weights are float32 always.
    `auto`: bfloat16 where the processor calculates with it (AVX-512 BF16), else float32."""


@settings
class OffPolicy:
    """Parameters of SAC and TD3, named as in stable-baselines3."""

    buffer_size: int = setting(default=500_000, low=100)
    """Steps in the replay buffer."""
    batch_size: int = setting(default=1024, low=2)
    """Steps in a minibatch."""
    learning_starts: int = setting(default=20_000, low=0)
    """Steps of random actions before the first update."""
    gradient_steps: int = setting(default=4, low=1, source=TUNED)
    """Gradient steps after each step of all environments."""
    learning_rate: float = setting(default=1e-3, low=0.0, source=TUNED)
    """Initial learning rate; it decreases linearly to 0 over the run."""
    gamma: float = setting(default=0.99, low=0.0, high=1.0, source=SB3)
    """Discount factor per step."""
    tau: float = setting(
        default=0.01,
        low=0.0,
        high=1.0,
        source="measured: half or twice as much gives the same success",
    )
    """Coefficient of the soft update of target networks."""
    action_noise: float = setting(default=0.1, low=0.0, source="Fujimoto et al. 2018")
    """Standard deviation of the exploration noise on the actions of TD3."""


@settings
class Curriculum:
    """Starts that move away from the goal as success grows; needs the guidance 'poses'."""

    initial_time: float = setting(default=12.0, unit="s", low=0.0, source=TUNED)
    """Longest planned travel time from the first starts to the goal; 0 disables the curriculum."""
    growth: float = setting(default=1.15, low=1.0, source=TUNED)
    """Growth factor of the travel time at each advance."""
    success_threshold: float = setting(default=0.75, low=0.0, high=1.0, source=TUNED)
    """Success rate above which the curriculum advances."""
    episodes: int = setting(default=1024, low=1)
    """Episodes over which the success rate is measured."""
    max_time: float = setting(
        default=120.0, unit="s", low=0.0, source="longer than any plan in the training worlds"
    )
    """Largest planned travel time, at which the curriculum ends."""


@settings
class Evaluation:
    """Evaluation during training, on a fixed bank of training worlds that nothing is trained on."""

    episodes: int = setting(default=128, low=0)
    """Episodes; 0 disables evaluation."""
    frequency: int = setting(default=2, low=1)
    """Checkpoints between two evaluations."""
    seed: int = setting(default=1_000_003, low=0, source="apart from the seeds of training")
    """Seed of the bank of worlds, and of the first episode."""


@settings
class Kickstarting:
    """A trained policy that ppo's actor imitates at first (Schmitt et al. 2018).

    The teacher sees observations that the actor does not: `env.task.hide_guidance` hides the
    path from the actor alone.
    """

    teacher: str | None = setting(default=None)
    """Weights of the teacher: a file or a shipped name."""
    coefficient: float = setting(default=4.0, low=0.0, source=TUNED)
    """Initial weight of the squared distance between the actions of actor and teacher."""
    duration: float = setting(default=0.6, low=0.01, high=1.0, source=TUNED)
    """Share of the run's frames over which the weight decreases linearly to 0."""


@settings
class Training:
    """A training run."""

    algorithm: Algorithm = setting(default="ppo", source="measured: the best of them here")
    """The learning algorithm."""
    env: Any = setting(
        default=None,
        holds=EnvSettings,
        source="default: those of ppo_guided without the critic's privileged observation",
    )
    """Settings of the environment, as in a file for `--config` of `wheelchair simulate`."""
    n_envs: int = setting(default=512, low=1)
    """Environments stepped at once."""
    frames: int = setting(default=24_000_000, low=1, source="measured: success no longer grows")
    """Environment steps of the run, over all environments."""
    checkpoint_frequency: int = setting(default=10, low=1)
    """Updates between two checkpoints; all environments reset at a checkpoint."""
    net_arch: tuple[int, ...] = setting(default=(256, 256), low=1)
    """Units of each hidden layer of actor and critic."""
    threads: int = setting(default=2, low=1)
    """Threads of torch and of the environments."""
    device: Literal["auto", "cpu", "cuda"] = setting(default="auto")
    """Device of the networks; `auto`: a GPU if torch finds one. Environments stay on the
    processor."""
    warm_start: str | None = setting(default=None)
    """Initial weights of the actor: a file or a shipped name."""
    on_policy: OnPolicy = OnPolicy()
    off_policy: OffPolicy = OffPolicy()
    kickstarting: Kickstarting = Kickstarting()
    curriculum: Curriculum = Curriculum()
    evaluation: Evaluation = Evaluation()

    def __post_init__(self) -> None:
        _check_layers(self.net_arch)
        env = self.env_settings()
        if env.task.privileged and self.algorithm != "ppo":
            raise InputError(f"env.task.privileged is for ppo's critic, not for {self.algorithm}")
        kickstarted = self.kickstarting.teacher is not None
        if kickstarted and (self.algorithm != "ppo" or self.on_policy.ent_coef == 0.0):
            raise InputError("kickstarting.teacher is for ppo, with on_policy.ent_coef above 0")
        spec = env.guidance
        guidance = spec.get("call") if isinstance(spec, Mapping) else spec
        if self.curriculum.initial_time > 0.0 and guidance != "poses":
            raise InputError("curriculum.initial_time needs env.guidance 'poses', or 0")
        if self.curriculum.initial_time > 0.0 and env.starts_within > 0.0:
            raise InputError("env.starts_within: expected 0 beside curriculum.initial_time")

    def env_settings(self) -> EnvSettings:
        """The settings of the environments."""
        return training_env_settings(self.env)

    @property
    def steps_per_checkpoint(self) -> int:
        """Steps of each environment between two checkpoints."""
        collected = self.on_policy.n_steps if self.algorithm == "ppo" else 1
        return collected * self.checkpoint_frequency


def training_env_settings(spec: Any) -> EnvSettings:
    """Settings of an environment; None gives those of `ppo_guided` without privileged keys.

    Raises:
        InputError: a setting is wrong.
    """
    made: EnvSettings = spec
    if not isinstance(spec, EnvSettings):
        made = read_env_settings(_CONTENT[".env"] if spec is None else spec, "env")
    if made.task.scaled:
        raise InputError("env.task.scaled: expected false; these networks scale by themselves")
    return made


# Tuned settings by the name of their file in configs/.
RECIPES: dict[str, Training] = {
    name: load(Training, values, f"recipe {name}")
    for name, values in _CONTENT.items()
    if not name.startswith(".")
}


def recipe(algorithm: Algorithm) -> Training:
    """The first recipe of an algorithm."""
    return next(config for config in RECIPES.values() if config.algorithm == algorithm)


def read_training(content: Mapping[str, Any], where: str, algorithm: Algorithm) -> Training:
    """Settings of a run from a file's content, over the recipe of the algorithm.

    Raises:
        InputError: a setting is wrong, or the file is for another algorithm.
    """
    if not isinstance(content, Mapping):
        raise InputError(f"{where}: expected an object with keys, got {type(content).__name__}")
    named = content.get("algorithm", algorithm)
    if named != algorithm:
        raise InputError(f"{where}.algorithm is {shorten(named)}; the command says {algorithm}")
    return load(Training, {"algorithm": algorithm, **content}, where, recipe(algorithm))


@settings
class Imitation:
    """Settings of the imitation of a scripted policy, or of the drives of a data set."""

    dataset: str | None = setting(default=None)
    """A Minari data set, found by MINARI_DATASETS_PATH, whose episodes are imitated in one round;
    the environment is then that of the data set."""
    expert: Any = setting(default="lattice+window", source="measured: the best scripted policy")
    """The policy that is imitated: a name or an object of settings."""
    env: Any = setting(default=None, holds=EnvSettings)
    """Settings of the environment, as those of a training run."""
    episodes: int = setting(default=200, low=1)
    """Episodes in each round."""
    rounds: int = setting(default=3, low=1)
    """Rounds; the expert drives in the first one, the student in the others."""
    n_epochs: int = setting(default=20, low=1)
    """Passes over all collected steps after each round."""
    batch_size: int = setting(default=1024, low=1)
    """Steps in a minibatch."""
    learning_rate: float = setting(default=1e-3, low=0.0, source="Kingma and Ba 2015")
    """Learning rate of Adam."""
    net_arch: tuple[int, ...] = setting(default=(256, 256), low=1)
    """Units of each hidden layer."""
    jobs: int = setting(default=1, low=1)
    """Processes that drive."""

    def __post_init__(self) -> None:
        _check_layers(self.net_arch)
