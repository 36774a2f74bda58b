"""Settings of a simulated person, fitted to recorded sessions of a person at a stick or switches.

A drive shows how the hand trembles, and the stick's dead zone. It does not show which deflection
the person meant. A prompted session does (`wheelchair drive --prompts`): the chair stands, and the
person is asked for one deflection after another. From it follow delay, lag, weakness by direction,
rotation and offset of a stick, and delay and wrong signals of switches. What a session does not
show keeps the value of a person to begin with, and is named.

Methods: the hand's response by output-error minimization (Ljung 1999, section 7.2); the tremor by
its spectrum (`fit_tremor`); the dead zone from the grid of values that a stick's steps leave; 95 %
intervals by the bootstrap (Efron 1979) over prompts, or over stretches of a drive; that of
switches' median delay by binomial order statistics.
"""

import dataclasses
import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize
from scipy.signal import find_peaks, lfilter, periodogram

from agents.evaluation.statistics import median_interval
from agents.people.recorded_stick import StickSession, before_dead_zone
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.planar import body_to_world
from wheelchair_gym.people.drivers import make_driver, step
from wheelchair_gym.people.drivers.settings import Driver, Hand, ProportionalStick, Switches
from wheelchair_gym.people.drivers.state import TICK_RATE, tremor_filter

TICK = 1.0 / TICK_RATE  # s
MIN_RATE = 25.0  # Hz: sessions recorded more slowly show a tremor at wrong frequencies
STRETCH = 2.56  # s of an uninterrupted deflection that give one periodogram
MIN_STRETCHES = 6
TREMOR_KEYS = "tremor", "tremor_frequency", "tremor_band"  # of a hand
TREMOR = tuple(f"hand.{key}" for key in TREMOR_KEYS)
_EVIDENCE = 10.0  # min gain of log-likelihood by a tremor: for three parameters, P < 1e-3
_FULL = 0.92  # deflection from which on the stick's end cuts a tremor off
_ON_GRID = 0.03  # mean squared distance to the grid, in steps; at random 1/12
_ZONES = np.arange(0.0, 0.5, 2e-4)  # dead zones that are tried
_NAMES = (
    "delay", "hand.lag", "hand.return_lag", "hand.forward", "hand.backward", "hand.leftward",
    "hand.rightward", "hand.rotation", "hand.offset_forward", "hand.offset_left",
)  # fmt: skip
_LOW = np.array([0.0, 0.005, 0.005, 0.05, 0.05, 0.05, 0.05, -0.8, -0.5, -0.5])
_HIGH = np.array([2.5, 1.5, 1.5, 1.0, 1.0, 1.0, 1.0, 0.8, 0.5, 0.5])
_STEADY = np.zeros((0, 2))  # no tremor
_NO_PROMPTS = "a drive does not show which {} was meant: record one with --prompts"
_CORRECTIONS = 10  # simulated sessions that estimate a bias
_START = np.array([0.4, 0.1, 0.1, 0.8, 0.8, 0.8, 0.8, 0.0, 0.0, 0.0])


class FittedSetting(NamedTuple):
    """A fitted setting with its 95 % interval."""

    value: float
    low: float
    high: float


def estimate(value: float, drawn: list[float]) -> FittedSetting:
    """A value with the 95 % interval of those drawn by a bootstrap; none: the value alone."""
    low, high = np.percentile(drawn, (2.5, 97.5)) if drawn else (value, value)
    return FittedSetting(float(value), float(min(low, value)), float(max(high, value)))


class Fit(NamedTuple):
    """Result of a fit.

    Attributes:
        driver: settings that `make_driver` takes. A setting that was not identified has the
            value of `base` (see `fit_driver`).
        estimates: by the setting's name.
        unidentified: why a setting was not fitted, by its name.
        figures: other figures of the sessions.
    """

    driver: dict[str, Any]
    estimates: dict[str, FittedSetting]
    unidentified: dict[str, str]
    figures: dict[str, float]


def fit_driver(
    sessions: list[StickSession], base: Driver, repeats: int = 100, seed: int = 0
) -> Fit:
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
    minutes = sum(len(one.sticks) * one.period for one in sessions) / 60.0
    fit, rng = Fit({}, {}, {}, {"minutes": minutes}), np.random.default_rng(seed)
    (_fit_stick if kind == "stick" else _fit_switches)(fit, sessions, base, repeats, rng)
    fit.driver.update(_settings(base, fit.estimates, sessions))
    make_driver(fit.driver)
    return fit


