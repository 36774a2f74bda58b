"""`wheelchair simulate`, `drive`, `deploy`, `fit-driver`, `replay`: drives, and recorded ones."""

import argparse
import dataclasses
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from agents.cli import arguments
from agents.cli.fit import replay_simulated
from agents.deploy import Deployment, EventLog, check_start, late_steps, rearm, rehearse, to_stderr
from agents.deploy import deploy as deploy_policy
from agents.evaluation.evaluate import drive_episode, env_settings, label, make_env
from agents.people import is_shielded
from agents.people.recorded_stick import open_loop
from agents.policies import GymPolicy, make_policy
from agents.watch import Each, ignore
from wheelchair_gym.base.errors import load_extra
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs.settings import env_settings as complete_env_settings
from wheelchair_gym.geometry.outline import best_clearance_heading
from wheelchair_gym.hardware.joystick import ANY
from wheelchair_gym.hardware.registry import chair_settings, check_extras
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.maps import FREE, OCCUPIED, MapWithWalls, read_any_map
from wheelchair_gym.people.drivers import make_driver
from wheelchair_gym.perception.localized_chair import unwrapped
from wheelchair_gym.recording.replay import RecordedEpisode, read_recording, replay_env
from wheelchair_gym.rendering.video import write_png, write_video
from wheelchair_gym.safety.stops import active_stops
from wheelchair_gym.types import Episode


def simulate(given: argparse.Namespace) -> int:
    """Drive one episode and report it."""
    from wheelchair_gym.rendering.picture import scene_entries, with_legend

    arguments.check_assist(given)
    settings, name = arguments.env_of(given), given.policy
    labels: dict[str, Any] = {"policy": arguments.spec(name)}
    policy = make_policy(arguments.spec(name))
    if given.driver is not None:
        if name not in ("assisted", given.parser.get_default("policy")):
            raise InputError(f"--policy {name}: the person of --driver drives; expected --assist")
        name = given.assist or "slide"
        policy = make_policy({"name": "assisted", "assist": arguments.spec(name)})
        settings |= {"driver": arguments.spec(given.driver)}
        labels = {"assistant": arguments.spec(name)}
        if given.shield is None:
            settings["shield"] = settings.get("shield") and is_shielded(arguments.spec(name))
    scene = settings.get("config", {}).get("scene", "floor_plan")
    mode, episode = "human" if given.window else "rgb_array", None
    if given.chair is not None:
        scene = scene if given.scene is None else arguments.spec(given.scene)
        env, episode = _real(given, settings, scene, mode)
    else:
        scene = arguments.scene_of(given, scene)
        env = make_env(scene, settings, mode)
    env.unwrapped.labels |= labels
    frames: list[Any] = []
    film: Any = (lambda e: frames.append(e.render())) if given.video else (lambda e: None)
    # Reports why a real chair stands, and ends a run that cannot continue.
    events = None if given.chair is None else EventLog(Deployment(), to_stderr)
    try:
        env, film = arguments.watch(given).on(env, film)

        def each(now: Any) -> bool:
            film(now)
            return events is not None and events(now)

        record = drive_episode(env, policy, given.seed, each, episode)
        if given.video:
            write_video(given.video, frames, 1.0 / env.unwrapped.task.period)
        if given.picture:
            actors = env.unwrapped.episode.actors
            write_png(given.picture, with_legend(env.render(), scene_entries(actors)))
    finally:
        env.close()
    if events is not None:
        record = events.outcome(record) | late_steps(env)
    stands = active_stops(env.unwrapped.task.reading.halted, env.unwrapped.shield)
    place = label(scene) if episode is None else episode.name
    record |= {"policy": name, "scene": place, "seed": given.seed, "stands": stands}
    gap = record["clearance_min"]
    outcome = record["outcome"]
    text = (
        f"{name} on {place}, seed {given.seed}: "
        f"{outcome if record['success'] else f'did not arrive ({outcome})'} after "
        f"{record['time']:.1f} s and {record['length']:.2f} m (shortest {record['shortest']:.2f}"
        f" m), minimum clearance {'-' if gap is None else f'{gap:.3f}'} m"
        + (f"; it stands: {'; '.join(stands)}" if stands else "")
        + (" (in simulation it cannot be re-armed)" if stands and given.chair is None else "")
        + ("" if given.chair is None else _timing(record))
    )
    arguments.report(given, record, text)
    return 0


