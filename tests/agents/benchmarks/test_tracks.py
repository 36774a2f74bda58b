"""The benchmark: its frozen episodes, policies in their own process, and what `verify` finds."""

import gc
import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import closing
from itertools import product
from multiprocessing.connection import Connection
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from agents.benchmarks import tracks
from agents.cli import main
from agents.evaluation.evaluate import drive_episode, make_env
from agents.policies import delegated, make_policy
from agents.policies.delegated import Isolated
from agents.policies.planned import Planned
from agents.policies.scripted import StraightPolicy
from tests.conftest import ROOT, long_but, output_of, refusal
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.types import Command, Shown

NAME = f"{__name__}:"
COMES_LATER = """import runpy, sys, time
while True:
    try:
        runpy.run_path(sys.argv[2])
    except Exception:  # nobody serves yet
        time.sleep(0.2)
"""
TINY = {"scenes": [{"name": "empty", "label": "empty"}], "episodes": 2, "env": {"beams": 16}}


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    """A track of two drives in the empty plane."""
    kinds = ("test", "development")
    monkeypatch.setitem(tracks.TRACKS, "tiny", TINY | {"digests": dict.fromkeys(kinds, "")})
    digests = {kind: tracks.Track("tiny", kind != "test").found_digest() for kind in kinds}
    tracks.TRACKS["tiny"]["digests"] = digests
    assert len(set(digests.values())) == 2


class Peeks:
    """Drives only where it finds the environment, as a policy that reads the truth does."""

    def reset(self, mission):
        self.found = any(isinstance(one, NavigationEnv) for one in gc.get_objects())

    def act(self, reading):
        return Command(np.array([0.5 * self.found, 0.0]))


class Fails(Peeks):
    def act(self, reading):
        raise ValueError("no idea")


class Ends(Peeks):
    """Ends its process, and leaves one behind that holds its pipe while the tests run."""

    def act(self, reading):
        tests = f"/proc/{os.getppid()}"
        if os.fork() == 0:
            while os.path.exists(tests):
                time.sleep(0.1)
        os._exit(3)


class Garbles(Peeks):
    """Answers in its process's stead."""

    def act(self, reading):
        for one in gc.get_objects():
            if isinstance(one, Connection):
                one.send_bytes(b"{}")


class Escapes(Peeks):
    """Answers with an object whose copy would run its code where it is read."""

    def act(self, reading):
        return Command(np.zeros(2), Shown(status=Bomb()))


class Bomb:
    def __reduce__(self):
        return os._exit, (3,)


def driven(policy, steps=40):
    with closing(make_env("empty", {"beams": 16, "max_episode_steps": steps}, None)) as with_map:
        return drive_episode(with_map, policy, 3)


def test_a_policy_in_its_own_process_drives_as_it_does_in_this_one():
    specs = "straight", {"name": "isolated", "policy": "straight"}, Isolated(StraightPolicy())
    here, *there = (driven(make_policy(spec), 4000) for spec in specs)
    assert here["success"]
    for key, other in product(tracks.FIGURES, there):
        assert here[key] == other[key]
    assert make_policy(Isolated(Planned()))
    with pytest.raises(InputError, match="expected a name, or a mapping of plain values"):
        make_policy(Isolated(SimpleNamespace(make=None)))


def test_it_reaches_neither_the_environment_nor_the_key_of_its_world():
    peeks = make_policy(f"{NAME}Peeks")
    assert driven(peeks)["length"] > 1.0
    isolated = make_policy({"name": "isolated", "policy": f"{NAME}Peeks"})
    assert driven(isolated)["length"] == 0.0
    assert driven(make_policy({"name": "isolated", "policy": f"{NAME}Escapes"}))["length"] == 0.0


@pytest.mark.parametrize(
    ("name", "said"),
    [("Fails", "no idea"), ("Ends", "ended in act"), ("Garbles", "no command|gave None")],
)
def test_a_policy_that_fails_is_reported(name, said):
    policy = make_policy({"name": "isolated", "policy": f"{NAME}{name}"})
    other = make_policy({"name": "isolated", "policy": "straight"})
    env = make_env("empty", {"beams": 16}, None)
    env.reset(seed=0)
    other.reset(env.unwrapped.mission)
    for _ in range(2):  # also after its process has ended
        with pytest.raises(RuntimeError, match=said):
            driven(policy)
    other.act(env.unwrapped.mission.reading)  # in a process of its own
    with pytest.raises(RuntimeError, match="it was not reset in this process"):
        make_policy({"name": "isolated", "policy": "straight"}).act(env.unwrapped.mission.reading)
    env.close()


