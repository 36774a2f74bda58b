"""The tremor of a hand, from the spectrum of a recorded stick.

The spectrum of stretches of a drive (averaged periodograms, Welch 1967) is that of a resonator
behind the stick's filter, folded by the sampling, and of voluntary movement: a power law and a
floor. The parameters are those of maximum likelihood (Whittle 1953).
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.signal import find_peaks

from agents.people.recorded_stick import StickSession, before_dead_zone
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.people.drivers.interfaces import smoothing_share
from wheelchair_gym.people.drivers.settings import Hand
from wheelchair_gym.people.drivers.state import TICK_RATE, tremor_filter

TICK = 1.0 / TICK_RATE  # s
MIN_RATE = 25.0  # Hz: sessions recorded more slowly show a tremor at wrong frequencies
STRETCH = 2.56  # s of an uninterrupted deflection that give one periodogram
MIN_STRETCHES = 6
TREMOR_KEYS = "tremor", "tremor_frequency", "tremor_band"  # of a hand
TREMOR = tuple(f"hand.{key}" for key in TREMOR_KEYS)
_EVIDENCE = 10.0  # min gain of log-likelihood by a tremor: for three parameters, P < 1e-3
_FULL = 0.92  # deflection from which on the stick's end cuts a tremor off


class FittedSetting(NamedTuple):
    """A fitted setting with its 95 % interval."""

    value: float
    low: float
    high: float


def estimate(value: float, drawn: list[float]) -> FittedSetting:
    """A value with the 95 % interval of those drawn by a bootstrap; none: the value alone."""
    low, high = np.percentile(drawn, (2.5, 97.5)) if drawn else (value, value)
    return FittedSetting(float(value), float(min(low, value)), float(max(high, value)))


def _periodograms(
    sessions: list[StickSession], device: Any, hand: Hand
) -> tuple[Array, Array, float]:
    """Frequencies (m,) [Hz], periodograms (k, m) [1/Hz] of stretches, and their rate [Hz]."""
    rate = 1.0 / sessions[0].period
    n = round(STRETCH * rate)
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(n) / n)
    scale = 2.0 / (rate * float((window**2).sum()))
    line = np.linspace(-1.0, 1.0, n)
    c, s = math.cos(hand.rotation), math.sin(hand.rotation)
    found = []
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
                if cut:
                    continue
                part = part - np.polyval(np.polyfit(line, part, 1), line)
                found.append(scale * np.abs(np.fft.rfft(part * window)) ** 2)
    return np.asarray(np.fft.rfftfreq(n, 1.0 / rate), np.float64), np.array(found), rate


def _tremor_spectrum(f: Array, rate: float, hand: Any, smoothing: float) -> Array:
    """One-sided spectrum (m,) [1/Hz] of a tremor behind the stick's filter, folded by sampling."""
    a, b, gain = tremor_filter(hand, TICK)
    folds = round(TICK_RATE / rate)
    every = [f] + [sign * f + k * rate for k in range(1, folds // 2 + 1) for sign in (-1.0, 1.0)]
    total = np.zeros_like(f)
    share = smoothing_share(smoothing, TICK)
    for g in every:
        z = np.exp(-2j * math.pi * np.abs(g) * TICK)
        shape = gain**2 / np.abs(1.0 - a * z + b * z * z) ** 2
        filtered = share**2 / np.abs(1.0 - (1.0 - share) * z) ** 2
        total += np.where(np.abs(g) <= 0.5 * TICK_RATE, 2.0 * TICK * shape * filtered, 0.0)
    # What Hann's window makes of it.
    wide = np.concatenate((total[1:2], total, total[-2:-1]))
    blurred: Array = (wide[:-2] + 4.0 * wide[1:-1] + wide[2:]) / 6.0
    return blurred


def fit_tremor(
    sessions: list[StickSession], device: Any, hand: Hand, repeats: int, rng: np.random.Generator
) -> tuple[dict[str, FittedSetting], str]:
    """The tremor's amplitude, frequency and band, and why there are none."""
    rate = 1.0 / sessions[0].period
    if rate < MIN_RATE:
        return {}, (
            f"recorded at {rate:g} Hz: a tremor shows at other frequencies than its own; expected "
            f"at least {MIN_RATE:g} Hz (--rate 50)"
        )
    if any(abs(one.period - sessions[0].period) > 1e-9 for one in sessions):
        return {}, "the sessions were recorded at different rates"
    f, each, rate = _periodograms(sessions, device, hand)
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
