"""Evaluation: what is stored is not computed again, and nothing depends on the workers."""

import json

import pytest

from agents import evaluate as module
from agents.evaluate import STORE, evaluate
from agents.metrics import TIMING
from agents.runs import StoppedError, read_store
from wheelchair_gym.config import InputError

SHORT = {"config": {"task": {"time_base": 2.0, "time_factor": 0.0}}, "beams": 45}
WHAT = (["random", "straight"], ["floor_plan"], [0, 1])


def timeless(records):
    return [{k: v for k, v in record.items() if k not in TIMING} for record in records]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Records made in one go, in one process."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, evaluate(*WHAT, env=SHORT, folder=folder, progress=False)


def test_records_come_in_order_with_pictures_of_failures(whole):
    folder, records = whole
    order = [(r["policy"], r["scene"], r["seed"]) for r in records]
    assert order == [(p, "floor_plan", s) for p in WHAT[0] for s in WHAT[2]]
    for record in records:
        assert record["outcome"] in ("timeout", "collision")
        assert (folder / record["picture"]).read_bytes()[:4] == b"\x89PNG"


def ctrl_c():
    raise KeyboardInterrupt


def ctrl_c_in_compiled_code():
    raise SystemError("returned a result with an exception set") from KeyboardInterrupt()


@pytest.mark.parametrize("stop", [ctrl_c, ctrl_c_in_compiled_code])
@pytest.mark.parametrize("finished", [0, 3])
def test_only_what_is_missing_is_computed(whole, tmp_path, monkeypatch, finished, stop):
    calls = []
    real = module.run_episode

    def counted(*arguments):
        if len(calls) == finished:
            stop()
        calls.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(module, "run_episode", counted)
    with pytest.raises(StoppedError, match=f"{finished} of 4"):
        evaluate(*WHAT, env=SHORT, folder=tmp_path, progress=False)
    with (tmp_path / STORE).open("a") as store:
        store.write('{"key": "cut sho')
    monkeypatch.setattr(module, "run_episode", lambda *a: calls.append(a) or real(*a))
    records = evaluate(*WHAT, env=SHORT, folder=tmp_path, progress=False)
    assert len(calls) == 4
    assert timeless(records) == timeless(whole[1])
    assert len(read_store(tmp_path / STORE)) == 4


def test_other_settings_are_other_episodes(whole, monkeypatch):
    folder, _ = whole
    calls = []
    monkeypatch.setattr(
        module, "run_episode", lambda *a: calls.append(a) or {"policy": "x", "picture": None}
    )
    evaluate(*WHAT, env=SHORT, folder=folder, progress=False)
    assert not calls
    evaluate(*WHAT, env=SHORT | {"pose_source": "odometry"}, folder=folder, progress=False)
    assert len(calls) == 4


def test_two_workers_find_the_same(whole, tmp_path):
    records = evaluate(*WHAT, env=SHORT, folder=tmp_path, jobs=2, progress=False)
    assert timeless(records) == timeless(whole[1])
    json.dumps(records, allow_nan=False)


def test_wrong_input_is_told_before_anything_runs(tmp_path):
    for policies, scenes, said in (
        (["nobody"], ["floor_plan"], "nobody"),
        (["random"], ["nowhere"], "nowhere"),
    ):
        with pytest.raises(InputError, match=said):
            evaluate(policies, scenes, [0], folder=tmp_path, progress=False)
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        evaluate(["random"], ["floor_plan"], [0], folder=blocked / "x", progress=False)