def _real(
    given: argparse.Namespace, settings: dict[str, Any], scene: Any, mode: str
) -> tuple[Any, Any]:
    """An environment of a real chair, and with --goal the episode on the chair's map."""
    if given.shield == "off":
        raise InputError("--shield off is for the simulated chair; a real one always has a shield")
    if given.goal is None and given.scene is None:
        raise InputError("--chair: expected --goal X,Y on its own map, or --scene with one")
    if given.start is not None and len(given.start) != 3:
        raise InputError("--start of a real chair: expected X,Y,YAW (m, m, rad)")
    arguments.refuse(given, () if given.goal else ("start",), "expected with --goal")
    ignored = "map", "resolution", "unknown"
    arguments.refuse(given, ignored, "a real chair drives on its own map; deploy takes a file")
    named = arguments.chair_spec(given.chair)
    check_extras(named)
    if given.policy != "manual":  # which needs the window
        rehearse(arguments.spec(given.policy), settings)
    env, chair = arguments.real_chair_env(named, settings, scene=scene, render_mode=mode)
    try:
        episode = None if given.goal is None else chair.episode(given.goal, given.start)
        if given.goal is not None and episode is None:
            raise InputError(f"--goal: {given.chair} has no map of its own; expected --scene")
        return env, episode
    except BaseException:
        env.close()
        raise


def deploy(given: argparse.Namespace) -> int:
    """Drive a real chair to a goal; 0 when it arrived."""
    if len(given.start) != 3:
        raise InputError("--start: expected X,Y,YAW (m, m, rad)")
    limits = {"first": given.initial_speed, "rise": given.speed_ramp, "maximum": given.max_speed}
    config = Deployment(**{name: value for name, value in limits.items() if value is not None})
    chair = arguments.chair_spec(given.chair)
    check_extras(chair)
    policy = make_policy(arguments.spec(given.policy))
    settings = env_settings(config=given.config, pose_source=given.pose)
    episode = _episode(given, complete_env_settings(**settings).chair.footprint)
    if given.dry_run:
        chair = {"name": chair} if isinstance(chair, str) else chair
        if chair["name"] != "hardware":
            raise InputError(f"--dry-run: {given.chair} cannot be listened to; expected hardware")
        chair = {**chair, "dry_run": True}
    print("getting ready", file=sys.stderr)
    rehearse(arguments.spec(given.policy), settings)
    env, _ = arguments.real_chair_env(chair, settings, render_mode="rgb_array")

    def begin(env: Any) -> None:
        check_start(env, episode.start, given.force_start, to_stderr)

    try:
        env, film = arguments.watch(given).on(env)
        record = deploy_policy(env, policy, episode, config, to_stderr, given.dry_run, film, begin)
    finally:
        env.close()
    record |= {"policy": given.policy, "map": given.map, "goal": given.goal}
    ended = f"; {record['ended']}" if record["ended"] else ""
    arguments.report(
        given,
        record,
        f"{given.policy}: {record['outcome']} after {record['time']:.1f} s and "
        f"{record['length']:.2f} m (shortest {record['geodesic']:.2f} m), by its own estimate"
        f"{ended}{_timing(record)}",
    )
    return 0 if record["success"] or given.dry_run else 1


