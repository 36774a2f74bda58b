"""A policy on a real chair: slow at first, with a log of events, and always stopped at the end.

Before it drives, the start that a person gives is checked: how well the first scan fits the map
there and elsewhere. A scan that fits another place as well cannot tell the two apart: rooms may be
symmetric or alike.
"""

import logging
import math
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.evaluate import drive_episode, drive_on, make_env
from agents.evaluation.metrics import Record
from agents.policies import Policy, make_policy
from agents.watch import Each, ignore
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.planar import wrap, wrap_angle
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid
from wheelchair_gym.perception import monte_carlo
from wheelchair_gym.perception.localized_chair import unwrapped
from wheelchair_gym.perception.occupancy import Scan, read_scan
from wheelchair_gym.safety.stops import StopMonitor, active_stops, advice_for, shield_message
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Command, Episode, Mission, Reading

Log = Callable[[str], None]  # takes a line

_LOG = logging.getLogger(__name__)


@settings
class Deployment:
    """Limits of a policy's speed, and of the time that it may be halted."""

    first: float = setting(default=0.2, unit="m/s", low=0.02)
    """Cap of the speed at the start and after each halt."""
    rise: float = setting(default=0.05, unit="m/s2", low=0.0, source="0.8 m/s after 12 s")
    """Rate at which the cap rises while the chair drives."""
    maximum: float = setting(default=2.0, unit="m/s", low=0.02, high=2.0)
    """Highest cap; the limits of the chair hold besides."""
    patience: float = setting(default=20.0, unit="s", low=0.0)
    """Time after which an episode ends if sensors or a latched shield halt the chair."""

    def __post_init__(self) -> None:
        if self.maximum < self.first:
            raise InputError(f"the cap cannot rise from {self.first:g} to {self.maximum:g} m/s")


class Capped:
    """A policy whose twists are slowed, along the same arc, to a cap [m/s] that rises while driven.

    `latched` returns the fault for which the shield is latched; empty: none.
    """

    def __init__(
        self, policy: Policy, config: Deployment, latched: Callable[[], str] = lambda: ""
    ) -> None:
        self.policy, self.config, self.cap = policy, config, config.first
        self._latched = latched

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._limits, self._period, self.cap = mission.limits, mission.period, self.config.first
        self.policy.reset(mission)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        command, limits, config = self.policy.act(reading), self._limits, self.config
        if reading.halted or self._latched():
            self.cap = config.first
        else:
            self.cap = min(self.cap + config.rise * self._period, config.maximum, limits.forward)
        twist = limits.twist(command.as_action(limits))
        speed = abs(float(twist[0]))
        if speed <= self.cap:
            return command
        return command._replace(twist=twist * (self.cap / speed), action=None)


class EventLog:
    """Logs events once a control period, and ends an episode that cannot continue.

    With `commands`, every command is logged, and the episode is not ended. `ended` is the reason
    for which it was ended; empty: it was not.
    """

    def __init__(self, config: Deployment, log: Log, commands: bool = False) -> None:
        self._config, self._log, self._commands = config, log, commands
        self._stops = StopMonitor()
        self.ended = ""

    def __call__(self, env: Any) -> bool:
        """Log the last step of the environment; whether the episode has to end."""
        env = env.unwrapped
        now, stops = env.task.reading.stamp, self._stops
        for line in stops.update(now, active_stops(env.task.reading.halted, env.shield)):
            self._log(f"{now:7.1f} s  {line}")
        if env.shield is not None and (fault := env.shield.refused()):
            advice = advice_for(shield_message(fault))
            self._log(f"{now:7.1f} s  not re-armed: {fault}, still; {advice}")
        chair: Any = unwrapped(env.chair)
        if self._commands and now > 0.0:
            (v, w), (x, y, yaw) = chair.commanded, env.task.reading.pose
            command = f"v {v:6.3f} m/s  w {w:6.3f} rad/s  at ({x:.2f}, {y:.2f}, {yaw:.2f})"
            self._log(f"{now:7.1f} s  {command}")
        if chair.latched:  # until a person re-arms the chair and it is reset
            self.ended = stops.why
        elif stops.waited > self._config.patience:
            self.ended = f"{stops.why}, for {self._config.patience:g} s"
        return bool(self.ended) and not self._commands

    def outcome(self, record: Record) -> Record:
        """An episode's record, with its outcome where the episode was ended."""
        halted = {"outcome": "halted", "success": False} if self.ended else {}
        return record | halted | {"ended": self.ended}


