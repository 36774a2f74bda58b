"""Steps per second of other simulators with a laser, beside ours, alternating in one run.

    python -m tests.benchmarks.peers [--beams 64] [--seconds 2] [--rounds 3] [--envs 1024]
        [--other PYTHON]

A peer that is not installed is left out: IR-SIM (`ir-sim`), VMAS (`vmas`), JaxNav (`jaxmarl`),
Navground (`navground`) and rlnav (`rlnav`). `irsim-x` is imported by IR-SIM's name: give the
interpreter of an environment of its own. None of them does all that ours does, and the last column
says what a step of each contains; where a peer takes walls, it gets those of the same floor plan.
CartPole of Gymnasium is a yardstick.
"""

import argparse
import contextlib
import io
import math
import statistics
import subprocess
from collections.abc import Callable
from functools import partial
from importlib.metadata import packages_distributions
from typing import Any

import gymnasium as gym
import numpy as np

from agents.benchmarks import environments
from agents.benchmarks.environments import irsim_rate
from agents.evaluation.provenance import provenance
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.types import Episode

LENGTH, WIDTH, REACH, FIELD = 1.05, 0.65, 10.0, 1.5 * math.pi
OURS = "drive train, rigid contact, laser and eight ultrasonics with noise, path, reward, resets"


def rate(step: Callable[[], Any], n: int, seconds: float) -> float:
    """Steps per second of calls that make n steps each."""

    def steps(_: int) -> int:
        step()
        return n

    return environments.measure_rate(steps, seconds)


def vmas_stepper(episode: Episode, beams: int, n: int) -> Callable[[], Any]:
    """VMAS (torch): a differential-drive box between walls, one scan a step, no reset."""
    import torch
    from vmas.simulator.core import Agent, Box, Landmark, Line, World
    from vmas.simulator.dynamics.diff_drive import DiffDrive
    from vmas.simulator.sensors import Lidar

    torch.set_num_threads(2)
    world = World(batch_dim=n, device=torch.device("cpu"), dt=0.1, substeps=2)
    laser = Lidar(world, -FIELD / 2, FIELD / 2, beams, REACH)
    chair = Agent(
        "chair", shape=Box(LENGTH, WIDTH), sensors=[laser], dynamics=DiffDrive(world), u_range=1.0
    )
    world.add_agent(chair)
    for k, wall in enumerate(episode.walls):
        length = float(np.hypot(*(wall[2:] - wall[:2])))
        line = Landmark(f"wall {k}", shape=Line(length), collide=True)
        world.add_landmark(line)
        line.set_pos(torch.tensor((wall[:2] + wall[2:]) / 2, dtype=torch.float32), None)
        angle = math.atan2(wall[3] - wall[1], wall[2] - wall[0])
        line.set_rot(torch.tensor([angle], dtype=torch.float32), None)
    chair.set_pos(torch.tensor(episode.start[:2], dtype=torch.float32), None)

    def step() -> None:
        chair.action.u = 2.0 * torch.rand(n, 2) - 1.0
        world.step()
        laser.measure()

    return step


def jaxnav_stepper(episode: Episode, beams: int, n: int) -> Callable[[], Any]:
    """JaxNav (jax): a disc on its own map, whose beams march in steps of 0.05 m; with resets."""
    import jax
    from jaxmarl.environments.jaxnav import JaxNav

    env = JaxNav(num_agents=1, lidar_num_beams=beams, lidar_max_range=REACH)
    keys = jax.random.split(jax.random.PRNGKey(0), n)
    _, state = jax.jit(jax.vmap(env.reset))(keys)
    actions = {"agent_0": jax.random.uniform(keys[0], (n, 2), minval=-1.0)}
    advance = jax.jit(jax.vmap(env.step))
    held = [state]

    def step() -> None:
        observed, held[0], *_ = advance(keys, held[0], actions)
        jax.block_until_ready(observed)

    return step


def navground_stepper(episode: Episode, beams: int, n: int) -> Callable[[], Any]:
    """Navground (C++): a disc between the same walls, one scan a step, no reset; one world."""
    from navground import core, sim

    world = sim.World()
    for x0, y0, x1, y1 in episode.walls:
        world.add_wall(sim.Wall((x0, y0), (x1, y1)))
    behavior = core.Behavior.make_type("Dummy")
    kinematics = core.kinematics.TwoWheelsDifferentialDriveKinematics(0.5, 1.0)
    chair = sim.Agent(WIDTH / 2, behavior, kinematics, None, [], 0.1)
    chair.position = tuple(episode.start[:2])
    world.add_agent(chair)
    laser, seen = sim.Sensor.make_type("Lidar"), core.SensingState()
    laser.resolution, laser.range = beams, REACH
    laser.start_angle, laser.field_of_view = -FIELD / 2, FIELD
    laser.prepare_state(seen)
    rng = np.random.default_rng(0)
    targets = [
        core.Target.Twist(core.Twist2((v, 0.0), w, core.Frame.relative))
        for v, w in rng.uniform(-0.5, 0.5, (64, 2)).tolist()
    ]

    def step() -> None:
        behavior.target = targets[rng.bit_generator.random_raw() % 64]
        world.update(0.1)
        laser.update(chair, world, seen)

    return step