def assisted(given: argparse.Namespace) -> int:
    """Run a person's drive of a real chair with an assistant; 1 if the chair stopped for good."""
    from agents.people.drive import (
        Keyboard,
        PersonsStick,
        Stand,
        TimedAssistant,
        drive_with_help,
        open_space,
        without_goal,
    )
    from agents.people.recorded_stick import REST, prompt_text, schedule

    chair = arguments.chair_spec(given.chair)
    check_extras(chair)
    if not isinstance(chair_settings(chair), HardwareSettings):
        raise InputError(f"--chair {given.chair}: expected hardware, whose boards read a joystick")
    policy = {"name": "assisted", "assist": arguments.spec(given.assist)}
    driver, name = make_policy(policy), label(policy["assist"])
    if given.map is None:
        arguments.refuse(given, ("start", "unknown", "pose"), "expected with --map")
    prompts: list[list[float]] = []
    if given.prompts:
        why = "--prompts asks for full deflections while the chair stands, without an assistant"
        arguments.refuse(given, ("assist", "speed"), why)
        prompts = schedule(0, (1.0,) * 4 if given.input == "keyboard" else (1.0, 0.5))
        driver, name = Stand(), "prompts"
    helper = TimedAssistant(driver, name, given.deadline)
    pose = "odometry" if given.map is None else given.pose
    config = complete_env_settings(given.config, pose_source=pose, rate=given.rate)
    episode = open_space()
    if given.map is not None:
        if given.start is None or len(given.start) != 3:
            raise InputError("--map: expected --start X,Y,YAW, too (m, m, rad)")
        grid, walls = _map_of(given)
        _check_free(grid, "--start", given.start, given.map)
        episode = without_goal(grid, np.array(given.start), walls)
    rehearsed = dataclasses.replace(config.sensors, pose_source="truth")
    hand = config.hardware.joystick
    if given.input == "gamepad":
        load_extra("evdev")
        hand = dataclasses.replace(hand, device=hand.device or ANY)
    config = dataclasses.replace(
        config, task=dataclasses.replace(config.task, bump_ends=False),
        hardware=dataclasses.replace(config.hardware, joystick=hand),
    )  # fmt: skip
    print("getting ready", file=sys.stderr)
    rehearse(policy, {"config": dataclasses.replace(config, sensors=rehearsed), "driver": "expert"})
    share = hand.speed_fraction if given.speed is None else given.speed
    share = 1.0 if prompts else share
    stick = PersonsStick(share, time.monotonic, lambda: helper.fault)
    env, made = arguments.real_chair_env(
        chair, {"config": config}, person=stick, render_mode="rgb_array"
    )
    keys = None
    try:
        env.unwrapped.labels = {"interface": given.input, "share": share, "prompts": prompts}
        if not prompts:
            env.unwrapped.labels["assistant"] = arguments.spec(given.assist)
        env, film = arguments.watch(given).on(env)
        real: Any = unwrapped(made)
        real.person, real.assisted = stick.why, given.input == "board"
        if given.input == "keyboard":
            keys = Keyboard(share, lambda: rearm(real, env.unwrapped.shield))
            real.joystick = keys
        stick.source = keys or (real if given.input == "board" else real.joystick)

        end = prompts[-1][0] + REST if prompts else math.inf
        end = end if given.seconds is None else min(end, given.seconds)
        asked = iter(prompts)
        coming = next(asked, None)

        def each(now: Any) -> bool:
            nonlocal coming
            stamp, text = now.unwrapped.task.reading.stamp, ""
            if coming is not None and stamp >= coming[0] - 1e-9:
                text = prompt_text(*coming[1:])
                to_stderr(f"{stamp:7.1f} s  {text}")
                coming = next(asked, None)
            if keys is not None:
                keys.status = stick.why() or text or keys.status
                keys.poll(time.monotonic())
            film(now)
            return stamp >= end or (keys is not None and not keys.open)

        record = drive_with_help(env, helper, stick, episode, to_stderr, each)
    finally:
        env.close()
        helper.close()
        if keys is not None:
            keys.close()
    record |= {"assistant": None if prompts else given.assist, "input": given.input}
    ended = f"; {record['ended']}" if record["ended"] else ""
    text = (
        f"{record['assistant'] or 'prompts'}: {record['length']:.1f} m in {record['time']:.0f} s, "
        f"stood {record['stops']} times, changed the stick's twist for "
        f"{100.0 * record.get('intervention_share', 0.0):.0f} % of the time{ended}{_timing(record)}"
    )
    arguments.report(given, record, text)
    return 1 if record["ended"] else 0


