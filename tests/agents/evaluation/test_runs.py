"""Runs: the same for all workers, after losses and interruptions, and never made twice."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from joblib._parallel_backends import LokyBackend

from agents import StoppedError
from agents.evaluation.runs import compute, read_store, run_key, source_digest
from tests.agents.evaluation import runs_work as work
from tests.conftest import ROOT, until
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import world_banks
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, write_map
from wheelchair_gym.scenes import make_scene

JOBS = {f"k{seed}": (seed, None) for seed in range(12)}
WHOLE = {key: work.draw(job) for key, job in JOBS.items()}


@pytest.mark.parametrize("workers", [1, 2])
def test_equal_to_the_last_digit_for_all_workers(tmp_path, workers):
    store = tmp_path / "runs.jsonl"
    got = compute(JOBS, work.draw, store, workers=workers, progress=False)
    assert got == WHOLE
    assert list(got) == list(JOBS)
    assert read_store(store) == WHOLE


def test_short_jobs_are_handed_out_together_and_long_ones_each(tmp_path, monkeypatch):
    """Many short jobs before the one that kills its worker: they are few batches."""
    handed, took = [], 1e-4  # s, each job, however fast the machine is
    submit, completed = LokyBackend.submit, LokyBackend.batch_completed

    def counting(self, batch, *arguments, **options):
        handed.append(len(batch))
        return submit(self, batch, *arguments, **options)

    monkeypatch.setattr(LokyBackend, "submit", counting)
    monkeypatch.setattr(
        LokyBackend, "batch_completed", lambda self, size, _: completed(self, size, took * size)
    )
    jobs = {f"k{seed}": (seed, None) for seed in range(2000)}
    got = compute(jobs, work.draw, tmp_path / "s.jsonl", workers=2, progress=False)
    assert got == {key: work.draw(job) for key, job in jobs.items()}
    assert sum(handed) == 2000
    assert max(handed) > 50
    assert handed[0] == 1
    handed.clear()
    took = 0.3
    compute(JOBS, work.draw, tmp_path / "slow.jsonl", workers=2, progress=False)
    assert set(handed) == {1}


def test_a_killed_worker_loses_nothing(tmp_path):
    mark = tmp_path / "mark"
    jobs = {key: (seed, str(mark) if seed == 6 else None) for key, (seed, _) in JOBS.items()}
    store = tmp_path / "runs.jsonl"
    got = compute(jobs, work.dying, store, workers=2, progress=False)
    assert mark.exists()
    assert got == WHOLE
    assert len(store.read_text().splitlines()) == len(JOBS)  # each line once


def test_what_fails_in_a_worker_is_raised_here(tmp_path):
    with pytest.raises(ZeroDivisionError, match="seed"):
        compute(JOBS, work.wrong, tmp_path / "s.jsonl", workers=2, progress=False)


def test_a_run_that_kills_every_worker_ends_in_one_line_with_the_rest_kept(tmp_path):
    store = tmp_path / "runs.jsonl"
    with pytest.raises(ConnectionError, match="workers were lost"):
        compute(JOBS, work.deadly, store, workers=2, progress=False)
    kept = read_store(store)
    assert kept == {key: WHOLE[key] for key in kept}
    assert "k3" not in kept


@pytest.mark.parametrize("how", ["", "in compiled code"])
@pytest.mark.parametrize("stop", [0, 5, 11])
def test_what_was_stopped_goes_on_where_it_was(tmp_path, stop, how):
    jobs = {key: (seed, str(tmp_path)) for key, (seed, _) in JOBS.items()}
    store = tmp_path / "runs.jsonl"
    (tmp_path / f"stop {stop}").write_text(how)
    with pytest.raises(StoppedError, match=f"{stop} of 12 runs"):
        compute(jobs, work.counted, store, progress=False)
    (tmp_path / f"stop {stop}").unlink()
    with store.open("a") as file:
        file.write('{"key": "k11", "rec')  # cut short by a crash
    assert compute(jobs, work.counted, store, progress=False) == WHOLE
    calls = (tmp_path / "calls").read_text().split()
    assert sorted(map(int, calls)) == list(range(12))  # none twice


def test_workers_end_with_a_killed_parent(tmp_path):
    code = (
        "import sys; from tests.agents.evaluation import runs_work as work;"
        "from agents.evaluation.runs import compute;"
        "compute({str(k): (k, sys.argv[1]) for k in range(4)}, work.lasting,"
        "__import__('pathlib').Path(sys.argv[1], 'store'), workers=2, progress=False)"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], cwd=ROOT)

    def begun():
        assert parent.poll() is None
        return [p.name for p in tmp_path.iterdir() if p.name.isdigit()]

    assert until(lambda: len(begun()) == 2)
    found = begun()
    parent.kill()
    parent.wait()
    assert until(lambda: not any(_lives(int(worker)) for worker in found)), "workers live on"


def _lives(process):
    try:
        # Whom nobody has buried yet, in a container without an init, does not live.
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_an_edited_map_is_another_one(tmp_path):
    """A new image of the same YAML file: the map, the keys of runs and the bank's are new."""
    file, found = tmp_path / "a.YAML", []
    scene = {"name": "map_file", "path": str(file)}
    for age in (1, 2):
        cells = np.full((80, 80), FREE, np.int8)
        cells[:age] = OCCUPIED
        write_map(OccupancyGrid(cells, 0.1), file)
        os.utime(file, (1, 1))
        os.utime(file.with_suffix(".pgm"), (age, age))
        grid = make_scene(scene).sample(np.random.default_rng(0)).map
        bank = world_banks._identity(env_settings(None, scene=scene), "test")
        found.append((run_key(scene), bank, int((grid.cells == OCCUPIED).sum())))
    assert not set(found[0]) & set(found[1])


@pytest.mark.parametrize("name", ["a.py", "data/a.yaml", "a.toml", "a.json", "a.c", "a.h"])
def test_an_edit_of_code_or_data_makes_other_runs_and_worlds(name, tmp_path, monkeypatch):
    monkeypatch.setattr(world_banks, "__file__", str(tmp_path / "envs" / "world_banks.py"))
    file, found = tmp_path / name, []
    file.parent.mkdir(exist_ok=True)
    for text in ("", " "):
        file.write_text(text)
        source_digest.cache_clear()
        found.append(
            (source_digest(str(tmp_path)), world_banks._identity(env_settings({}), "test"))
        )
    assert not set(found[0]) & set(found[1])


def test_bad_workers_and_stores_are_refused(tmp_path):
    with pytest.raises(InputError, match="at least 1"):
        compute(JOBS, work.draw, tmp_path / "s", progress=False, workers=0)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        compute(JOBS, work.draw, tmp_path / "file" / "s", progress=False)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for room in (40, 39):  # bytes: less than a line, and none
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
        try:
            with pytest.raises(InputError, match="full: cannot be written"):
                compute(JOBS, work.draw, tmp_path / "full", progress=False)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
