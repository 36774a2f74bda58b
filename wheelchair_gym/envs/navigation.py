"""The navigation environment: a chair, a task, and the loop between them."""

import dataclasses
import io
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.random import SEEDS, Split, episode_key
from wheelchair_gym.envs.drawing import EpisodeRenderer
from wheelchair_gym.envs.guidance import make_guidance
from wheelchair_gym.envs.one_chair import LoopInParts, Parts, SimulatedLoop
from wheelchair_gym.envs.results import EPISODE_KEYS, info_table
from wheelchair_gym.envs.settings import (
    EnvSettings,
    check_options,
    check_seed,
    check_split,
    env_settings,
    make_assistants,
    make_localizer,
)
from wheelchair_gym.envs.world_banks import NO_LEVEL, WorldBank, prepare_world
from wheelchair_gym.geometry.kinematics import numbers_of
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.people.drivers import make_drivers
from wheelchair_gym.people.drivers.step import Drivers
from wheelchair_gym.perception.localized_chair import LocalizedChair, unwrapped
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.safety.shield import Shield
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.task.observations import observation_table
from wheelchair_gym.task.prepared_episode import PreparedEpisode
from wheelchair_gym.task.rewards import as_record, checked, make_reward, reward_table
from wheelchair_gym.task.task import Observation, Task
from wheelchair_gym.types import Chair, Episode, Mission, Reading, Shown, Stick


class NavigationEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Drive a wheelchair to a goal, seeing with laser scanners and ultrasonics.

    ## Description
    A differential-drive wheelchair (1.00 m x 0.62 m) stands in a world of walls and round obstacles
    and has to bring its drive axle to the goal without touching anything. Motors, tyres, battery
    and contact are simulated; sensors err as real ones do.

    ## Action
    `Box(-1, 1, (2,), float32)`: target speed and turn; 0 stands still.

    | index | meaning | -1 | 1 |
    | --- | --- | --- | --- |
    | 0 | forward speed | -0.3 m/s | 0.8 m/s |
    | 1 | turn, counter-clockwise | -1 rad/s | 1 rad/s |

    ## Observation
    A `Dict` of float32 boxes.

    {observations}

    ## Reward
    The sum of the named terms in `info["reward_terms"]`; weights are settings (`task.reward`).

    {rewards}

    ## Start and end
    A scene places walls, start and goal from the seed: episode k of seed s is always the same in
    each split.
    Terminated when the chair believes to be within 0.30 m of the goal (0.20 m if its pose is an
    estimate, which may err by 0.10 m), or when a bumper strip is pressed; truncated at the time
    limit, 30 s + 3 x geodesic / 0.8 m/s, which never comes with a termination. The limit of
    `max_episode_steps` may, as that of Gymnasium's `TimeLimit`: then the episode has terminated.

    ## Info
    {info}

    With a shield, `info["shield"]` holds `reason` (empty: nothing was changed), the twists `asked`
    and `given`, and `protective` (the chair makes a protective stop). In an `unshielded` episode
    they stay as reset gave them: empty, zero and false, whatever is driven.

    ## Copies
    `copy.deepcopy(env)` is exact at any moment: it steps on as the original does, to the bit. So is
    a copy by `pickle`. It opens its own window. What drives a real chair cannot be copied.

    ## Arguments
    See `__init__`.

    ## Versions
    - v1: worlds are drawn for training, unless `split="test"` says otherwise.
    - v0: worlds were those of the test split.
    """

    chair: Chair  # simulated or given, and with a localizer where the pose source is one
    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        scene: Any = None,
        config: str | Path | Mapping[str, Any] | EnvSettings | None = None,
        *,
        split: Split = "train",
        chair: Chair | str | Mapping[str, Any] | None = None,
        person: Callable[[], Stick] | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        """Make the environment.

        Args:
            scene: name of a scene, a mapping of its name and settings, or the Path of a map file.
            config: JSON file, or its content, with any of the sections scene, rate, guidance,
                bank, chair, sensors, physics, task, shield, hardware; the other arguments override
                it.
            split: the stream that worlds are drawn from: 'train', or 'test', on which policies are
                judged. On a map from a file, the splits differ in start and goal only.
            chair: drives instead of the simulated chair; or names a real one, such as
                'ros://HOST:PORT' or 'hardware' (see `hardware.registry`).
            person: reads the stick of a real person who drives, after each reading; actions are
                then those of an assistant, as with `driver`.
            render_mode: 'human' (a window), 'rgb_array', or None.
            settings: any of

                - beams: observed laser beams; fewer than the laser has are pooled by their minimum;
                - rate: of control [Hz]; a period is an integer number of physics steps;
                - pose_source: what the chair takes for its pose: truth, odometry, modelled, mcl
                  (Monte Carlo localization on the map), or slam (the world is unknown: the chair
                  draws its own map in the frame of its start, and localizes on it);
                - guidance: 'geodesic' (points on the shortest path), 'poses' (of the quickest path
                  of the chair's outline, with headings, at plan times), 'module:function' or a
                  callable that gives a path from a task;
                - reward: what gives the reward in place of the weighted terms: 'module:function' or
                  a callable (`wheelchair_gym.task.rewards`);
                - noise: false makes every sensor exact;
                - randomize: true draws mass, friction and motor gain anew for each episode;
                - bank: how many worlds episodes share, or a mapping of size, turnover and seed; 0:
                  each episode has its own world;
                - shield: true, or a mapping of its settings: only what it allows is driven
                  (`wheelchair_gym.safety`). True: as in the config, if it has one. None: off in
                  simulation, on for a real chair by name;
                - driver: a simulated person who drives (`wheelchair_gym.people.drivers`), a name, a
                  mapping, or a list of those (each episode draws one): actions are those of an
                  assistant, which is shown the person's stick and not its goal;
                - assistant: a compiled assistant that drives with the person, a name or a mapping:
                  actions are residuals, whose twist is added to the assistant's within its freedom;
                - max_episode_steps: truncates every episode, beside its time limit;
                - render_width, render_height: of every frame [pixels]; even.

        Raises:
            InputError: an argument or a setting is out of bounds.
            ArgumentError: an argument is unknown.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode is {render_mode!r}; expected human, rgb_array or None")
        also = "split", "chair", "person", "render_mode"
        self.settings = env_settings(config, also=also, scene=scene, **settings)
        self._take_chair(chair, settings.get("shield") is not False)
        try:
            self._assemble(split, person)
        except BaseException:
            if not isinstance(chair, Chair):  # made here: nobody else can disconnect it
                self.chair.close()
            raise
        self.render_mode = render_mode

    def _assemble(self, split: Split, person: Callable[[], Stick] | None) -> None:
        """Make all parts around the chair; for the arguments, see `__init__`."""
        s = self.settings
        self._reward = make_reward(s.reward)
        if self._reward is not None and not self._simulated:
            raise InputError("reward: a function of one's own needs the simulated chair")
        people = make_drivers(s.driver)
        if people and not self._simulated:
            raise InputError("driver: a simulated person needs the simulated chair")
        if people and person is not None:
            raise InputError("driver and person: expected one of them")
        self.drivers = Drivers(people, s.chair, s.sensors, 1.0 / s.rate)
        has_person = bool(people) or person is not None
        self.assistants = make_assistants(s, 1, has_person)
        guided = make_guidance(s.guidance)
        self.task = Task(s.task, s.chair, s.sensors, 1.0 / s.rate, guided, s.shield, has_person)
        if s.sensors.localizes:
            localizer = make_localizer(s)
            self.chair = LocalizedChair(self.chair, localizer, s.sensors.laser.beams)
            self.task.built_map = localizer.built_map
        self.shield: Shield | None = None
        if s.shield is not None:
            self.shield = Shield(s.shield, s.chair, s.sensors, 1.0 / s.rate)
            # A person who re-arms a real chair re-arms its shield, too.
            unwrapped(self.chair).add_rearm_callback(self.shield.rearm)
        self.split = check_split(split)
        self.worlds = WorldBank(s, self.task, self.split)
        self.observation_space = cast("gym.Space[Observation]", self.task.space)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.metadata = {**self.metadata, "render_fps": s.rate}
        self.episode: Episode | None = None
        self._prepared: PreparedEpisode | None = None
        super().reset(seed=secrets.randbits(48))  # for a first reset without a seed
        self._seed: int | None = None
        self._count = 0  # episodes of the present seed
        self.episode_info: dict[str, Any] = {}  # which episode is driven, by key of `info`
        self._running = False
        self.last_action, self.last_reward = (0.0, 0.0), 0.0  # of `step`; wrappers may change both
        parts = Parts(
            self.chair, self.task, self.drivers, self.assistants, self.shield, s.unshielded
        )
        is_plain = type(self.chair) is SimulatedChair and person is None
        self._loop = SimulatedLoop(parts) if is_plain else LoopInParts(parts, person)
        self._drawing = EpisodeRenderer(s)
        self.shown = Shown()  # what the policy shows; before it drives, the guidance
        # What recordings say of who drives, such as assistant and interface; set it before reset.
        self.labels: dict[str, Any] = {}
        self._label_interface()

    def _take_chair(self, chair: Chair | str | Mapping[str, Any] | None, may_shield: bool) -> None:
        """Take or make the chair that drives. A real one by name always has a shield."""
        s = self.settings
        if chair is not None and s.unshielded > 0.0:
            raise InputError(f"unshielded is {s.unshielded:g}; expected 0 for a given chair")
        if isinstance(chair, str | Mapping):
            from wheelchair_gym.hardware.registry import make_chair

            if not may_shield:
                raise InputError("shield is False; expected one: a real chair has it always")
            s = self.settings = dataclasses.replace(s, shield=s.shield or ShieldSettings())
            chair = make_chair(chair, s)
        if not isinstance(chair, Chair | None):
            raise InputError(f"chair is {type(chair).__name__}; expected a wheelchair_gym Chair")
        self.chair = chair or SimulatedChair(s.chair, s.sensors, s.physics, 1.0 / s.rate)
        self._simulated = isinstance(self.chair, SimulatedChair)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode: number 0 of a seed, or the next one of the present seed.

        Args:
            seed: starts the sequence of episodes of this seed. Without any, the first reset draws
                one at random, which `info` and `np_random_seed` tell.
            options: {"episode": Episode} drives in this world instead of the scene's.

        Raises:
            InputError: the seed is no integer or out of bounds, another option is given, or no
                Episode.
        """
        (given,) = check_options(options, "episode")
        if given is not None and not isinstance(given, Episode):
            raise InputError(f"options: episode is {shorten(given)}; expected an Episode")
        super().reset(seed=None if seed is None else check_seed(seed))
        if seed is not None or self._seed is None:
            self._seed, self._count = self.np_random_seed, 0
            if self._seed < 0:  # a generator was set in place of a seed
                self._seed = int(self.np_random.integers(SEEDS))
        else:
            self._count += 1
        level = self.worlds.draw(self._seed, self._count) if given is None else NO_LEVEL
        if given is None:
            self._prepared = self.worlds.episode(self._seed, self._count, level)
            self.worlds.drop_before(self._count)
        elif self._prepared is None or given is not self._prepared.episode:
            self._prepared = prepare_world(self.task, given)
        self.episode = self._prepared.episode
        told = self._seed, self._count, self.split
        self.episode_info = dict(zip(EPISODE_KEYS, (*told, level), strict=True))
        key = episode_key(*told)
        if self.shield is not None:
            self.shield.reset()
        observation, info = self._loop.begin(self._prepared, key)
        info |= self.episode_info
        self._label_interface()
        self._running = True
        self._drawing.begin()
        self.show(Shown())
        self._drawing.follow(info["pose"])
        if self.render_mode == "human":
            self.render()
        return observation, info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one control period.

        Args:
            action: (2,) in [-1, 1]; beyond is clipped. With an assistant it is added to that one's.

        Raises:
            InputError: the action is not two finite numbers.
            gymnasium.error.ResetNeeded: the episode is over, or there was none yet.
        """
        if not self._running:
            raise gym.error.ResetNeeded("the episode is over; call reset() before step()")
        given = numbers_of(action)
        observation, reward, terminated, truncated, info = self._loop.step(given)
        info |= self.episode_info
        self._running = not (terminated or truncated)
        self._drawing.follow(info["pose"])
        if self.render_mode == "human":
            self.render()
        if self._reward is not None:
            simulated: Any = unwrapped(self.chair)
            records = as_record(self.task.judged["terms"]), as_record(simulated.sensed)
            reward = checked(self._reward(*records, np.array(given)))
        self.last_action, self.last_reward = given, reward
        return observation, reward, terminated, truncated, info

    def _label_interface(self) -> None:
        """Label recordings with the interface through which a simulated person drives."""
        if self.drivers.driver is not None:
            self.labels["interface"] = self.drivers.driver.interface.kind

    def render(self) -> NDArray[np.uint8] | None:
        """The world from above: an RGB picture (render_height, render_width, 3).

        None when it goes to a window.
        """
        if self.render_mode is None:
            gym.logger.warn("render() needs render_mode='rgb_array' or 'human' in gymnasium.make")
            return None
        if self.episode is None:
            raise gym.error.ResetNeeded("call reset() before render()")
        truth, ahead = self.chair.truth, self.points_ahead
        frame = self._drawing.picture(self.episode, truth, self.task, self.shown, ahead)
        if self.render_mode == "rgb_array":
            return frame
        self._drawing.show(frame)
        return None

    @property
    def mission(self) -> Mission:
        """Return the information for a policy before the present episode; call it after reset()."""
        task = self.task
        return Mission(
            map=task.map if task.built_map is None else None,
            reading=self.reading,
            goal=task.goal if task.settings.heading or task.arrival else task.goal[:2],
            tolerance=task.tolerance,
            time_limit=task.time_limit,
            period=task.period,
            chair=task.chair,
            sensors=task.sensors,
            shield=task.shield,
            is_shielded=task.is_shielded,
            key=task.key,
            real_time=unwrapped(self.chair).real_time,
        )

    @property
    def reading(self) -> Reading:
        """The latest reading as a policy gets it, with the last action and the map drawn so far."""
        task = self.task
        drawn = None if task.built_map is None else task.built_map()
        share, turn = (min(1.0, max(-1.0, each)) for each in task.action)
        return task.reading._replace(
            action=(share, turn), shield_intervention=task.shield_intervention, map=drawn,
            stick=task.stick,
        )  # fmt: skip

    def show(self, shown: Shown) -> None:
        """Show people what a policy wants shown, until the next call or reset()."""
        self.shown = shown if shown.path is not None else shown._replace(path=self.task.path)

    def _repr_png_(self) -> bytes | None:
        """Return the picture that a notebook shows; None before the first reset."""
        from PIL import Image

        if self.episode is None:
            return None
        out = io.BytesIO()
        picture = self._drawing.picture(self.episode, self.chair.truth, self.task, self.shown, None)
        Image.fromarray(picture).save(out, "png")
        return out.getvalue()

    @property
    def points_ahead(self) -> Array | None:
        """The points (n, 2) [m] of the guidance that a policy is shown, on the map; or None."""
        ahead = self.task.observation.get("path")
        if ahead is None:
            return None
        each = ahead.reshape(-1, 4 if self.task.has_poses else 2)
        return to_world(each[:, :2], self.task.reading.pose)

    def close(self) -> None:
        """Stop the chair and close the window; may be called again."""
        self.chair.close()
        self._drawing.close()


NavigationEnv.__doc__ = str(NavigationEnv.__doc__).format(
    observations=observation_table(), rewards=reward_table(), info=info_table()
)
