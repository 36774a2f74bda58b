"""Randomness by counter: every draw is a hash of (key of the episode, step, channel, index).

So a draw depends neither on threads, nor on other chairs, nor on what was drawn before. The mixer
is splitmix64 (Steele, Lea and Flood 2014); the laser spreads one such draw over its beams.
"""

from __future__ import annotations

import numpy as np

from wheelchair_gym.compiled.kernel import kernel

# One channel for each use, so that no two sensors ever share a draw.
(
    LASER, LASER_BIAS, ULTRASONIC, WHEELS, POSE, PARAMETERS, WORLDS, LOCALIZATION, SLAM, ACTORS,
    STARTS, FAULTS, SHIELDS,
) = range(13)  # fmt: skip

# Sum of four uniform 16-bit numbers: mean and standard deviation (Irwin-Hall, n = 4, cut at 3.46).
_MEAN = 2.0 * 65535.0
_DEVIATION = float(np.sqrt(4.0 * (65536.0**2 - 1.0) / 12.0))

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)


@kernel
def mix(value: np.uint64) -> np.uint64:
    """Splitmix64's finaliser: 64 well-mixed bits of 64."""
    x = np.uint64(value)
    x = (x ^ (x >> np.uint64(30))) * _FIRST
    x = (x ^ (x >> np.uint64(27))) * _SECOND
    return x ^ (x >> np.uint64(31))


@kernel
def bits(key: np.uint64, step: int, channel: int, index: int) -> np.uint64:
    """64 random bits of one draw."""
    x = mix(np.uint64(key) + _GOLDEN * np.uint64(step + 1))
    return mix(
        x + _GOLDEN * (np.uint64(channel) * np.uint64(65536) + np.uint64(index) + np.uint64(1))
    )


@kernel
def uniform(key: np.uint64, step: int, channel: int, index: int) -> float:
    """A number in [0, 1)."""
    return float(bits(key, step, channel, index) >> np.uint64(11)) * 2.0**-53


@kernel
def normal(key: np.uint64, step: int, channel: int, index: int) -> float:
    """A nearly normal number of mean 0 and deviation 1, never beyond 3.46."""
    x = bits(key, step, channel, index)
    mask = np.uint64(0xFFFF)
    total = (
        (x & mask)
        + ((x >> np.uint64(16)) & mask)
        + ((x >> np.uint64(32)) & mask)
        + (x >> np.uint64(48))
    )
    return (float(total) - _MEAN) / _DEVIATION


def episode_key(seed: int, episode: int) -> int:
    """The key of one episode of one seed."""
    return int(bits(np.uint64(seed % 2**64), episode, 0, 0))
