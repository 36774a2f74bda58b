"""Laws of files: any content is read or refused in one line, within the limits."""

import ast
import contextlib
import io
import json
import os
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from agents.cli import main
from agents.evaluation.runs import compute, read_store
from agents.learning.weights import load_weights, save_weights
from tests.agents.learning.tiny_runs import random_weights
from tests.conftest import ROOT, modules, put, refusal
from tests.fuzz import READERS, Watched, fuzz, png_chunk
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.files import LIMITS, atomic_write, exists
from wheelchair_gym.envs.settings import env_settings

OPENING = {"read_bytes", "read_text", "read_json", "opened", "open", "imread"}
LOADING = {"joblib.load", "torch.load", "np.load", "json.load", "yaml.load", "pickle.load"}
# Functions that open what no stranger gives, and why each needs no case among the readers.
OWN = {
    "base.files.opened": "opens for all",
    "base.files.read_bytes": "reads for all",
    "base.files.read_text": "reads for all",
    "base.files.read_json": "reads for all",
    "base.files.parse_yaml": "parses for all",
    "base.files._digest": "hashes for all",
    "recording.read_bags._check_parts": "a description of a bag, whose lines are counted",
    "maps.io.map_server._parts": "as _description, which refuses what is wrong",
    "__init__.read_data": "data files of the project",
    "studio.__init__.page_texts": "texts of the page, files of the project",
    "compiled.address.read_record": "tables of records, files of the project",
    "compiled.kernel._file_digest": "sources of the project",
    "evaluation.runs.source_digest": "sources of the project",
    "envs.world_banks._identity": "sources of the project",
    "hardware.twin.board._folder": "sources of the project",
    "envs.world_banks._of_bank": "pickles of a folder of this program's own, as __pycache__ is",
    "compiled.second_process.locked": "an empty file that is a lock",
    "hardware.boards.ports.open_port": "a serial port",
    "hardware.boards.ports.is_running": "of the kernel",
    "hardware.twin.serve.pump": "the twin's own lines",
    "hardware.twin.serve._flush": "the twin's own lines",
    "hardware.boards.ports._lockers": "of the kernel",
    "hardware.boards.ports._program": "of the kernel",
    "hardware.ros.rosbridge.read_token": "a secret of the user's own",
    "recording.write_bags.__init__": "opened to be written",
    "recording.sink.__init__": "opened to be written",
    "evaluation.compare.webp": "a picture that was just written",
    "envs.settings._chair": "comes with the package",
    "hardware.twin.inprocess.__init__": "the twin's own lines",
    "evaluation.compare._video": "a video that was just written",
    "studies.model.published": "comes with the package",
    "scenes.arena.read_table": "comes with the package",
    "benchmarks.environments.resident_bytes": "of the kernel",
    "evaluation.provenance.machine": "of the kernel",
    "cli.__init__._replace_closed_streams": "standard streams",
    "cli.__init__._drop_output": "standard streams",
    "hardware.twin.board._library": "of the package",
    "cli.train._last_row": "written by the same command",
    "cli.train._in_processes": "opened to be written",
    "learning.folder.save_checkpoint": "opened to be written",
    "learning.sb3.save_model": "opened to be written",
    "people.folder.__init__": "opened to be written; `read_chain` reads it",
    "evaluation.runs.open_store": "opened to be written; `read_store` reads it",
}


def opening_functions():
    """Functions of the project, as module.function, that open files."""
    for name, path in modules():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef) and any(map(opens, ast.walk(node))):
                yield f"{name.partition('.')[2]}.{node.name}"


def opens(node):
    """Return True if a node is a call that opens a file."""
    if not isinstance(node, ast.Call):
        return False
    name = getattr(node.func, "attr", getattr(node.func, "id", ""))
    return name in OPENING or (name == "load" and ast.unparse(node.func) in LOADING)


def test_every_function_that_opens_files_is_fuzzed():
    """A reader without a case among `tests.fuzz.READERS` fails here; so does a case of none."""
    found = set(opening_functions())
    fuzzed = {function for reader in READERS.values() for function in reader.covers}
    assert found - fuzzed - set(OWN) == set(), "add a reader to tests/fuzz.py"
    assert (fuzzed | set(OWN)) - found == set(), "no such function opens a file"


