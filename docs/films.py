"""Films of the documentation: `python docs/films.py` draws them to docs/images."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from agents.evaluation.evaluate import drive_episode, env_settings, make_env  # noqa: E402
from agents.policies import make_policy  # noqa: E402
from wheelchair_gym.rendering.video import write_video  # noqa: E402

FOLDER = ROOT / "docs" / "images"
SIZE = {"render_width": 400, "render_height": 320}


class Film(NamedTuple):
    """An episode, and how many control periods lie between two pictures."""

    scene: str
    policy: str
    seed: int
    periods: int


FILMS = {
    "drive": Film("floor_plan", "lattice+window", 4, 1),
    "crowd": Film("crowd", "ppo_guided", 33, 2),
    "people": Film("people", "lattice+window", 9, 3),
}


def draw(name: str) -> Path:
    """Drive a film's episode behind the shield, and write it as NAME.gif."""
    film = FILMS[name]
    settings = env_settings(pose_source="modelled", shield=True, config=SIZE)
    env = make_env(film.scene, settings, "rgb_array")
    pictures: list[Any] = []
    drive_episode(env, make_policy(film.policy), film.seed, lambda e: pictures.append(e.render()))
    path = FOLDER / f"{name}.gif"
    write_video(path, pictures[:: film.periods], 1.0 / (film.periods * env.unwrapped.task.period))
    env.close()
    return path


if __name__ == "__main__":
    for each in FILMS:
        print(f"{draw(each).relative_to(ROOT)}")