def deploy(
    env: Any,
    policy: Policy,
    episode: Episode,
    config: Deployment,
    log: Log,
    commands: bool = False,
    film: Each = ignore,
    begin: Each = ignore,
) -> Record:
    """Drive a real chair to an episode's goal.

    Args:
        env: of the chair.
        policy: drives, under the cap.
        episode: map, start and goal.
        config: cap and patience.
        log: takes the lines of the log.
        commands: log every command; never end the episode.
        film: is called with the environment after reset and each step, too.
        begin: is called with the environment after reset, before anything is driven; may raise.

    Returns:
        Figures as of `drive_episode`, by the chair's estimated poses; `ended`, the reason for which
        the episode was ended; `late_steps` and `late_ms_max`, the control periods that ended more
        than 10 ms late, and the longest delay.
    """
    events, shield = EventLog(config, log, commands), env.unwrapped.shield
    steps = 0

    def watch(now: Any) -> bool:
        nonlocal steps
        if steps == 0:
            begin(now)
        steps += 1
        film(now)
        return events(now)

    capped = Capped(policy, config, lambda: shield.latched if shield else "")
    return events.outcome(drive_episode(env, capped, 0, watch, episode) | late_steps(env))


def narrow_gap() -> Episode:
    """A goal behind a wall with a gap that may be too narrow: what blocks every plan of a chair."""
    cells = np.full((80, 160), FREE, np.int8)
    cells[:4], cells[-4:], cells[:, :4], cells[:, -4:], cells[:, 78:82] = 5 * (OCCUPIED,)
    cells[34:46, 78:82] = FREE  # 0.6 m
    grid = OccupancyGrid(cells, 0.05, (0.0, 0.0, 0.0))
    return Episode(grid, np.array([2.0, 2.0, 0.0]), np.array([6.0, 2.0, 0.0]), grid.walls())


def late_steps(env: Any) -> Record:
    """Count of a real chair's late control periods, and the largest delay."""
    delays = [1e3 * delay for _, delay in unwrapped(env.unwrapped.chair).late]
    return {"late_steps": len(delays), "late_ms_max": max(delays, default=0.0)}


REHEARSED = 300  # steps at most of each drive


def rehearse(policy: Any, settings: Mapping[str, Any]) -> None:
    """Drive in simulation, so that nothing compiles once a person sits in the chair.

    The drives lead around sudden obstacles, and to a goal that cannot be reached: there a policy
    does all that it can do.

    Args:
        policy: a spec for `make_policy`.
        settings: keyword settings of the environment.
    """
    for seed, options in ((2, None), (0, {"episode": narrow_gap()})):
        env = make_env("temporary", settings)
        observation, _ = env.reset(seed=seed, options=options)
        check_start(env, env.unwrapped.episode.start, True, lambda _: None)
        drive_on(env, make_policy(policy), observation, REHEARSED)
        env.close()


def check_start(env: Any, start: Array, confirmed: bool, log: Log) -> None:
    """Log how well the first scan, after reset, fits the map at a start (3,) [m, m, rad].

    Raises:
        InputError: it fits badly, or another place as well, and the start is not confirmed.
    """
    env = env.unwrapped
    laser = env.settings.sensors.laser
    found = start_fit(env.episode.map, start, laser, env.task.reading.laser[: laser.beams])
    x, y, yaw = start.tolist()
    off = np.hypot(*(found.pose - start)[:2])
    turn = np.degrees(abs(wrap(float(found.pose[2] - yaw))))
    text = f"the scan fits the map with {found.fit:.2f} of 1 at --start {x:g},{y:g},{yaw:g}"
    why, what = found.wrong, "correct it, or add --force-start"
    if found.ambiguous and not why:
        there = ",".join(f"{value:.2f}" for value in found.elsewhere)
        why = f"it fits {found.better:.2f} at {there}, too, and cannot tell these places apart"
        what = "look where the chair stands; if --start is right, add --force-start"
    if not why:
        log(f"{text}, best {off:.2f} m and {turn:.0f} deg beside it")
    elif confirmed:
        log(f"{text}: {why}; driven all the same (--force-start)")
    else:
        raise InputError(f"{text}: {why}; {what}")