def gymnasium_stepper(name: str, episode: Episode, beams: int, n: int) -> Callable[[], Any]:
    """An environment of Gymnasium, with resets."""
    if name.startswith("PointMaze"):
        import rlnav  # noqa: F401

    env = gym.make(name)
    env.reset(seed=0)
    actions = [env.action_space.sample() for _ in range(64)]
    rng = np.random.default_rng(0)

    def step() -> None:
        *_, over, late, _ = env.step(actions[rng.bit_generator.random_raw() % 64])
        if over or late:
            env.reset()

    return step


CONTENT = {"rlnav": "a point in a maze; no laser", "CartPole": "a cart with a pole; no laser"}
IRSIM = "the chair's box, the same walls, a scan; no reset"


def other_rate(python: str, beams: int, seconds: float) -> float:
    """Steps per second of the `irsim` that another interpreter imports."""
    words = [python, "-m", "tests.benchmarks.peers", "--beams", beams, "--seconds", seconds]
    done = subprocess.run(
        [*map(str, words), "--alone"], check=True, stdout=subprocess.PIPE, text=True
    )
    return float(done.stdout.split()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, kind, value in (("beams", int, 64), ("seconds", float, 2.0), ("rounds", int, 3)):
        parser.add_argument(f"--{name}", type=kind, default=value)
    parser.add_argument("--envs", type=int, default=1024)
    parser.add_argument("--other", help="interpreter of an environment with irsim-x")
    parser.add_argument("--alone", action="store_true", help="print the rate of irsim alone")
    given = parser.parse_args()
    settings, many = environments.bench_settings(given.beams, 64), given.envs
    env = NavigationEnv(config=settings)
    worlds, episode = env.worlds, env.worlds.episode(0, 0).episode
    if given.alone:
        print([irsim_rate(settings, episode, given.seconds) for _ in range(2)][-1])  # once warm
        return
    for seed in range(64):
        worlds.episode(seed, 0)
    spent = given.seconds
    cases: dict[str, tuple[int, str, Callable[[], float]]] = {
        "wheelchair_gym": (1, OURS, lambda: environments.single_env_rate(settings, worlds, spent)),
        "wheelchair_gym ": (
            many, OURS, lambda: environments.vector_env_rate(settings, worlds, many, 2, spent)[0],
        ),
    }  # fmt: skip
    if found_as := packages_distributions().get("irsim"):
        cases[found_as[0]] = 1, IRSIM, lambda: irsim_rate(settings, episode, spent)
    if given.other:
        cases["irsim-x"] = 1, IRSIM, lambda: other_rate(given.other, given.beams, spent)
    for name, make in (
        ("VMAS", vmas_stepper), ("JaxNav", jaxnav_stepper), ("Navground", navground_stepper),
        ("rlnav", partial(gymnasium_stepper, "PointMaze-v0")),
        ("CartPole", partial(gymnasium_stepper, "CartPole-v1")),
    ):  # fmt: skip
        sizes = (1, many) if name in ("VMAS", "JaxNav") else (1,)
        for n in sizes:
            try:
                with contextlib.redirect_stdout(io.StringIO()):
                    step = make(episode, given.beams, n)
                    step()
            except ImportError as error:
                print(f"{name}: left out ({error})")
                break
            says = CONTENT.get(name) or str(make.__doc__).split(": ", 1)[1]
            cases[name + " " * (n > 1)] = (n, says, lambda step=step, n=n: rate(step, n, spent))
    found: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(given.rounds):
        for name, (_, _, measured) in cases.items():
            found[name].append(measured())
    print(f"{given.beams} beams; {len(episode.walls)} walls; {provenance()}")
    print(f"{'simulator':16}{'envs':>6}{'steps/s':>10}  low - high          a step contains")
    for name, (n, says, _) in cases.items():
        rates = found[name]
        spread = f"{min(rates):,.0f} - {max(rates):,.0f}"
        print(f"{name:16}{n:>6}{statistics.median(rates):>10,.0f}  {spread:18}  {says}")


if __name__ == "__main__":
    main()
