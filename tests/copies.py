"""Copies of what is driven, made at random moments and driven on beside the original."""

import copy
import gc
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np


def differences(one: Any, other: Any, where: str = "") -> Iterator[str]:
    """Yield the places where two results differ in type, shape or a bit; padding is ignored."""
    if isinstance(one, np.void) and isinstance(other, np.void):
        one, other = np.asarray(one), np.asarray(other)
    if type(one) is not type(other):
        yield f"{where}: {type(one).__name__}, {type(other).__name__}"
    elif isinstance(one, dict):
        if one.keys() != other.keys():
            yield f"{where}: {sorted(one)}, {sorted(other)}"
        for key in one.keys() & other.keys():
            yield from differences(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, tuple | list):
        if len(one) != len(other):
            yield f"{where}: {len(one)}, {len(other)} items"
        for k, pair in enumerate(zip(one, other, strict=False)):
            yield from differences(*pair, f"{where}[{k}]")
    elif isinstance(one, np.ndarray):
        same = one.dtype == other.dtype and one.shape == other.shape
        if same and one.dtype.names:
            for name in one.dtype.names:
                yield from differences(one[name], other[name], f"{where}.{name}")
        elif not same or (one.dtype.kind != "O" and one.tobytes() != other.tobytes()):
            yield f"{where}: {one}, {other}"
        if same and one.dtype.kind == "O":
            yield from differences(one.tolist(), other.tolist(), where)
    elif not (one == other or (one != one and other != other)):
        yield f"{where}: {one}, {other}"


def same_fields(one: Any, other: Any) -> bool:
    """Return True if arrays or records have equal bits in every field; padding may differ."""
    return not list(differences(one, other))


def by_pickle(thing: Any) -> Any:
    """A copy that went through bytes."""
    return pickle.loads(pickle.dumps(thing))


COPIERS: tuple[Callable[[Any], Any], ...] = (copy.deepcopy, by_pickle)


def drive_copies(
    begin: Callable[[Any], Any],
    step: Callable[[Any, np.random.Generator], Any],
    thing: Any,
    copies: int,
    seed: int,
    steps: int = 6,
) -> int:
    """Copy a thing at random moments and step original and copy in random order.

    Args:
        begin: begins anew with the thing.
        step: steps it, with actions drawn from a generator; None once it has ended.
        thing: that is copied.
        copies: how many.
        seed: of moments, actions and order.
        steps: that a copy is compared for.

    Returns:
        How many steps were compared.
    """
    rng, compared = np.random.default_rng(seed), 0
    begin(thing)
    for made in range(copies):
        for _ in range(int(rng.integers(12))):
            if step(thing, rng) is None:
                begin(thing)
        twins = [thing, COPIERS[int(rng.random() < 0.3)](thing)]
        draws = int(rng.integers(2**32))
        told: list[list[Any]] = [[], []]
        actions = [np.random.default_rng(draws) for _ in twins]
        order = rng.permutation([0, 1] * steps)
        for k in order.tolist():
            told[k].append(step(twins[k], actions[k]))
            if told[k][-1] is None:
                told[k][-1] = begin(twins[k])
        wrong = list(differences(*told))
        assert not wrong, (made, wrong[:3])
        compared += steps
        # Whichever is let go: what it held must not be what the other goes by.
        thing = twins[int(rng.integers(2))]
        del twins
        if made % 50 == 0:
            gc.collect()
    return compared