def to_stderr(line: str) -> None:
    """Write a line of the log to standard error."""
    print(line, file=sys.stderr, flush=True)


def end_as_by_ctrl_c() -> None:
    """SIGTERM and SIGHUP end this program as Ctrl-C does, so that the chair is stopped."""
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)


def listen_for_rearm(driven: Any, shield: Any = None) -> None:
    """Listen for Enter at the terminal: it re-arms a chair that waits for a person, or its shield.

    From now on, the log names what the chair waits for at reset and how to re-arm it.
    """
    chair: Any = unwrapped(driven)
    terminal = sys.stdin is not None and sys.stdin.isatty()
    if chair.needs_rearm:
        chair.on_wait = lambda line: _LOG.warning("%s", _how_to_rearm(chair, line, terminal))
    if not terminal or (shield is None and not chair.needs_rearm):
        return

    def listen() -> None:
        for _ in sys.stdin:
            if chair.waiting_for or (shield is not None and shield.latched):
                rearm(chair, shield)

    print("Enter re-arms the chair while it waits for a person", file=sys.stderr)
    threading.Thread(target=listen, name="person", daemon=True).start()


def rearm(chair: Any, shield: Any) -> None:
    """Re-arm a chair and its shield, as a person does."""
    chair.rearm()
    if shield is not None:
        shield.rearm()


def _how_to_rearm(chair: Any, line: str, terminal: bool) -> str:
    """A line, with the ways to re-arm the chair if it waits for that."""
    if not chair.waiting_for:
        return line
    ways = ["Enter here"] if terminal else []
    if (hand := getattr(chair.joystick, "error", None)) is not None:
        button = chair.joystick.settings.rearm_button
        ways.append(f"button {button} of the host's joystick" + (f" ({hand})" if hand else ""))
    ways.append("the joystick of the drive board: manual, then hold")
    return f"{line}: {advice_for(line)}, then {', or '.join(ways)}"


_BEAMS, _FEW = 180, 20  # of a scan, evenly: for the fit, and to preselect poses nearby
_LENIENT = 3.0  # factor of sigma while preselecting: a better pose may lie between two
_CLIMBED = 12  # preselected poses from which hill climbing starts
MIN_FIT = 0.45  # fit of the scan at an accepted start: measured in simulation 0.56 and more at true
# starts, median 0.12 at those far off
BETTER = 0.15  # the start is wrong if a place nearby fits better by this much
ECHOES = 0.05  # least share of beams with an echo; with fewer, the scan does not allow a check
POSITION, HEADING = 0.4, math.radians(12.0)  # m, rad: errors that localization corrects
AROUND, STEP = 2.0, 0.25  # m: how far from the start places are compared, and how far apart
TURN = math.radians(15.0)  # between the headings that are compared
ALIKE = 0.05  # a place anywhere on the map that fits nearly as well makes the start ambiguous
_PLACES = 60_000  # of the whole map: on larger maps they lie farther apart
_APART, _TURNED = 1.0, math.radians(30.0)  # m, rad: at least, between places to climb from


class StartFit(NamedTuple):
    """Fit of a scan to a map at a start."""

    fit: float  # likelihood of a beam at the start, 0 to 1
    pose: Array  # (3,) m, m, rad: the best pose near the start
    better: float  # the best fit elsewhere on the map
    elsewhere: Array  # (3,) m, m, rad: the pose of that fit
    wrong: str  # why the start is refused; empty: it is accepted
    ambiguous: bool = False  # the scan fits as well elsewhere: a person has to confirm the start


