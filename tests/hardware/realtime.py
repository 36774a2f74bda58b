"""A twin in real time in a room of its own, with the config and the map that a host needs."""

import contextlib
import dataclasses
import json
import threading

import numpy as np

from tests.conftest import ROOT, need_pty
from tests.hardware.conftest import build_twin
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.hardware.twin.serve import ServedTwin
from wheelchair_gym.maps import write_map
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import SensorSettings

ROOM = make_scene("empty").sample(np.random.default_rng(0))
X, Y = np.round(ROOM.walls.reshape(-1, 2).mean(axis=0), 1) - (1.0, 0.2)
START, GOAL = np.array([X, Y, 0.0]), np.array([X + 2.0, Y + 0.5, 0.0])
EPISODE = dataclasses.replace(ROOM, start=START, goal=GOAL)


@contextlib.contextmanager
def serving(folder):
    build_twin()
    need_pty()
    settings = env_settings(
        str(ROOT / "configs" / "hardware.json"), pose_source="odometry", noise=False, beams=181
    )
    twin = Twin(Plant(settings.chair, SensorSettings(noise=False)))
    twin.reset(EPISODE, 0)
    twin.run(0.001)
    twin.plant.scan(0)  # compiled before real time begins
    twin.plant.ping(0)
    made, done = ServedTwin(twin), threading.Event()
    thread = threading.Thread(target=made.run, args=(done.is_set,))
    thread.start()
    config = dump(settings)
    # A busy machine that runs the world and the policy in one process is late now and then.
    late = dict.fromkeys(("scan", "odometry", "command_timeout"), 5.0)
    config["hardware"]["limits"] |= late | {"ready_timeout": 30.0}
    config["hardware"] |= {
        "drive_port": made.drive.path, "range_port": made.range.path,
        "laser_port": f"tcp://127.0.0.1:{made.lasers[0].port}",
    }  # fmt: skip
    made.config, made.map = folder / "config.json", folder / "map.yaml"
    made.config.write_text(json.dumps(config))
    write_map(EPISODE.map, made.map)
    try:
        yield made
    finally:
        done.set()
        thread.join()
        made.close()
        twin.close()