def fit(given: argparse.Namespace) -> int:
    """Fit a simulated person to recorded sessions of a real one, and print its settings."""
    from agents.people.fit_driver import fit_driver
    from agents.people.recorded_stick import session_of

    sessions = []
    for file in given.logs:
        for recorded in read_recording(file):
            try:
                sessions.append(session_of(recorded))
            except InputError as error:
                raise InputError(f"{file}: {error}") from None
    base = make_driver(arguments.spec(given.base))
    found = fit_driver(sessions, base, given.repeats, given.seed)
    lines = [
        f"{name:24} {one.value:8.4f}  ({one.low:.4f} to {one.high:.4f})"
        for name, one in found.estimates.items()
    ]
    lines += [f"{name:24} not fitted: {why}" for name, why in found.unidentified.items()]
    lines += [json.dumps({"fitted": found.driver})]
    value = {
        "fitted": found.driver,
        "intervals": {name: [one.low, one.high] for name, one in found.estimates.items()},
        "not_fitted": found.unidentified,
        "figures": found.figures,
    }
    arguments.report(given, value, "\n".join(lines))
    return 0


def _map_of(given: argparse.Namespace) -> MapWithWalls:
    """Read --map for a real chair: localization needs its unknown cells, unless they are free."""
    free = given.unknown == "free" or (given.unknown is None and given.pose == "slam")
    return read_any_map(given.map, False if free else None)


def _check_free(grid: Any, name: str, place: Any, file: str) -> None:
    row, col = grid.to_cell(place[:2])
    if not grid.inside(place[:2]):
        fault = "outside the map"
    elif grid.cells[row, col] != FREE:
        known = grid.cells[row, col] == OCCUPIED
        fault = "not a free place" if known else "unknown (see --unknown), not a free place"
    else:
        return
    raise InputError(f"{name} {place[0]:g},{place[1]:g}: {fault} on {file}")


def _timing(record: dict[str, Any]) -> str:
    """Return the times of planning and of late steps as text; empty where there are none."""
    text = ""
    if record.get("plans_ms_max", 0.0) > 0.0:
        text += (
            f"; plans took {record['plans_ms_p50']:.0f} ms (95 %: {record['plans_ms_p95']:.0f}, "
            f"longest: {record['plans_ms_max']:.0f}), {record['late_plans']} came late and "
            f"{record['discarded_plans']} were discarded; meanwhile the chair drove on for "
            f"{record['thinking_drove_s']:.1f} s and stood for {record['thinking_stood_s']:.1f} s"
        )
    if record.get("late_steps"):
        text += f"; late steps: {record['late_steps']}, by {record['late_ms_max']:.0f} ms at most"
    return text


def _episode(given: argparse.Namespace, footprint: Any) -> Episode:
    """Map, free start and free goal; a goal without a heading gets the one with most clearance."""
    grid, walls = _map_of(given)
    for name, place in (("--start", given.start), ("--goal", given.goal)):
        _check_free(grid, name, place, given.map)
    goal = np.array([*given.goal, 0.0][:3])
    if len(given.goal) == 2:
        goal[2], clearance = best_clearance_heading(goal, footprint, walls, np.empty((0, 3)))
        if clearance <= 0.0:
            where = f"--goal {goal[0]:g},{goal[1]:g}"
            raise InputError(f"{where}: no heading is free of collisions on {given.map}")
    return Episode(grid, np.array(given.start), goal, walls, name=Path(given.map).stem)


