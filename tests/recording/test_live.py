"""A viewer joins over a real WebSocket, late, and is told all it needs to draw, at rate."""

import base64
import json
import struct
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any, get_args
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from websockets.sync.client import connect

from agents.cli import main
from tests.conftest import PATIENCE, refusal
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.perception.monte_carlo import LocalizationSettings
from wheelchair_gym.recording.record import REFRESH_PERIOD, RecordEpisodes
from wheelchair_gym.recording.sink import Format, Sink

STEPS = 40
RATE = 10.0  # Hz, of control


def tree(content):
    """Child -> parent of a message of transforms."""
    return {t.child_frame_id: t.parent_frame_id for t in content.transforms}


def test_a_viewer_that_comes_late_sees_map_scan_and_transforms():
    """With nothing but what the server says of its topics: by their own schemas, at rate."""
    env = RecordEpisodes(
        gym.make("wheelchair_gym/Navigation-v1", pose_source="mcl", split="test"), port=0
    )
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    joined, heard = threading.Event(), threading.Event()
    told: dict[str, list[tuple[int, Any]]] = {}

    def watch():
        with connect(f"ws://127.0.0.1:{env.port}", subprotocols=["foxglove.sdk.v1"]) as viewer:
            channels: dict[int, Any] = {}
            while len(told.get("/verdict", ())) < STEPS:
                message = viewer.recv(timeout=PATIENCE)
                if isinstance(message, bytes):
                    operation, number, stamp = struct.unpack_from("<BIQ", message)
                    assert operation == 1
                    channel = channels[number]
                    later = partial(decoded, channel, message[13:])
                    told.setdefault(channel["topic"], []).append((stamp, later))
                    if channel["topic"] == "/verdict":
                        heard.set()
                elif (content := json.loads(message))["op"] == "advertise":
                    channels |= {c["id"]: c for c in content["channels"]}
                    wanted = [{"id": c, "channelId": c} for c in channels]
                    viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                    joined.set()

    viewer = threading.Thread(target=watch)
    viewer.start()
    assert joined.wait(PATIENCE)
    while viewer.is_alive() and len(told.get("/verdict", ())) < STEPS:
        first = "/verdict" not in told  # what was sent before the subscription was there is lost
        heard.clear()
        env.step(np.zeros(2, np.float32))
        heard.wait(0.2 if first else PATIENCE)  # for a slow viewer the server drops messages
    viewer.join(PATIENCE)
    env.close()
    each = ("/scan", "/tf", "/pose", "/ultrasonic", "/odometry", "/particles", "/battery")
    for topic in each:
        stamps = np.array([stamp for stamp, _ in told[topic]])
        assert len(stamps) >= STEPS - 1
        np.testing.assert_array_equal(np.diff(stamps), 1e9 / RATE)  # ns: none is missing
    for topic in ("/map", "/tf_static", "/footprint", "/trail", "/goal"):
        stamps = np.array([stamp for stamp, _ in told[topic]])
        assert len(stamps) >= STEPS / RATE / REFRESH_PERIOD - 1
        np.testing.assert_array_equal(np.diff(stamps), 1e9 * REFRESH_PERIOD)

    def last(topic):
        return told[topic][-1][1]()

    known = tree(last("/tf")) | tree(last("/tf_static"))
    rangers = [f"ultrasonic_{k}" for k in range(8)]
    assert known == {"odom": "map", "base_link": "odom"} | dict.fromkeys(
        ("laser", *rangers), "base_link"
    )
    shown = [entity.frame_id for entity in last("/ultrasonic").entities]
    assert shown == rangers
    cloud = last("/particles")
    assert len(cloud.data) // cloud.point_stride >= LocalizationSettings().min_particles
    assert {field.name for field in cloud.fields} == {"x", "y", "yaw"}


def decoded(channel, data):
    """A message of an advertised channel, read by the channel's own schema."""
    kind, text = channel["schemaEncoding"], base64.b64decode(channel["schema"])
    schema = Schema(id=1, data=text, encoding=kind, name=channel["schemaName"])
    return DecoderFactory().decoder_for(channel["encoding"], schema)(data)


def test_a_port_that_is_taken_or_none_is_one_line_and_no_file_is_begun(
    capsys, tmp_path, monkeypatch
):
    env = RecordEpisodes(gym.make("wheelchair_gym/Navigation-v1", split="test"), port=0)
    for port in (env.port, 70_000):
        assert f"port {port}" in refusal(["simulate", "--scene", "empty", "--live", port], capsys)
    for kind in get_args(Format):
        with pytest.raises(InputError, match=f"port {env.port}"):
            Sink(tmp_path / "run.mcap", env.port, kind)
    assert not list(tmp_path.iterdir())
    env.close()
    server = Mock(port=1)
    monkeypatch.setattr("foxglove.start_server", lambda **_: server)
    with pytest.raises(InputError, match="cannot be written"):
        Sink(tmp_path, 0)
    server.stop.assert_called_once()


@pytest.fixture
def slept(monkeypatch):
    """Durations of sleep [s] of a clock that only sleeping advances."""
    slept = []
    clock = SimpleNamespace(perf_counter=lambda: sum(slept), sleep=slept.append)
    monkeypatch.setattr("agents.watch.time", clock)
    return slept


def test_a_drive_and_its_replay_are_shown_in_real_time(capsys, slept, tmp_path):
    file = str(tmp_path / "drive.mcap")
    words = ["simulate", "--scene", "empty", "--policy", "straight", "--live", "0"]
    assert main([*words, "--record", file]) == 0
    assert "ws://127.0.0.1:" in capsys.readouterr().err
    assert sum(slept) == pytest.approx(3.9, abs=0.5 / RATE)
    slept.clear()
    assert main(["replay", file, "--live", "0"]) == 0
    assert sum(slept) == pytest.approx(3.8, abs=0.5 / RATE)  # no frame after the last step
    said = capsys.readouterr()
    assert "ws://127.0.0.1:" in said.err
    assert "the same rewards" in said.out