@pytest.mark.parametrize("count", [20, pytest.param(2000, marks=pytest.mark.long)])
def test_mutations_of_valid_files_are_read_or_refused(count):
    """Nothing crashes, hangs, fills the memory or ends in a traceback."""
    with contextlib.closing(Watched()) as watched:
        failed = {
            name: found["failed"]
            for name in READERS
            if (found := fuzz(watched, name, range(count)))["failed"]
        }
    assert failed == {}


# ---- what strangers tried, each by the command that reads it


def png(width, height, data=b""):
    """A PNG whose header says so."""
    chunks = ((b"IHDR", width.to_bytes(4, "big") + height.to_bytes(4, "big") + b"\x08\0\0\0\0"),
              (b"IDAT", zlib.compress(data)), (b"IEND", b""))  # fmt: skip
    return b"\x89PNG\r\n\x1a\n" + b"".join(png_chunk(*chunk) for chunk in chunks)


def bomb(kind="<f4", shape="(8000000000,)"):
    """Weights whose one array says it is large, in a small file."""
    out = io.BytesIO()
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("card.npy", b"\x93NUMPY\x01\0" + len(head).to_bytes(2, "little") + head)
        packed.writestr("zeros.npy", bytes(2**25))
    return out.getvalue()


YAML = (
    "image: {}\nresolution: {}\norigin: [0, 0, 0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
)
ANCHORS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 9)}]\n" for k in range(10)
)
PROBLEM = {"name": "p", "size": 5, "rects": [[2, 1, 3, 2]], "start": [1, 2], "goal": [4, 2]}


def plan(file):
    return ["plan", "--map", file, "--planner", "rrt", "--start", "1,1", "--goal", "2,2"]


def plan_map(text, image=b""):
    def case(folder):
        (folder / "map.png").write_bytes(image)
        return plan(put(folder / "map.yaml", text))

    return case


def problem(text=None, **changes):
    def case(folder):
        file = put(folder / "problem_files.json", text or [PROBLEM | changes])
        return ["plan", "--problems", file, "--planner", "visibility"]

    return case


def config(content):
    def case(folder):
        file = put(folder / "env.json", content)
        return ["simulate", "--policy", "straight", "--config", file]

    return case


def weights(content):
    def case(folder):
        (folder / "mine.npz").write_bytes(content)
        return ["simulate", "--scene", "empty", "--policy", folder / "mine.npz"]

    return case


def pipe(folder):
    os.mkfifo(folder / "pipe")
    return plan_map(YAML.format("pipe", 0.05))(folder)