def replay(given: argparse.Namespace) -> int:
    """Judge and draw recorded episodes again, or compare another policy with them; report."""
    if given.simulate:
        names = "video", "picture", "record", "live", "images"
        arguments.refuse(given, names, "expected without --simulate, which draws nothing")
        return replay_simulated(given)
    if given.config is not None or given.bar is not None:
        raise InputError("--config and --bar need --simulate")
    chapters = read_recording(given.file)
    chosen = range(len(chapters)) if given.episode is None else [given.episode]
    if given.episode is not None and given.episode >= len(chapters):
        raise InputError(f"--episode {given.episode}: {given.file} has {len(chapters)}, from 0")
    frames: list[Any] = []
    records, lines = [], []
    mode = "rgb_array" if given.video or given.picture or given.images else None
    viewers, env, each = arguments.watch(given), None, ignore
    try:
        for number in chosen:
            inner: Any = replay_env(chapters[number], mode)
            if env is None or not viewers:
                env, each = viewers.on(inner)
            else:
                env.env = inner  # one recording for all chapters
            record = {"episode": number} | _again(chapters[number], env, each, given, frames)
            if given.assist is not None:
                record |= open_loop(chapters[number], arguments.spec(given.assist))
            records.append(record)
            line = (
                f"episode {number}: {record['steps']} steps, reward {record['reward']:.4f}; "
                f"{'the same' if record['same'] else 'OTHER'} rewards"
            )
            if given.policy:
                line += f"; mean difference of {given.policy}'s action: {record['difference']:.3f}"
            if given.assist is not None:
                line += f"; {_said(given.assist, record)}"
            lines.append(line)
    finally:
        if env is not None:
            env.close()
    if given.video:
        write_video(given.video, frames, chapters[0].settings.rate)
    if given.picture:
        write_png(given.picture, frames[-1])
    arguments.report(given, records, "\n".join(lines))
    return 0 if all(record["same"] for record in records) else 1


def _said(name: str, record: dict[str, Any]) -> str:
    """Return the figures of `open_loop` in words."""
    before, other = record["recorded"], record["other"]
    angle, alike = record["difference_angle"], 100.0 * (1.0 - record["difference_share"])
    answers = "the same, to the bit" if record["same_answers"] else f"alike for {alike:.0f} % of it"
    beside = "" if angle is None else f", {np.degrees(angle):.1f} deg beside it on average"
    shares = (100.0 * figures.get("intervention_share", 0.0) for figures in (other, before))
    changes = "it changes the stick's twist for {:.0f} % of the time (recorded: {:.0f} %)"
    return f"{name} answers {answers}{beside}; {changes.format(*shares)}"


def _again(
    chapter: RecordedEpisode, env: Any, each: Each, given: argparse.Namespace,
    frames: list[Any],
) -> dict[str, Any]:  # fmt: skip
    """Judge an episode again; with a policy, compare its action at every step."""
    observation, _ = env.reset(seed=0, options={"episode": chapter.episode})
    policy = GymPolicy(make_policy(arguments.spec(given.policy)), env) if given.policy else None
    if policy is not None:
        policy.reset()
    rewards, same, differences = 0.0, True, []
    for action, verdict in zip(chapter.actions, chapter.verdicts, strict=True):
        if policy is not None:
            differences.append(np.abs(policy.act(observation) - np.clip(action, -1.0, 1.0)).mean())
        if given.video:
            frames.append(env.unwrapped.render())
        each(env)
        observation, reward, terminated, truncated, info = env.step(action)
        terms = info["reward_terms"].items()  # a term that an older recording lacks must be 0
        terms = {name: value for name, value in terms if name in verdict["terms"] or value != 0.0}
        judged = {"reward": reward, "terms": terms}
        judged |= {"terminated": terminated, "truncated": truncated}
        same &= judged == verdict
        rewards += reward
    if given.video or given.picture:
        frames.append(env.unwrapped.render())
    record = {"steps": len(chapter.actions), "reward": rewards, "same": same}
    return record | ({"difference": float(np.mean(differences))} if differences else {})