def start_fit(
    grid: OccupancyGrid, start: Array, laser: LaserSettings, ranges: NDArray[np.float32]
) -> StartFit:
    """Compare a scan (beams,) [m] with a map at a start (3,) [m, m, rad], and at other places."""
    model = monte_carlo.LocalizationSettings()
    scan = read_scan(laser, ranges)
    share = len(scan.echoes) / laser.beams
    if share < ECHOES:
        wrong = f"{share:.0%} of the laser's beams have an echo; expected {ECHOES:.0%} or more"
        return StartFit(0.0, start, 0.0, start, wrong)
    field = monte_carlo.make_likelihood_field(grid, model.sigma)
    ends = _some(scan, _BEAMS)

    def climbed(pose: Array) -> tuple[float, Array]:
        end = np.array(pose, np.float64)
        return math.exp(monte_carlo.hill_climb(field, ends, math.radians(3.0), end)), end

    def near_start(pose: Array) -> bool:
        distance = math.hypot(pose[0] - start[0], pose[1] - start[1])
        return distance <= POSITION and abs(wrap(pose[2] - start[2])) <= HEADING

    fit, pose = climbed(start)
    if not near_start(pose):
        x, y, yaw = start.tolist()
        fit = math.exp(monte_carlo.log_likelihood(field, x, y, yaw, ends))
        pose = start
    climbs = map(climbed, _preselected(grid, field, start, _some(scan, _FEW)))
    others = [(other, end) for other, end in climbs if not near_start(end)]
    around = [one for one in others if math.hypot(*(one[1] - start)[:2]) <= AROUND + STEP]
    better, elsewhere = max(around, key=itemgetter(0), default=(0.0, start))
    if better > fit + BETTER:
        x, y, yaw = elsewhere
        wrong = f"it fits {better:.2f} at {x:.2f},{y:.2f},{yaw:.2f}"
        return StartFit(fit, pose, better, elsewhere, wrong)
    better, elsewhere = max(others, key=itemgetter(0), default=(0.0, start))
    wrong = f"expected {MIN_FIT:g} or more" if fit < MIN_FIT else ""
    return StartFit(fit, pose, better, elsewhere, wrong, better > fit - ALIKE)


def _some(scan: Scan, maximum: int) -> Array:
    """Echoes (n, 2) [m] of a scan, evenly chosen."""
    ends = scan.echoes
    chosen = np.linspace(0, len(ends) - 1, min(len(ends), maximum)).astype(int)
    return np.ascontiguousarray(ends[chosen])


@kernel
def _fits(
    field: monte_carlo.LikelihoodField, places: Array, headings: Array, ends: Array, fits: Array
) -> None:
    """Write the log-likelihood of a scan at places (n, 2) with headings (m,) into (n, m)."""
    for i in range(places.shape[0]):
        for j in range(headings.shape[0]):
            fits[i, j] = monte_carlo.log_likelihood(
                field, places[i, 0], places[i, 1], headings[j], ends
            )


def _preselected(
    grid: OccupancyGrid, field: monte_carlo.LikelihoodField, start: Array, few: Array
) -> list[Array]:
    """Return the best fitting poses (3,) around a start, and the best of the rest of the map.

    Those of the rest are apart from each other, so that each is another place.
    """
    headings = start[2] + np.arange(0.0, 2.0 * math.pi - 1e-9, TURN)
    lenient = field._replace(sigma=_LENIENT * field.sigma)
    x0, y0, x1, y1 = grid.bounds
    step = max(STEP, math.sqrt((x1 - x0) * (y1 - y0) / _PLACES))
    offsets = np.arange(-AROUND, AROUND + 0.5 * STEP, STEP)
    chosen: list[Array] = []
    for rest, xs, ys in (  # around the start everything is compared
        (False, start[0] + offsets, start[1] + offsets),
        (True, np.arange(x0, x1, step), np.arange(y0, y1, step)),
    ):
        places = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        places = places[grid.inside(places)]
        places = places[grid.cells[tuple(grid.to_cell(places).T)] == FREE]
        fits = np.empty((len(places), len(headings)))
        _fits(lenient, places, headings, few, fits)
        if rest:
            fits[np.hypot(*(places - start[:2]).T) <= AROUND] = -math.inf
        for _ in range(min(_CLIMBED, fits.size)):
            place, heading = np.unravel_index(np.argmax(fits), fits.shape)
            if fits[place, heading] == -math.inf:
                break
            chosen.append(np.append(places[place], headings[heading]))
            if rest:
                near = np.hypot(*(places - places[place]).T) < _APART
                turned = np.abs(wrap_angle(headings - headings[heading])) < _TURNED
                fits[np.ix_(near, turned)] = -math.inf
            fits[place, heading] = -math.inf
    return chosen
