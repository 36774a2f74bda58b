"""`wheelchair studio`: people drive and plan in the browser."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from agents.cli.arguments import map_scenes
from agents.studio.warm_up import WarmUp
from wheelchair_gym.base.settings import InputError, read
from wheelchair_gym.envs.settings import env_settings


def studio(given: argparse.Namespace) -> int:
    """Serve the page in the browser until Ctrl-C."""
    if missing := [name for name in ("starlette", "uvicorn", "websockets") if not find_spec(name)]:
        needs = ", ".join(missing)
        raise InputError(f"wheelchair studio needs {needs}: pip install 'wheelchair_gym[studio]'")
    maps = map_scenes(given)
    if maps:
        from wheelchair_gym.maps import read_any_map

        solid = maps[0].get("unknown_is_solid", True)
        read_any_map(maps[0]["path"], solid, maps[0].get("resolution"))  # refuses what is wrong
    own_map = maps[0] if maps else None
    env_settings(None, model=given.model)  # refuses what is wrong
    folder, study = Path(given.out), None
    if given.study is not None:
        from agents.people.protocol import Protocol

        study = read(Protocol, given.study)
        folder /= Path(given.study).stem
    elif given.participant:
        raise InputError("--participant needs --study FILE")
    warm_up = WarmUp()
    warm_up.start()  # while the server is loaded
    try:
        from agents.studio.access import Access
        from agents.studio.server import Studio, serve

        access = Access(lan=given.lan)
        runs = Path(given.runs)
        locked = given.participant
        made = Studio(folder, own_map, access, study, runs, warm_up, given.model, locked)
        serve(made, given.port)
    finally:
        warm_up.close()
    return 0