def _settings(
    base: Driver, estimates: dict[str, FittedSetting], sessions: list[StickSession]
) -> dict[str, Any]:
    """The fitted driver as `make_driver` takes it."""
    settings = {"name": "expert", **dump(base)}
    if base.interface.kind == "switches":
        settings["interface"]["latched"] = any(session.latched for session in sessions)
    for name, one in estimates.items():
        part, _, key = name.partition(".")
        if key:
            settings[part][key] = one.value
    if "delay" in estimates:  # of the reaction and of the interface: their sum is seen
        maximum = max(0.0, estimates["delay"].value)
        reaction = min(settings["perception"]["reaction"], maximum)
        settings["perception"]["reaction"] = reaction
        settings["interface"]["delay"] = maximum - reaction
    return settings


# ---- a stick


def _fit_stick(
    found: Fit, sessions: list[StickSession], base: Driver, repeats: int, rng: np.random.Generator
) -> None:
    device, hand = base.interface, base.hand
    zone = _dead_zone(sessions, device.levels)
    if zone is None:
        found.unidentified["interface.dead_zone"] = (
            f"the stick's values are not those of {device.levels:g} steps with one dead zone; "
            f"{device.dead_zone:g} is assumed"
        )
    else:
        found.estimates["interface.dead_zone"] = zone
        device = dataclasses.replace(device, dead_zone=zone.value)
    prompted = [session for session in sessions if len(session.prompts)]
    if prompted:
        fit = _HandFit(prompted, device)
        best = fit.best()
        values = {name.partition(".")[2]: float(best[k]) for k, name in enumerate(_NAMES)}
        hand = dataclasses.replace(hand, **{k: v for k, v in values.items() if k})
    else:
        found.unidentified.update(dict.fromkeys(_NAMES, _NO_PROMPTS.format("deflection")))
    tremor, why = fit_tremor(sessions, device, hand, repeats, rng)
    if prompted:
        values = {name.partition(".")[2]: one.value for name, one in tremor.items()}
        hand = dataclasses.replace(hand, **(values or {"tremor": 0.0}))
        found.estimates.update(fit.estimates(best, hand, repeats, rng))
    found.estimates.update(tremor)
    found.unidentified.update({name: why for name in TREMOR if name not in tremor})


def _dead_zone(sessions: list[StickSession], levels: float) -> FittedSetting | None:
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
    tried = (steps * (z + (1.0 - z) * size[free])[:, None] for z in _ZONES)
    off = np.array([np.mean((each - np.rint(each)) ** 2) for each in tried])
    best = int(np.argmin(off))
    if off[best] > _ON_GRID:
        return None
    near = _ZONES[off < max(2.0 * off[best], 0.5 * _ON_GRID)]
    near = near[np.abs(near - _ZONES[best]) < 0.01]
    return FittedSetting(float(_ZONES[best]), float(near.min()), float(near.max()))


@kernel
def _respond(
    times: Array, asked: Array, p: Array, zone: float, gain: float, smoothing: float, every: float,
    tremor: Array, out: Array,
) -> None:  # fmt: skip
    """The stick (n, 2), sampled at a period of ticks, of a hand that follows prompts.

    times (k,) in ticks, asked (k, 2); p as in _NAMES; tremor (ticks, 2), or (0, 2) for none.
    """
    tick = TICK
    go, back = 1.0 - math.exp(-tick / p[1]), 1.0 - math.exp(-tick / p[2])
    hx = hy = fx = fy = 0.0
    share, weak = step.smoothing_share(smoothing, tick), (p[3], p[4], p[5], p[6])
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
        x, y = step.push_through(x, y, zone)
        hx += (x - hx) * (back if abs(x) < abs(hx) else go)
        hy += (y - hy) * (back if abs(y) < abs(hy) else go)
        tx, ty = hx, hy
        if k < tremor.shape[0]:
            tx, ty = hx + tremor[k, 0], hy + tremor[k, 1]
        tx, ty = step.weaken(tx, ty, weak)
        tx, ty = body_to_world(c, s, tx, ty)
        fx += (min(1.0, max(-1.0, tx + p[8])) - fx) * share
        fy += (min(1.0, max(-1.0, ty + p[9])) - fy) * share
        k += 1
        if k >= (n + 1) * every - 0.5:
            out[n, 0], out[n, 1] = step.beyond_dead_zone(fx, fy, zone, gain)
            n += 1