TRIED = {
    "anchors ten deep": plan_map(ANCHORS + YAML.format("map.png", 0.05)),
    "an image that is a pipe": pipe,
    "an image that is a device": plan_map(YAML.format("/dev/zero", 0.05)),
    "an image that is a folder": plan_map(YAML.format(".", 0.05)),
    "an image with NUL in its name": plan_map(YAML.format('"a\\0b"', 0.05)),
    "an image of 60,000 by 60,000": plan_map(
        YAML.format("map.png", 0.05), png(60_000, 60_000, bytes(10**6))
    ),
    "cells of a kilometre": plan_map(YAML.format("map.png", 1e3), png(900, 1, bytes(901))),
    "a map that is a pipe": lambda folder: (
        os.mkfifo(folder / "m.map") or plan(folder / "m.map")
    ),
    "a map with NUL in its name": lambda folder: plan("a\0b.yaml"),
    "problems that are a device": lambda folder: [
        "plan", "--problems", "/dev/zero", "--planner", "rrt",
    ],
    "a size of 1e155": problem(size=1e155),
    "a size of 1e308": problem(size=1e308),
    "a rectangle of 1e155": problem(rects=[[0, 0, 1e155, 1]]),
    "a goal at 1e155": problem(goal=[1e155, 1]),
    "a size of 400 digits": problem(size=10**400),
    "a size of 4,301 digits": problem(json.dumps([PROBLEM]).replace("5", "9" * 4301, 1)),
    "half a surrogate pair": problem(name="\ud800"),
    "lists 100,000 deep": problem("[" * 100_000),
    "lists 900 deep": problem("[" * 900 + "]" * 900),
    "a scene that is a list": config({"scene": []}),
    "a scene whose name is an object": config({"scene": {"name": {}}}),
    "a scene that is deep": config('{"scene": ' + '{"name": ' * 500 + "1" + "}" * 501),
    "a room of 1e155": config({"scene": {"name": "empty", "size": [1e155, 1e155]}}),
    "a clutter of 1e155": config({"scene": {"name": "clutter", "width": 1e155}}),
    "a mass of 400 digits": config({"chair": {"body": {"mass": 10**400}}}),
    "a seed of 400 digits": config({"bank": {"seed": 10**400}}),
    "a tolerance of 1e155": config({"task": {"tolerance": 1e155}}),
    "a config that is a pipe": lambda folder: [
        os.mkfifo(folder / "p") or "simulate", "--config", folder / "p",
    ],
    "weights that say 32 GB": weights(bomb()),
    "weights of objects": weights(bomb("|O", "(1,)")),
    "a setting of 4,301 digits": lambda folder: [
        *problem()(folder), "--set", "iterations=" + "9" * 4301,
    ],
    "a log that is a device": lambda folder: ["map", "--log", "/dev/zero", "--out", folder / "o"],
    "a recording that is a device": lambda folder: ["replay", "/dev/zero"],
    "a recording with NUL in its name": lambda folder: ["replay", "a\0b.mcap"],
}  # fmt: skip


@pytest.mark.parametrize("case", sorted(TRIED))
def test_what_strangers_tried_is_one_line_and_code_2(tmp_path, capfd, case):
    assert len(refusal(TRIED[case](tmp_path), capfd)) < 1100


WRONG_SHAPES = {
    "an output of three": {"dense2.w": (3, 32), "dense2.b": (3,)},
    "an input too narrow": {"dense0.w": (32, 7)},
    "a scalar": {"dense1.b": ()},
    "no rows": {"dense1.w": (0, 32), "dense1.b": (0,)},
    "three dimensions": {"dense0.w": (32, 2, 2)},
    "an array of no layer": {"dense7.w": (2, 2)},
}


@pytest.mark.parametrize("case", sorted(WRONG_SHAPES))
def test_weights_of_wrong_shapes_and_a_right_digest_are_refused(tmp_path, case):
    known = random_weights()
    for name, shape in WRONG_SHAPES[case].items():
        known.arrays[name] = np.zeros(shape, np.float32)
    save_weights(tmp_path / "mine.npz", known)
    with pytest.raises(InputError, match=r"mine\.npz: expected complete weights of a policy \("):
        load_weights(tmp_path / "mine.npz")


@pytest.mark.parametrize(
    ("key", "named"),
    [
        ("guidance", "this:s"),
        ("guidance", {"call": "this:s"}),
        ("driver", ["novice", "this:s"]),
        ("assistant", "this:s"),
    ],
)
def test_weights_name_no_code(tmp_path, key, named):
    """Reading them imports nothing."""
    known = random_weights()
    known.card["env"][key] = named
    save_weights(tmp_path / "mine.npz", known)
    with pytest.raises(InputError, match=rf"env\.{key}.* names code"):
        load_weights(tmp_path / "mine.npz")
    assert "this" not in sys.modules


def square(job):
    return {"value": job * job}


def test_a_damaged_store_is_resumed_and_says_how_many_lines_it_skipped(tmp_path, capsys):
    store = tmp_path / "episodes.jsonl"
    jobs = {f"{k}": k for k in range(8)}
    whole = compute(jobs, square, store, progress=False)
    lines = store.read_bytes().splitlines(keepends=True)
    lines[1] = lines[1].replace(b"value", b"val\xffe")  # a bad byte
    lines[2] = lines[2].replace(b'{"value": 4}', b"null")
    lines[3] = lines[3].replace(b'{"value": 9}', b'{"value": 8}')  # a byte that still is JSON
    lines[4] = lines[4][:9] + b"\n"
    lines[5] = b"[1, 2]\n"
    lines[6] = b"{" * 5000 + b"\n"
    store.write_bytes(b"".join(lines))
    made = []

    def counted(job):
        made.append(job)
        return square(job)

    assert compute(jobs, counted, store, progress=False) == whole
    assert made == [1, 2, 3, 4, 5, 6]
    said = capsys.readouterr().err
    assert said == f"wheelchair: {store}: skipped 6 damaged lines; the runs are made again\n"
    store.write_text('{"key": "0", "record": {"value": 0}}\n')  # as 0.1 wrote it
    assert read_store(store) == {"0": {"value": 0}}
    assert capsys.readouterr().err == ""


