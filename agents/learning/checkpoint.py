"""Checkpoints of a training run: complete or refused, and read without executing code in them."""

from __future__ import annotations

import hashlib
import io
import zipfile
from operator import attrgetter
from pathlib import Path
from typing import Any

import torch

from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.files import LIMITS, atomic_write, read_bytes

NAME = "checkpoint.pt"
_HEAD = b"wheelchair checkpoint 1\n"
_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def model_state(model: Any) -> dict[str, Any]:
    """The state of a model: networks, optimizers and replay buffer."""
    names, variables = model._get_torch_save_params()
    state: dict[str, Any] = {
        "modules": {name: attrgetter(name)(model).state_dict() for name in names},
        "variables": {name: attrgetter(name)(model).data for name in variables or []},
        "frames": model.num_timesteps,
        "updates": model._n_updates,
    }
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        end = buffer.buffer_size if buffer.full else buffer.pos
        state["replay"] = {name: torch.from_numpy(getattr(buffer, name)[:end]) for name in _REPLAY}
        state["replay_at"] = [int(buffer.pos), int(buffer.full)]
    return state


def load_model_state(model: Any, state: dict[str, Any]) -> None:
    """Load a state from `model_state` into a model of the same settings."""
    for name, values in state["modules"].items():
        attrgetter(name)(model).load_state_dict(values)
    for name, values in state["variables"].items():
        attrgetter(name)(model).data.copy_(values)
    model.num_timesteps, model._n_updates = state["frames"], state["updates"]
    if "replay" in state:
        buffer = model.replay_buffer
        for name, values in state["replay"].items():
            getattr(buffer, name)[: len(values)] = values.numpy()
        buffer.pos, buffer.full = state["replay_at"][0], bool(state["replay_at"][1])


def save_checkpoint(folder: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint atomically.

    Raises:
        InputError: it cannot be written.
    """
    stream = io.BytesIO()
    torch.save(content, stream)
    body = stream.getbuffer()
    digest = hashlib.sha256(body).hexdigest().encode()
    with atomic_write(folder / NAME) as part, part.open("wb") as file:
        file.write(_HEAD + digest + b"\n")
        file.write(body)


def load_checkpoint(folder: Path) -> dict[str, Any] | None:
    """The checkpoint of a folder; None where there is none.

    Raises:
        InputError: it cannot be read, or is not complete.
    """
    path = folder / NAME
    if not path.exists():
        return None
    data = read_bytes(path, "checkpoint")
    head = len(_HEAD) + 65
    body = memoryview(data)[head:]
    digest = hashlib.sha256(body).hexdigest().encode()
    expected = "expected a complete checkpoint; delete it to start again"
    if data[:head] != _HEAD + digest + b"\n":
        raise InputError(f"{path}: {expected}")
    try:
        with zipfile.ZipFile(io.BytesIO(body)) as packed:
            if sum(member.file_size for member in packed.infolist()) > LIMITS["checkpoint"].maximum:
                raise ValueError("too large when unpacked")
        content = torch.load(io.BytesIO(body), weights_only=True, map_location="cpu")
        if not isinstance(content, dict):
            raise ValueError("not an object with keys")
    except Exception as error:  # torch documents no errors of its reader
        why = " ".join(str(error).split()[:20]) or type(error).__name__
        raise InputError(f"{path}: {expected} ({why})") from None
    return content