class _HandFit:
    """The hand that predicts the stick after prompts best: delay, lags, weakness, rotation, offset.

    All sessions have prompts.
    """

    def __init__(self, sessions: list[StickSession], device: Any) -> None:
        self._sessions, self._device = sessions, device
        self._recorded = [one.sticks for one in sessions]
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
        starts = [np.array([delay, *_START[1:]]) for delay in np.arange(0.1, 1.3, 0.1)]
        seen, ones = np.concatenate(self._recorded), np.ones(self.prompts)
        starts.sort(key=lambda p: float(((np.concatenate(self.sticks(p)) - seen) ** 2).sum()))
        tried = [self.solve(start, self._recorded, ones) for start in starts[:3]]
        found: Array = min(tried, key=lambda one: float(one.cost)).x
        return found

    def tremors(self, hand: Hand, rng: np.random.Generator) -> list[Array]:
        """Drawn tremors (ticks, 2) of each session."""
        a, b, gain = tremor_filter(hand, TICK)
        ticks = [round(len(one.sticks) * one.period / TICK) for one in self._sessions]
        return [lfilter([gain], [1.0, -a, b], rng.normal(size=(n, 2)), axis=0) for n in ticks]

    def estimates(
        self, best: Array, hand: Hand, repeats: int, rng: np.random.Generator
    ) -> dict[str, FittedSetting]:
        """The hand's parameters without the bias that a tremor gives them, with intervals.

        A tremor that the dead zone and the stick's ends cut shifts the mean. The shift is that of
        sessions simulated with the parameters and the tremor found (bootstrap bias correction,
        Efron and Tibshirani 1993, chapter 10).
        """
        n, bias = self.prompts, np.zeros(len(best))
        if hand.tremor > 0.0:
            drawn = [
                self.solve(best, self.sticks(best, self.tremors(hand, rng)), np.ones(n), False).x
                for _ in range(_CORRECTIONS)
            ]
            bias = np.mean(drawn, axis=0) - best
        draws = (rng.integers(n, size=n) for _ in range(repeats))
        weights = (np.bincount(drawn, minlength=n).astype(np.float64) for drawn in draws)
        found = [best, *(self.solve(best, self._recorded, each, False).x for each in weights)]
        values = np.clip(np.array(found) - bias, _LOW, _HIGH).T.tolist()
        return {name: estimate(of[0], of[1:]) for name, of in zip(_NAMES, values, strict=True)}


# ---- switches


def _fit_switches(
    found: Fit, sessions: list[StickSession], base: Driver, repeats: int, rng: np.random.Generator
) -> None:
    sticks = np.concatenate([one.sticks / one.share for one in sessions])
    for k, name in enumerate(("speed", "turn")):
        values = np.abs(sticks[:, k][sticks[:, k] != 0.0])
        if len(values):
            typical = float(np.median(values))
            found.estimates[f"interface.{name}"] = FittedSetting(typical, typical, typical)
        else:
            found.unidentified[f"interface.{name}"] = "no switch of that direction was pressed"
    changes = sum(
        int((np.abs(np.diff(one.sticks, axis=0)) > 1e-9).any(axis=1).sum()) for one in sessions
    )
    found.figures["changes_per_minute"] = changes / max(found.figures["minutes"], 1e-9)
    delays, wrong = _answers(sessions)
    if len(delays) < 8:
        why = _NO_PROMPTS.format("signal")
        found.unidentified.update({"delay": why, "interface.error": why})
    else:
        # A wrong signal is drawn from all of them, the right one too.
        device = base.interface
        n = 9 if device.directions == 8 else 7 if device.latched else 5
        chance = n / (n - 1)
        draws = [rng.integers(len(delays), size=len(delays)) for _ in range(repeats)]
        half = 0.5 * sessions[0].period  # a change is seen so late on average
        found.estimates["delay"] = FittedSetting(*(d - half for d in median_interval(delays)))
        found.estimates["interface.error"] = estimate(
            min(1.0, chance * float(wrong.mean())),
            [min(1.0, chance * float(wrong[k].mean())) for k in draws],
        )


def _answers(sessions: list[StickSession]) -> tuple[Array, NDArray[np.bool_]]:
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


# ---- a tremor