def test_a_store_that_is_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "episodes.jsonl")
    with pytest.raises(InputError, match="not a regular file"):
        compute({"0": 0}, square, tmp_path / "episodes.jsonl", progress=False)


FULL, CLOSED = (
    f"wheelchair: standard output: cannot be written ({why}"
    for why in ("No space left", "Bad file descriptor")
)


def full():
    """A device that takes nothing."""
    return open("/dev/full", "w")


def left():
    """The end to write to of a pipe whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    return open(writer, "w")


@pytest.mark.parametrize(
    ("output", "code", "says"), [(full, 2, FULL), (lambda: None, 2, CLOSED), (left, 141, "")]
)
@pytest.mark.parametrize("words", [["settings", "limits"], ["settings", "limits", "--json", "-"]])
def test_output_that_cannot_be_written_is_one_line(monkeypatch, capfd, output, code, says, words):
    """A reader that leaves ends it quietly."""
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", output())
        assert main(words) == code
        sys.stdout.close()  # which writes nothing more
    said = capfd.readouterr().err
    assert said.startswith(says)
    assert said.count("\n") == (1 if says else 0)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ("--help > /dev/full", 2, FULL), ("--help >&-", 2, CLOSED), ("--help 2>&-", 0, ""),
        ("sensors chair lattice --json - | head -1 | grep .", 0, ""),
    ],
)  # fmt: skip
def test_so_is_help_and_the_end_of_the_program(words, code, says):
    done = subprocess.run(
        ["bash", "-c", f'"$0" -m wheelchair_gym settings {words}', sys.executable],
        capture_output=True, text=True, check=False, cwd=ROOT, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.stderr.startswith(says)
    assert done.stderr.count("\n") == (1 if says else 0)
    assert done.returncode == code


def test_the_page_of_files_names_every_limit():
    text = (ROOT / "docs" / "how_to" / "files.md").read_text(encoding="utf-8")
    for limit in LIMITS.values():
        assert f"| {limit.what} | {limit.maximum:,} {limit.unit} |" in text


def test_a_file_that_is_larger_than_its_limit_is_not_read(tmp_path, capsys):
    path = Path(tmp_path / "large.json")
    with path.open("wb") as file:
        file.truncate(LIMITS["json"].maximum + 1)  # sparse: takes no room
    assert "large.json" in refusal(["plan", "--problems", path, "--planner", "rrt"], capsys)


def test_a_written_file_keeps_its_permissions_and_a_new_one_has_the_usual_ones(tmp_path):
    usual, mine = tmp_path / "usual", tmp_path / "mine"
    usual.touch()
    for mode in (None, 0o600, 0o664):
        if mode is not None:
            mine.chmod(mode)
        with atomic_write(mine) as part:
            part.write_text("1")
        expected = usual.stat().st_mode & 0o777 if mode is None else mode
        assert mine.stat().st_mode & 0o777 == expected
    program = "import sys; from wheelchair_gym.base.files import atomic_write\n"
    program += "with atomic_write(sys.argv[1]) as part: part.touch()"
    command = 'umask 077; exec "$0" -c "$1" own', sys.executable, program
    subprocess.run(["sh", "-c", *command], check=True, cwd=tmp_path)
    assert (tmp_path / "own").stat().st_mode & 0o777 == 0o600


def test_shipped_files_are_found_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert exists("wheelchair_gym/maps/data/clinic.yaml")
    assert env_settings("configs/env.json", model="rear").sensors.looks_back
    assert not exists("configs/no_such.json")
