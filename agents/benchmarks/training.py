"""Measures the seconds of each part of a training run."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from agents import read_data
from agents.evaluation.provenance import provenance
from agents.learning.run import Run
from agents.learning.settings import Training

PARTS: dict[str, str] = read_data("training_parts.yaml")  # of a run, and what of it they are


def measure(config: Training) -> dict[str, Any]:
    """Train in a folder that is removed, and measure each part.

    Returns:
        `seconds` by part of PARTS, `frames`, `frames_per_second` without the part `worlds`, the
        `device` of the networks, and the provenance.

    Raises:
        InputError: settings do not fit each other.
    """
    seconds: dict[str, float] = dict.fromkeys((*PARTS, "steps"), 0.0)

    def timed(part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                seconds[part] += time.perf_counter() - began

        return measured

    with TemporaryDirectory() as folder:
        run: Any = timed("worlds", Run)(config, 0, Path(folder))
        try:
            run.env.reset = timed("environments", run.env.reset)
            run.env.step = timed("steps", run.env.step)
            run.model.collect_rollouts = timed("actor", run.model.collect_rollouts)
            run.model.train = timed("learning", run.model.train)
            run._evaluate = timed("evaluation", run._evaluate)
            run._save = timed("saving", run._save)
            began = time.perf_counter()
            while not run.done:
                run.learn()
            whole = time.perf_counter() - began
        finally:
            run.close()
    seconds["environments"] += seconds["steps"]
    seconds["actor"] -= seconds["steps"]
    return {
        "seconds": {part: round(seconds[part], 2) for part in PARTS}, "frames": run.frames,
        "frames_per_second": round(run.frames / whole), "device": run.model.device.type,
        **provenance(),
    }  # fmt: skip


def text(found: dict[str, Any]) -> str:
    """Return a table of what `measure` returns."""
    whole = sum(found["seconds"].values())
    lines = [f"{part:<14}{found['seconds'][part]:>9.1f} s{found['seconds'][part] / whole:>7.0%}   "
             f"{what}" for part, what in PARTS.items()]  # fmt: skip
    rate = f"{found['frames_per_second']:,} frames/s without worlds"
    return "\n".join([*lines, f"{found['frames']:,} frames, {rate}, networks on {found['device']}"])
