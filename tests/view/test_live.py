"""A viewer joins over a real WebSocket, late, and is told all it needs to draw, at rate."""

from __future__ import annotations

import json
import struct
import threading

import gymnasium as gym
import numpy as np
import pytest
from websockets.sync.client import connect

from agents.cli import main
from wheelchair_gym.view.record import Recorded

STEPS = 40


def test_a_viewer_that_comes_late_sees_map_scan_and_transforms():
    env = Recorded(gym.make("wheelchair_gym/Navigation-v0"), port=0)
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    joined = threading.Event()
    told: dict[str, list[int]] = {}

    def watch():
        with connect(f"ws://127.0.0.1:{env.port}", subprotocols=["foxglove.sdk.v1"]) as viewer:
            topics: dict[int, str] = {}
            while len(told.get("/verdict", ())) < STEPS:
                message = viewer.recv(timeout=20)
                if isinstance(message, bytes):
                    operation, number, stamp = struct.unpack_from("<BIQ", message)
                    assert operation == 1
                    told.setdefault(topics[number], []).append(stamp)
                elif (content := json.loads(message))["op"] == "advertise":
                    topics |= {c["id"]: c["topic"] for c in content["channels"]}
                    wanted = [{"id": c, "channelId": c} for c in topics]
                    viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                    joined.set()

    viewer = threading.Thread(target=watch)
    viewer.start()
    assert joined.wait(20)
    while viewer.is_alive():  # what was sent before the subscription was there is lost
        env.step(np.zeros(2, np.float32))
        viewer.join(0.01)
    env.close()
    for topic in ("/scan", "/tf", "/pose"):
        stamps = np.array(told[topic])
        assert len(stamps) >= STEPS - 1
        np.testing.assert_array_equal(np.diff(stamps), 100_000_000)  # ns: none is missing
    assert len(told["/map"]) >= 3


def test_a_port_that_is_taken_or_none_is_one_line(capsys):
    env = Recorded(gym.make("wheelchair_gym/Navigation-v0"), port=0)
    for port in (env.port, 70_000):
        assert main(["simulate", "--scene", "empty", "--live", str(port)]) == 2
        said = capsys.readouterr().err.strip().splitlines()
        assert f"port {port}" in said[-1]
        assert len(said) == 1
    env.close()


def test_it_is_driven_in_real_time(capsys):
    import time

    begun = time.perf_counter()
    assert main(["simulate", "--scene", "empty", "--policy", "straight", "--live", "0"]) == 0
    spent = time.perf_counter() - begun
    assert "ws://127.0.0.1:" in capsys.readouterr().err
    assert spent > 3.0  # the drive takes 3.9 s


@pytest.mark.parametrize("arguments", [["--live", "-1"], ["--live", "x"]])
def test_what_is_no_port_is_one_line(arguments, capsys):
    with pytest.raises(SystemExit) as left:
        main(["simulate", *arguments])
    assert left.value.code == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