def test_no_answer_is_taken_for_another_one(monkeypatch):
    """An interrupted driver begins anew; two threads whose drivers share a process take turns."""
    driver, other = (make_policy(Isolated(f"{NAME}Fails")) for _ in range(2))
    send, process = Connection.send, driver._process
    assert other._process is process
    monkeypatch.setattr(Connection, "send", lambda *given: send(*given) or held())
    turns, held = [], lambda: turns.append(process.lock.acquire(blocking=False))
    driver._ask("copy", None)
    assert turns == [False]
    held = Mock(side_effect=KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        driver._ask("copy", None)
    with pytest.raises(RuntimeError, match="ended in copy"):
        other._ask("copy", None)


def test_a_frozen_process_is_given_up(monkeypatch):
    monkeypatch.setattr(delegated, "LONGEST", 1.0)
    driver = make_policy(Isolated(f"{NAME}Peeks"))
    os.kill(driver._process.worker.pid, signal.SIGSTOP)
    with pytest.raises(RuntimeError, match="took longer than 1 s in paste"):
        driver._ask("paste", bytes(5_000_000))


def test_results_are_verified_and_changed_ones_are_found(tmp_path, capsys):
    words = ["benchmark", "run", "straight", "--track", "tiny", "--out", f"{tmp_path}"]
    assert "100.0% of 2 arrive" in output_of([*words, "--jobs", "1", "--quiet"], capsys)
    file = tmp_path / "tiny.json"
    verify = ["benchmark", "verify", f"{file}", "--jobs", "1", "--quiet"]
    assert output_of(verify, capsys).endswith("agrees\n")
    result = json.loads(file.read_text())
    result["episodes"][0]["time"] -= 1.0
    file.write_text(json.dumps(result))
    assert "was changed since it was written" in refusal(verify, capsys)
    del result["digest"]  # by somebody who knows how it is made
    result |= tracks.summary(result["episodes"])
    file.write_text(json.dumps(result | {"digest": tracks._digest(result)}))
    assert main(verify) == 1
    assert "does not agree" in capsys.readouterr().out
    assert "'tinny' is unknown" in refusal([*words[:4], "tinny"], capsys)


@pytest.mark.realtime
def test_a_program_that_knows_ros_alone_can_enter(tmp_path):
    """Its drives are in real time, so that `verify` compares outcomes."""
    pytest.importorskip("websockets", reason="pip install 'wheelchair_gym[ros]'")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = ["-c", COMES_LATER, f"ws://127.0.0.1:{port}", ROOT / "examples/ros_pure_pursuit.py"]
    client, spec = subprocess.Popen([sys.executable, *words]), {"name": "ros", "port": port}
    try:
        result, path = tracks.run(spec, "tiny", tmp_path, jobs=2, progress=False)
        agrees, text = tracks.verify(path, 1, progress=False)
    finally:
        client.kill()
        client.wait()
    assert result["success"] == 1.0
    assert agrees
    assert "or real time" in text


@pytest.mark.parametrize("elsewhere", [False, True])
def test_figures_of_a_policy_that_reads_the_truth_do_not_agree(elsewhere, tmp_path, monkeypatch):
    """It arrives where it drives beside the environment, and not in a process of its own.

    A file that names another machine is found by what all of its episodes lose.
    """
    if elsewhere:
        monkeypatch.setitem(tracks.TRACKS["tiny"], "episodes", 6)
        tracks.TRACKS["tiny"]["digests"]["test"] = tracks.Track("tiny").found_digest()
        monkeypatch.setattr(tracks, "DIFFERENT", 1.0)
    result, path = tracks.run(f"{NAME}Peeks", "tiny", tmp_path, progress=False)
    assert result["success"] == 0.0
    for one in result["episodes"]:
        one |= {"success": True, "outcome": "success", "time": 9.0}
    if elsewhere:
        result["machine"]["cpu"] = "another"
    result |= tracks.summary(result["episodes"])
    path.write_text(json.dumps(result | {"digest": tracks._digest(result)}))
    agrees, text = tracks.verify(path, 2, progress=False)
    assert not agrees
    assert "outcome is timeout, not success" in text


@pytest.mark.parametrize("name", long_but(sorted(tracks.TRACKS), ["narrow_places"]))
def test_the_worlds_of_a_track_are_those_of_its_version(name):
    for development in (False, True):
        track = tracks.Track(name, development)
        assert track.found_digest() == track.digest


def test_episodes_that_do_not_add_up_are_refused(tmp_path, capsys):
    """Also where the digest is that of the changed file."""
    result, path = tracks.run("straight", "tiny", tmp_path, progress=False)
    first, *others = result["episodes"]
    twice = [first, first, *others]
    lacking = [{k: v for k, v in first.items() if k != key} for key in ("success", "outcome")]
    wrong = [first | {"success": "yes"}, first | {"scene": ["empty"]}, "empty"]
    changes = [{"episodes": twice} | tracks.summary(twice), {"episodes": []}, {"episodes": 3}]
    changes += [{"episodes": [one, *others]} for one in (*lacking, *wrong)]
    parts = [{"machine": 5}, {"machine": {}}, {"track": ["tiny"]}, {"track": 5}]
    for change in changes + parts:
        changed = result | change
        path.write_text(json.dumps(changed | {"digest": tracks._digest(changed)}))
        said = refusal(["benchmark", "verify", path, "--quiet"], capsys)
        words = "are not those of its episodes, each once"
        assert ("expected the name of a track" if change in parts else words) in said, change


def test_a_file_of_settings_is_a_policy_and_a_few_episodes_are_for_development(tmp_path, capsys):
    (tmp_path / "mine.json").write_text('{"slow": {"name": "random", "seed": 3}}')
    words = ["benchmark", "run", f"{tmp_path}/mine.json:slow", "--track", "tiny", "--quiet"]
    words += ["--out", f"{tmp_path}", "--jobs", "1", "--episodes", "1"]
    assert "--episodes needs --development" in refusal(words, capsys)
    assert "empty: 0 of 1" in output_of([*words, "--development"], capsys)


def test_other_worlds_are_refused(tmp_path):
    tracks.TRACKS["tiny"]["digests"]["test"] = "0" * 64
    with pytest.raises(ValueError, match="draws other worlds than version 1"):
        tracks.run("straight", "tiny", tmp_path)
