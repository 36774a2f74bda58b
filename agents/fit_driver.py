"""Settings of a simulated person, fitted to recorded sessions of a person at a stick or switches.

A drive tells how the hand trembles, and the stick's dead zone. Which deflection the person meant it
does not tell. A prompted session does (`wheelchair drive --prompts`): the chair stands, and the
person is asked for one deflection after another. From it follow delay, lag, weakness by direction,
rotation and offset of a stick, and delay and wrong signals of switches. What a session cannot tell
keeps the value of a person to begin with, and is named.

Methods: the hand's response by output-error minimization (Ljung 1999, section 7.2); the tremor by
maximum likelihood of its spectrum (Whittle 1953) from averaged periodograms (Welch 1967), with a
power law for voluntary movement; the dead zone from the grid of values that a stick's steps leave;
95 % intervals by the bootstrap (Efron 1979) over prompts, or over stretches of a drive.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize
from scipy.signal import lfilter

from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.config import InputError, dump
from wheelchair_gym.drivers import make_driver
from wheelchair_gym.drivers.intention import NEAR_GOAL
from wheelchair_gym.drivers.settings import Driver, Hand, ProportionalStick, Switches
from wheelchair_gym.drivers.state import TICK_RATE, tremor_filter
from wheelchair_gym.recording.replay import RecordedEpisode

Array = NDArray[np.float64]

TICK = 1.0 / TICK_RATE  # s
HOLD, REST = 2.5, 2.0  # s for which a prompt asks for a deflection, and for the centre after it
LEAST_RATE = 25.0  # Hz: sessions recorded more slowly show a tremor at wrong frequencies
STRETCH = 2.56  # s of an uninterrupted deflection that give one periodogram
LEAST_STRETCHES = 6
_EVIDENCE = 10.0  # by which a tremor must raise the log-likelihood: of three parameters, P < 1e-3
_ON_GRID = 0.03  # mean squared distance to the grid, in steps; at random 1/12
_ZONES = np.arange(0.0, 0.5, 2e-4)  # dead zones that are tried
_NAMES = {
    "delay": "delay", "lag": "hand.lag", "return_lag": "hand.return_lag",
    "forward": "hand.forward", "backward": "hand.backward", "leftward": "hand.leftward",
    "rightward": "hand.rightward", "rotation": "hand.rotation",
    "offset_forward": "hand.offset_forward", "offset_left": "hand.offset_left",
}  # fmt: skip
_TREMOR = "hand.tremor", "hand.tremor_frequency", "hand.tremor_band"
_LOW = np.array([0.0, 0.005, 0.005, 0.05, 0.05, 0.05, 0.05, -0.8, -0.5, -0.5])
_HIGH = np.array([2.5, 1.5, 1.5, 1.0, 1.0, 1.0, 1.0, 0.8, 0.5, 0.5])
_STEADY = np.zeros((0, 2))  # no tremor
_FULL = 0.92  # deflection from which on the stick's end cuts a tremor off
_CORRECTIONS = 10  # simulated sessions by which a bias is found
_START = np.array([0.4, 0.1, 0.1, 0.8, 0.8, 0.8, 0.8, 0.0, 0.0, 0.0])


class Session(NamedTuple):
    """The stick of one recorded session."""

    period: float  # s between two sticks
    sticks: Array  # (n, 2) forward, left
    latched: bool  # a stick of it was
    near_goal: NDArray[np.bool_]  # (n,) where a tremor may be larger
    prompts: Array  # (k, 3) s, forward, left; none in a drive
    interface: str  # which was held
    share: float  # of full speed at full deflection


class Estimate(NamedTuple):
    """A fitted setting with its 95 % interval."""

    value: float
    low: float
    high: float


class Fit(NamedTuple):
    """What was fitted.

    Attributes:
        driver: settings that `make_driver` takes; what was not identified is that of the person to
            begin with.
        estimates: by the setting's name.
        unidentified: why a setting was not fitted, by its name.
        figures: other figures of the sessions.
    """

    driver: dict[str, Any]
    estimates: dict[str, Estimate]
    unidentified: dict[str, str]
    figures: dict[str, float]


def schedule(
    seed: int, sizes: Sequence[float] = (1.0, 0.5), directions: int = 8
) -> list[list[float]]:
    """Prompts in an order that cannot be foreseen: rows of time [s], forward, left.

    Args:
        seed: of the order.
        sizes: deflections that each direction is asked for; of switches, 1 each time.
        directions: 8, or 4 without those between.

    Returns:
        Rows; between two deflections the centre is asked for.
    """
    ways = [
        (x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if 0 < abs(x) + abs(y) < directions / 2.5
    ]
    asked = [(size * x / math.hypot(x, y), size * y / math.hypot(x, y))
             for x, y in ways for size in sizes]  # fmt: skip
    order = np.random.default_rng(seed).permutation(len(asked))
    rows, now = [[0.0, 0.0, 0.0]], REST
    for k in order:
        rows += [[now, *asked[k]], [now + HOLD, 0.0, 0.0]]
        now += HOLD + REST
    return rows


def prompt_text(forward: float, left: float) -> str:
    """What a person is asked for."""
    if forward == left == 0.0:
        return "let go: centre"
    ways = [("forward", forward), ("backward", -forward), ("left", left), ("right", -left)]
    size = "fully" if math.hypot(forward, left) > 0.75 else "by half"
    return f"push {size} {' and '.join(name for name, value in ways if value > 0.1)}"


def session_of(recorded: RecordedEpisode) -> Session:
    """The stick of a recorded episode.

    Raises:
        InputError: no person drove.
    """
    if not recorded.has_person:
        raise InputError("expected recordings in which a person drives")
    found: Any = [state.reading.stick for state in recorded.states]
    labels, places = recorded.labels, np.array([state.truth.pose[:2] for state in recorded.states])
    near = np.hypot(*(places - recorded.episode.goal[:2]).T) < NEAR_GOAL
    known = recorded.settings.driver is not None
    return Session(
        1.0 / recorded.settings.rate,
        np.array([(stick.forward, stick.left) for stick in found]),
        any(stick.latched for stick in found),
        near if known else np.zeros(len(found), np.bool_),
        np.array(labels.get("prompts", []), np.float64).reshape(-1, 3),
        {"board": "stick", "gamepad": "stick", "keyboard": "switches"}.get(
            str(labels.get("interface", "stick")), str(labels.get("interface", "stick"))
        ),
        float(labels.get("share", 1.0)),
    )


def fit_driver(sessions: list[Session], base: Driver, repeats: int = 100, seed: int = 0) -> Fit:
    """Fit a driver's hand and interface to sessions of one person with one interface.

    Args:
        sessions: of the person.
        base: settings of what is not fitted, such as the stick's filter and steps.
        repeats: of the bootstrap.
        seed: of the bootstrap.

    Raises:
        InputError: the sessions have different interfaces, or one that cannot be fitted.
    """
    kinds = {session.interface for session in sessions}
    if len(kinds) != 1:
        raise InputError(f"sessions with {' and '.join(sorted(kinds))}: expected one interface")
    (kind,) = kinds
    if kind not in ("stick", "switches"):
        raise InputError(f"interface {kind}: expected sessions with a stick or with switches")
    if base.interface.kind != kind:
        made: Any = ProportionalStick() if kind == "stick" else Switches()
        base = dataclasses.replace(base, interface=made)
    rng = np.random.default_rng(seed)
    fit = (_fit_stick if kind == "stick" else _fit_switches)(sessions, base, repeats, rng)
    settings = _settings(base, fit.estimates, sessions)
    make_driver(settings)
    return fit._replace(driver=settings)


def _settings(
    base: Driver, estimates: dict[str, Estimate], sessions: list[Session]
) -> dict[str, Any]:
    """The fitted driver as `make_driver` takes it."""
    settings = {"name": "expert", **dump(base)}
    if base.interface.kind == "switches":
        settings["interface"]["latched"] = any(session.latched for session in sessions)
    for name, estimate in estimates.items():
        part, _, key = name.partition(".")
        if key:
            settings[part][key] = estimate.value
    if "delay" in estimates:  # of the reaction and of the interface: their sum is seen
        most = max(0.0, estimates["delay"].value)
        reaction = min(settings["perception"]["reaction"], most)
        settings["perception"]["reaction"] = reaction
        settings["interface"]["delay"] = most - reaction
    return settings


# ---- a stick


def _fit_stick(
    sessions: list[Session], base: Driver, repeats: int, rng: np.random.Generator
) -> Fit:
    estimates: dict[str, Estimate] = {}
    unidentified: dict[str, str] = {}
    device, hand = base.interface, base.hand
    zone = _dead_zone(sessions, device.levels)
    if zone is None:
        unidentified["interface.dead_zone"] = (
            f"the stick's values are not those of {device.levels:g} steps with one dead zone; "
            f"{device.dead_zone:g} is assumed"
        )
    else:
        estimates["interface.dead_zone"] = zone
        device = dataclasses.replace(device, dead_zone=zone.value)
    prompted = [session for session in sessions if len(session.prompts)]
    if prompted:
        fit = _HandFit(prompted, device)
        best = fit.best()
        values = {name.partition(".")[2]: float(best[k]) for k, name in enumerate(_NAMES.values())}
        hand = dataclasses.replace(hand, **{k: v for k, v in values.items() if k})
    else:
        why = "a drive does not tell which deflection was meant: record one with --prompts"
        unidentified |= dict.fromkeys(_NAMES.values(), why)
    tremor, why = _tremor(sessions, device, hand, repeats, rng)
    if prompted:
        for name, found in tremor.items():
            hand = dataclasses.replace(hand, **{name.partition(".")[2]: found.value})
        hand = hand if tremor else dataclasses.replace(hand, tremor=0.0)
        estimates |= _hand_estimates(fit, best, prompted, hand, repeats, rng)
    estimates |= tremor
    for name in _TREMOR:
        if name not in tremor:
            unidentified[name] = why
    minutes = sum(len(one.sticks) * one.period for one in sessions) / 60.0
    return Fit({}, estimates, unidentified, {"minutes": minutes})


def _raw(sticks: Array, device: Any, share: float) -> Array:
    """Deflections (n, 2) before the dead zone; NaN where the stick is within it."""
    size = np.hypot(*sticks.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        before = device.dead_zone + (1.0 - device.dead_zone) * size / (device.gain * share)
        raw: Array = sticks * (before / size)[:, None]
    raw[size == 0.0] = math.nan
    return raw


def _dead_zone(sessions: list[Session], levels: float) -> Estimate | None:
    """The dead zone with which all values before it are whole steps; None: no one is."""
    sticks = np.concatenate([one.sticks / one.share for one in sessions])
    sticks = np.unique(sticks[np.hypot(*sticks.T) > 0.0], axis=0)
    if len(sticks) < 20:
        return None
    if len(sticks) > 400:
        sticks = sticks[:: len(sticks) // 400]
    size = np.hypot(*sticks.T)
    free = (size < 0.999) & (np.abs(sticks).max(axis=1) < 0.999)  # others are clipped
    steps = levels * sticks[free] / size[free, None]
    off = np.array([_off_grid(steps * (z + (1.0 - z) * size[free])[:, None]) for z in _ZONES])
    best = int(np.argmin(off))
    if off[best] > _ON_GRID:
        return None
    near = _ZONES[off < max(2.0 * off[best], 0.5 * _ON_GRID)]
    near = near[np.abs(near - _ZONES[best]) < 0.01]
    return Estimate(float(_ZONES[best]), float(near.min()), float(near.max()))


def _off_grid(steps: Array) -> float:
    return float(np.mean((steps - np.rint(steps)) ** 2))


@kernel
def _respond(
    times: Array, asked: Array, p: Array, zone: float, gain: float, smoothing: float, every: float,
    tremor: Array, out: Array,
) -> None:  # fmt: skip
    """The stick (n, 2), sampled at a period of ticks, of a hand that follows prompts.

    times (k,) in ticks, asked (k, 2); p as in _NAMES; tremor (ticks, 2), or (0, 2) for none.
    """
    tick = 0.01
    go, back = 1.0 - math.exp(-tick / p[1]), 1.0 - math.exp(-tick / p[2])
    hx = hy = fx = fy = 0.0
    share = 1.0 if smoothing < 0.1 * tick else 1.0 - math.exp(-tick / smoothing)
    c, s = math.cos(p[7]), math.sin(p[7])
    n, row, k = 0, -1, 0
    while n < out.shape[0]:
        now = k + 1.0 - p[0] / tick
        while row + 1 < times.shape[0] and times[row + 1] <= now:
            row += 1
        # Within the tick in which a prompt takes effect, a share of it does: smooth in the delay.
        x = y = 0.0
        if row >= 0:
            part = min(1.0, now - times[row])
            before = max(0, row - 1)
            x = part * asked[row, 0] + (1.0 - part) * asked[before, 0]
            y = part * asked[row, 1] + (1.0 - part) * asked[before, 1]
        size = math.hypot(x, y)
        if size > 0.0:
            more = (zone + (1.0 - zone) * min(1.0, size)) / size
            x, y = x * more, y * more
        hx += (x - hx) * (back if abs(x) < abs(hx) else go)
        hy += (y - hy) * (back if abs(y) < abs(hy) else go)
        tx, ty = hx, hy
        if k < tremor.shape[0]:
            tx, ty = hx + tremor[k, 0], hy + tremor[k, 1]
        wx = tx * (p[3] if tx > 0.0 else p[4])
        wy = ty * (p[5] if ty > 0.0 else p[6])
        rx, ry = c * wx - s * wy + p[8], s * wx + c * wy + p[9]
        fx += (min(1.0, max(-1.0, rx)) - fx) * share
        fy += (min(1.0, max(-1.0, ry)) - fy) * share
        k += 1
        if k >= (n + 1) * every - 0.5:
            far = math.hypot(fx, fy)
            give = gain * (far - zone) / (1.0 - zone) / far if far > zone else 0.0
            out[n, 0] = min(1.0, max(-1.0, give * fx))
            out[n, 1] = min(1.0, max(-1.0, give * fy))
            n += 1


class _HandFit:
    """The hand that predicts the stick after prompts best: delay, lags, weakness, rotation, offset.

    Args:
        sessions: with prompts.
        device: the stick.
    """

    def __init__(self, sessions: list[Session], device: Any) -> None:
        self._sessions, self._device = sessions, device
        self.prompts = sum(len(one.prompts) for one in sessions)
        before = np.cumsum([0, *(len(one.prompts) for one in sessions)])
        of = [
            np.searchsorted(one.prompts[:, 0] / one.period, np.arange(len(one.sticks)), "right")
            for one in sessions
        ]
        self._of = np.concatenate(  # which prompt each stick belongs to
            [np.maximum(rows - 1, 0) + first for rows, first in zip(of, before, strict=False)]
        )

    def sticks(self, p: Array, tremors: list[Array] | None = None) -> list[Array]:
        """The sticks (n, 2) of each session, by parameters as in _NAMES."""
        device, found = self._device, []
        for k, one in enumerate(self._sessions):
            out = np.zeros((len(one.sticks), 2))
            times = one.prompts[:, 0] / TICK
            _respond(
                times, one.prompts[:, 1:], p, device.dead_zone, device.gain * one.share,
                device.smoothing, one.period / TICK, tremors[k] if tremors else _STEADY, out[1:],
            )  # fmt: skip
            found.append(out)
        return found

    def solve(self, start: Array, sticks: list[Array], weights: Array, exact: bool = True) -> Any:
        """The best parameters for sticks, with a weight for each prompt."""
        root, seen = np.sqrt(weights[self._of])[:, None], np.concatenate(sticks)

        def residuals(p: Array) -> Array:
            off: Array = ((np.concatenate(self.sticks(p)) - seen) * root).ravel()
            return off

        tolerance = 1e-8 if exact else 1e-4
        return least_squares(
            residuals, np.clip(start, _LOW + 1e-6, _HIGH - 1e-6), bounds=(_LOW, _HIGH),
            diff_step=1e-4, x_scale=0.1, ftol=tolerance, xtol=tolerance,
        )  # fmt: skip

    def best(self) -> Array:
        """The best parameters for the recorded sticks, from several delays on."""
        sticks, ones = [one.sticks for one in self._sessions], np.ones(self.prompts)
        starts = [np.array([delay, *_START[1:]]) for delay in np.arange(0.1, 1.3, 0.1)]
        seen = np.concatenate(sticks)
        starts.sort(key=lambda p: float(((np.concatenate(self.sticks(p)) - seen) ** 2).sum()))
        tried = [self.solve(start, sticks, ones) for start in starts[:3]]
        found: Array = min(tried, key=lambda one: float(one.cost)).x
        return found

    def tremors(self, hand: Hand, rng: np.random.Generator) -> list[Array]:
        """Drawn tremors (ticks, 2) of each session."""
        a, b, gain = tremor_filter(hand, TICK)
        ticks = [round(len(one.sticks) * one.period / TICK) for one in self._sessions]
        return [lfilter([gain], [1.0, -a, b], rng.normal(size=(n, 2)), axis=0) for n in ticks]


def _hand_estimates(
    fit: _HandFit, best: Array, sessions: list[Session], hand: Hand, repeats: int,
    rng: np.random.Generator,
) -> dict[str, Estimate]:  # fmt: skip
    """The hand's parameters without the bias that a tremor gives them, with intervals.

    A tremor that the dead zone and the stick's ends cut shifts the mean. The shift is that of
    sessions simulated with the parameters and the tremor found (bootstrap bias correction, Efron
    and Tibshirani 1993, chapter 10).
    """
    ones, bias = np.ones(fit.prompts), np.zeros(len(best))
    if hand.tremor > 0.0:
        drawn = [
            fit.solve(best, fit.sticks(best, fit.tremors(hand, rng)), ones, False).x
            for _ in range(_CORRECTIONS)
        ]
        bias = np.mean(drawn, axis=0) - best
    resampled = []
    for _ in range(repeats):
        weights = np.bincount(rng.integers(fit.prompts, size=fit.prompts), minlength=fit.prompts)
        one = fit.solve(best, [s.sticks for s in sessions], weights.astype(np.float64), False)
        resampled.append(np.clip(one.x - bias, _LOW, _HIGH))
    corrected = np.clip(best - bias, _LOW, _HIGH)
    return {
        name: _estimate(corrected[k], [one[k] for one in resampled])
        for k, name in enumerate(_NAMES.values())
    }


def _estimate(value: float, drawn: list[float]) -> Estimate:
    low, high = np.percentile(drawn, (2.5, 97.5)) if drawn else (value, value)
    return Estimate(float(value), float(min(low, value)), float(max(high, value)))


# ---- its tremor


def _periodograms(sessions: list[Session], device: Any, hand: Hand) -> tuple[Array, Array, float]:
    """Frequencies (m,) [Hz], periodograms (k, m) [1/Hz] of stretches, and their rate [Hz]."""
    rate = 1.0 / sessions[0].period
    n = round(STRETCH * rate)
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(n) / n)
    scale = 2.0 / (rate * float((window**2).sum()))
    line = np.linspace(-1.0, 1.0, n)
    c, s = math.cos(hand.rotation), math.sin(hand.rotation)
    found = []
    for one in sessions:
        raw = _raw(one.sticks, device, one.share)
        raw[one.near_goal] = math.nan
        raw = raw - (hand.offset_forward, hand.offset_left)
        x, y = c * raw[:, 0] + s * raw[:, 1], -s * raw[:, 0] + c * raw[:, 1]
        axes = (x, hand.forward, hand.backward), (y, hand.leftward, hand.rightward)
        for values, above, below in axes:
            good = np.isfinite(values)
            full = np.abs(values) > _FULL
            values = values / np.where(values > 0.0, above, below)
            at = 0
            while at + n <= len(values):
                if not good[at : at + n].all():
                    at += 1 + int(np.flatnonzero(~good[at : at + n])[-1])
                    continue
                part, cut = values[at : at + n], full[at : at + n].any()
                at += n // 2
                if cut:
                    continue
                part = part - np.polyval(np.polyfit(line, part, 1), line)
                found.append(scale * np.abs(np.fft.rfft(part * window)) ** 2)
    return np.asarray(np.fft.rfftfreq(n, 1.0 / rate), np.float64), np.array(found), rate


class _Tremor(NamedTuple):
    """A hand's tremor, without the checks of its settings."""

    tremor: float
    tremor_frequency: float  # Hz
    tremor_band: float  # Hz


