"""Laws of the benchmark: every figure asked for, its settings beside it, written whole."""

import json

import numpy as np
import pytest
import shapely
import torch
import yaml

from agents import cli
from agents.benchmarks.environments import irsim_world, wall_loops
from agents.learning.run import PARTS
from tests.agents.learning.tiny_runs import tiny
from tests.conftest import json_of, output_of, put, refusal
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.scenes import make_scene

QUICK = ["--beams", "16,32", "--envs", "1,3", "--threads", "1,2", "--bank", "2"]
QUICK += ["--seconds", "0.1", "--no-peers"]


def test_each_size_is_measured_and_written(tmp_path, capsys):
    found = json_of(["bench", "env", *QUICK, "--out", tmp_path], capsys)
    assert found == json.loads((tmp_path / "env.json").read_text())
    rates = {
        (row["what"], row["beams"], row["envs"], row["threads"]): row["rate"]
        for row in found["rows"]
        if "rate" in row
    }
    sizes = [("one env", 1, 1), ("batch", 1, 1), ("batch", 3, 1), ("batch", 3, 2)]
    assert set(rates) == {(what, beams, n, t) for beams in (16, 32) for what, n, t in sizes}
    assert min(rates.values()) > 0
    assert found["settings"]["bank"] == 2
    assert {"command", "machine", "versions", "commit"} <= set(found)


def test_a_person_and_an_assistant_are_measured_beside_batches_without(tmp_path):
    more = ["--envs", "2", "--threads", "1", "--driver", "expert", "--assist", "slide"]
    assert cli.main(["bench", "env", *QUICK, *more, "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "env.json").read_text())["rows"]
    every = ["plain", "shield", "expert", "expert, slide"]
    assert [row["what"] for row in rows] == 2 * every
    assert all(row["share"]["shield"] > 0.0 for row in rows)


def test_the_peer_drives_between_the_same_walls():
    episode = make_scene("floor_plan").sample(np.random.default_rng(0))
    ours = shapely.MultiLineString(episode.walls.reshape(-1, 2, 2).tolist())
    theirs = shapely.MultiLineString(wall_loops(episode.walls))
    assert theirs.length == pytest.approx(ours.length)
    assert theirs.hausdorff_distance(ours) < 1e-9
    world = yaml.safe_load(irsim_world(EnvSettings(), episode))
    assert world["robot"][0]["sensors"][0]["number"] == 1081
    assert len(world["obstacle"]) < len(episode.walls) / 3


@pytest.mark.parametrize("algorithm", ["ppo", "td3"])
def test_every_part_of_a_training_run_is_measured(algorithm, tmp_path, capsys):
    config = put(tmp_path / "run.json", dump(tiny(algorithm)))
    command = ["bench", "train", algorithm, "--config", str(config), "--frames", "96"]
    said = output_of([*command, "--set", "device=cpu", "--json", tmp_path / "found.json"], capsys)
    found = json.loads((tmp_path / "found.json").read_text())
    assert tuple(found["seconds"]) == tuple(PARTS)
    assert min(found["seconds"].values()) >= 0.0
    assert (found["frames"], found["device"]) == (96, "cpu")
    assert "networks on cpu" in said
    if not torch.cuda.is_available():
        assert "torch finds no GPU" in refusal([*command, "--set", "device=cuda"], capsys)