def _periodograms(
    sessions: list[StickSession], device: Any, hand: Hand, rate: float
) -> tuple[Array, Array]:
    """Frequencies (m,) [Hz], and periodograms (k, m) [1/Hz] of stretches sampled at a rate [Hz]."""
    n = round(STRETCH * rate)
    c, s = math.cos(hand.rotation), math.sin(hand.rotation)
    found: list[Array] = []
    for one in sessions:
        raw = before_dead_zone(one.sticks, device, one.share)
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
                if not cut:
                    found.append(part)
    f, each = periodogram(np.reshape(found, (-1, n)), rate, "hann", detrend="linear")
    return f, each


def _tremor_spectrum(f: Array, rate: float, hand: Any, smoothing: float) -> Array:
    """One-sided spectrum (m,) [1/Hz] of a tremor behind the stick's filter, folded by sampling."""
    a, b, gain = tremor_filter(hand, TICK)
    folds = round(TICK_RATE / rate)
    every = [f] + [sign * f + k * rate for k in range(1, folds // 2 + 1) for sign in (-1.0, 1.0)]
    total = np.zeros_like(f)
    share = step.smoothing_share(smoothing, TICK)
    for g in every:
        z = np.exp(-2j * math.pi * np.abs(g) * TICK)
        shape = gain**2 / np.abs(1.0 - a * z + b * z * z) ** 2
        filtered = share**2 / np.abs(1.0 - (1.0 - share) * z) ** 2
        total += np.where(np.abs(g) <= 0.5 * TICK_RATE, 2.0 * TICK * shape * filtered, 0.0)
    # What Hann's window makes of it.
    wide = np.concatenate((total[1:2], total, total[-2:-1]))
    return (wide[:-2] + 4.0 * wide[1:-1] + wide[2:]) / 6.0


def fit_tremor(
    sessions: list[StickSession], device: Any, hand: Hand, repeats: int, rng: np.random.Generator
) -> tuple[dict[str, FittedSetting], str]:
    """The tremor's amplitude, frequency and band, and why there are none.

    The spectrum of stretches of a drive (averaged periodograms, Welch 1967) is that of a resonator
    behind the stick's filter, folded by the sampling, and of voluntary movement: a power law and a
    floor. The parameters are those of maximum likelihood (Whittle 1953).
    """
    rate = 1.0 / sessions[0].period
    if rate < MIN_RATE:
        return {}, (
            f"recorded at {rate:g} Hz: a tremor shows at other frequencies than its own; expected "
            f"at least {MIN_RATE:g} Hz (--rate 50)"
        )
    if any(abs(one.period - sessions[0].period) > 1e-9 for one in sessions):
        return {}, "the sessions were recorded at different rates"
    f, each = _periodograms(sessions, device, hand, rate)
    if len(each) < MIN_STRETCHES:
        return {}, (
            f"{len(each)} stretches of {STRETCH:g} s with a stick that is neither centred nor at "
            f"its end; expected {MIN_STRETCHES}"
        )
    use = (f >= 1.0) & (f < 0.5 * rate)

    def model(p: Array) -> Array:
        background: Array = np.exp(p[0]) * (f[use] / 2.0) ** -p[1] + np.exp(p[2])
        if len(p) == 3:
            return background
        values = math.exp(p[3]), float(p[4]), math.exp(p[5])
        one = SimpleNamespace(**dict(zip(TREMOR_KEYS, values, strict=True)))  # checks nothing
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
    ratio = mean / model(plain.x)
    peaks = find_peaks(ratio)[0]
    peaks = peaks if len(peaks) else np.array([ratio.argmax()])
    highest = f[use][peaks[np.argsort(ratio[peaks])[-3:]]]
    trials = [solve(np.array([*plain.x, math.log(0.1), top, 0.0]), mean) for top in highest]
    best = min(trials, key=lambda one: float(one.fun))
    if plain.fun - best.fun < _EVIDENCE or math.exp(best.x[3]) < 1.0 / device.levels:
        return {"hand.tremor": FittedSetting(0.0, 0.0, 0.0)}, "no tremor stands out of the movement"
    draws = (rng.integers(len(each), size=len(each)) for _ in range(repeats))
    drawn = [solve(best.x, each[chosen].mean(axis=0)[use]).x for chosen in draws]
    values = np.array([best.x, *drawn])[:, 3:]
    values[:, [0, 2]] = np.exp(values[:, [0, 2]])
    return {
        name: estimate(float(values[0, k]), values[1:, k].tolist()) for k, name in enumerate(TREMOR)
    }, ""