def _tremor_spectrum(f: Array, rate: float, hand: Any, smoothing: float) -> Array:
    """One-sided spectrum (m,) [1/Hz] of a tremor behind the stick's filter, folded by sampling."""
    a, b, gain = tremor_filter(hand, TICK)
    folds = round(TICK_RATE / rate)
    every = [f] + [sign * f + k * rate for k in range(1, folds // 2 + 1) for sign in (-1.0, 1.0)]
    total = np.zeros_like(f)
    share = 1.0 if smoothing < 0.1 * TICK else 1.0 - math.exp(-TICK / smoothing)
    for g in every:
        z = np.exp(-2j * math.pi * np.abs(g) * TICK)
        shape = gain**2 / np.abs(1.0 - a * z + b * z * z) ** 2
        filtered = share**2 / np.abs(1.0 - (1.0 - share) * z) ** 2
        total += np.where(np.abs(g) <= 0.5 * TICK_RATE, 2.0 * TICK * shape * filtered, 0.0)
    # What Hann's window makes of it.
    wide = np.concatenate((total[1:2], total, total[-2:-1]))
    blurred: Array = (wide[:-2] + 4.0 * wide[1:-1] + wide[2:]) / 6.0
    return blurred


def _tremor(
    sessions: list[Session], device: Any, hand: Hand, repeats: int, rng: np.random.Generator
) -> tuple[dict[str, Estimate], str]:
    """The tremor's amplitude, frequency and band, and why there are none."""
    rate = 1.0 / sessions[0].period
    if rate < LEAST_RATE:
        return {}, (
            f"recorded at {rate:g} Hz: a tremor shows at other frequencies than its own; expected "
            f"at least {LEAST_RATE:g} Hz (--rate 50)"
        )
    if any(abs(one.period - sessions[0].period) > 1e-9 for one in sessions):
        return {}, "the sessions were recorded at different rates"
    f, each, rate = _periodograms(sessions, device, hand)
    if len(each) < LEAST_STRETCHES:
        return {}, (
            f"{len(each)} stretches of {STRETCH:g} s with a stick that is neither centred nor at "
            f"its end; expected {LEAST_STRETCHES}"
        )
    use = (f >= 1.0) & (f < 0.5 * rate)

    def model(p: Array) -> Array:
        background: Array = np.exp(p[0]) * (f[use] / 2.0) ** -p[1] + np.exp(p[2])
        if len(p) == 3:
            return background
        one = _Tremor(math.exp(p[3]), float(p[4]), math.exp(p[5]))
        background += _tremor_spectrum(f, rate, one, device.smoothing)[use]
        return background

    def cost(p: Array, mean: Array) -> float:
        """Negative log-likelihood of the mean of the periodograms, each half overlapped."""
        if len(p) > 3 and not (1.5 <= p[4] <= 0.45 * rate and -2.5 <= p[5] <= 1.8 and p[3] < 0.0):
            return 1e12
        if not 0.0 <= p[1] <= 8.0:
            return 1e12
        spectrum = model(p)
        return float(0.5 * len(each) * (np.log(spectrum) + mean / spectrum).sum())

    def solve(start: Array, mean: Array) -> Any:
        simplex = np.vstack([start, start + np.diag([0.5, 0.5, 0.5, 0.5, 0.5, 0.7][: len(start)])])
        options = {"maxfev": 4000, "xatol": 1e-3, "fatol": 1e-2, "initial_simplex": simplex}
        return minimize(cost, start, (mean,), "Nelder-Mead", options=options)

    mean = each.mean(axis=0)[use]
    plain_start = np.array([math.log(mean[0]), 2.0, math.log(mean.min())])
    plain = solve(plain_start, mean)
    trials = []
    for k in sorted(_peaks(mean / model(plain.x)))[-3:]:
        frequency = f[use][_peak_of(mean / model(plain.x), k)]
        trials.append(solve(np.array([*plain.x, math.log(0.1), frequency, 0.0]), mean))
    best = min(trials, key=lambda one: float(one.fun))
    if plain.fun - best.fun < _EVIDENCE or math.exp(best.x[3]) < 1.0 / device.levels:
        return {"hand.tremor": Estimate(0.0, 0.0, 0.0)}, "no tremor stands out of the movement"
    drawn = []
    for _ in range(repeats):
        mean_k = each[rng.integers(len(each), size=len(each))].mean(axis=0)[use]
        drawn.append(solve(best.x, mean_k).x)
    values = np.array([best.x, *drawn])[:, 3:]
    values[:, [0, 2]] = np.exp(values[:, [0, 2]])
    return {
        name: _estimate(float(values[0, k]), values[1:, k].tolist())
        for k, name in enumerate(_TREMOR)
    }, ""


def _peaks(ratio: Array) -> list[float]:
    """Heights of local maxima of a ratio (m,)."""
    inner = ratio[1:-1]
    found = inner[(inner >= ratio[:-2]) & (inner >= ratio[2:])]
    return list(found) or [float(ratio.max())]


def _peak_of(ratio: Array, height: float) -> int:
    return int(np.argmin(np.abs(ratio - height)))


# ---- switches


def _fit_switches(
    sessions: list[Session], base: Driver, repeats: int, rng: np.random.Generator
) -> Fit:
    estimates: dict[str, Estimate] = {}
    unidentified: dict[str, str] = {}
    sticks = np.concatenate([one.sticks / one.share for one in sessions])
    for k, name in enumerate(("speed", "turn")):
        values = np.abs(sticks[:, k][sticks[:, k] != 0.0])
        if len(values):
            typical = float(np.median(values))
            estimates[f"interface.{name}"] = Estimate(typical, typical, typical)
        else:
            unidentified[f"interface.{name}"] = "no switch of that direction was pressed"
    changes = sum(
        int((np.abs(np.diff(one.sticks, axis=0)) > 1e-9).any(axis=1).sum()) for one in sessions
    )
    minutes = sum(len(one.sticks) * one.period for one in sessions) / 60.0
    delays, wrong = _answers(sessions)
    if len(delays) < 8:
        why = "a drive does not tell which signal was meant: record one with --prompts"
        unidentified |= {"delay": why, "interface.error": why}
    else:
        # A wrong signal is drawn from all of them, the right one too.
        device = base.interface
        n = 9 if device.directions == 8 else 7 if device.latched else 5
        chance = n / (n - 1)
        draws = [rng.integers(len(delays), size=len(delays)) for _ in range(repeats)]
        half = 0.5 * sessions[0].period  # a change is seen so late on average
        estimates["delay"] = _estimate(
            float(np.median(delays)) - half, [float(np.median(delays[k])) - half for k in draws]
        )
        estimates["interface.error"] = _estimate(
            min(1.0, chance * float(wrong.mean())),
            [min(1.0, chance * float(wrong[k].mean())) for k in draws],
        )
    figures = {"minutes": minutes, "changes_per_minute": changes / max(minutes, 1e-9)}
    return Fit({}, estimates, unidentified, figures)


def _answers(sessions: list[Session]) -> tuple[Array, NDArray[np.bool_]]:
    """Of each answered prompt: its delay [s], and whether the first signal was a wrong one."""
    delays, wrong = [], []
    for one in sessions:
        sign = np.sign(np.where(np.abs(one.sticks) < 1e-9, 0.0, one.sticks))
        ends = [*one.prompts[1:, 0], len(sign) * one.period]
        for (start, *asked), end in zip(one.prompts, ends, strict=True):
            k, last = round(start / one.period), min(len(sign), round(end / one.period))
            if k < 1 or k >= last:
                continue
            moved = np.flatnonzero((sign[k:last] != sign[k - 1]).any(axis=1))
            want = np.where(np.abs(asked) > 0.1, np.sign(asked), 0.0)
            if not len(moved) or (want == sign[k - 1]).all():
                continue
            delays.append(moved[0] * one.period)
            wrong.append(bool((sign[k + moved[0]] != want).any()))
    return np.array(delays), np.array(wrong, np.bool_)
