"""Kernels: what is made of them, who makes it, and what a person sees meanwhile."""

import errno
import fcntl
import mmap
import os
import pty
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest
from numba.core.caching import CacheImpl

from tests.conftest import ROOT, need_pty
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled import kernel, second_process
from wheelchair_gym.envs import results

# Three kernels, one calling the next, and one that assigns to a slice.
TOY = """
from wheelchair_gym.compiled.kernel import kernel

@kernel
def low(x):
    return 2.0 * x

@kernel
def middle(x):
    return low(x) + 1.0

@kernel
def high(x):
    return middle(x) + low(x)

@kernel
def laid(rows, row):
    rows[0, :2] = row
"""
# A kernel that calls an intrinsic of another file, as it is and under a digest of its own.
INTRINSIC = """
from numba import types
from numba.extending import intrinsic

def number():
    return intrinsic(lambda typingctx: (
        types.float64(), lambda context, builder, *_: context.get_constant(types.float64, {})
    ))

plain, record = number(), number()
record.source_digest = "of a record"
"""
CALLER = """
from intrinsics import {0}
from wheelchair_gym.compiled.kernel import kernel

@kernel
def value():
    return {0}()
"""
# A kernel that calls one below it, which calls one of another file.
EARLY = """
from wheelchair_gym.compiled.kernel import kernel

SCALE = {}

@kernel
def scaled(x):
    return {}
"""
LATE = """
from early import SCALE, scaled
from wheelchair_gym.compiled.kernel import kernel

@kernel
def first(x):
    return second(x)

@kernel
def second(x):
    return SCALE * scaled(x)
"""
HEAD = """
import numba.core.event as event
from wheelchair_gym.compiled import second_process
from wheelchair_gym.compiled.second_process import progress
from toy import high, laid, low, middle
class Count(event.Listener):
    names = []
    def on_start(self, event):
        self.names.append(event.data["name"])
    def on_end(self, event):
        pass
event.register("numba:run_pass", Count())
def lowered():
    return sorted(n for n in Count.names if n.startswith("native_lowering"))
"""

# High is compiled by a helper, and then called.
BESIDE = """
import os
from wheelchair_gym.compiled.second_process import compile_beside, _helpers
os.sched_getaffinity = lambda pid: {0, 1}
def beside():
    compile_beside(high, high, 3.0)
    for helper in _helpers:
        helper.wait()
    print(len(_helpers), high(3.0), lowered())
"""

# What a user of numba sees, error texts included.
USER = """
import sys
import numba
import numpy as np
from numba.core import event
from numba.core.registry import cpu_target
from numba.experimental import jitclass

def show(work):
    try:
        print(work())
    except Exception as error:
        print(type(error).__name__, error)

@jitclass([("x", numba.float64)])
class Point:
    def __init__(self, x):
        self.x = x
    def twice(self):
        return 2.0 * self.x

@numba.cfunc("float64(float64)")
def doubled(x):
    return 2.0 * x

@numba.vectorize(["float64(float64, float64)"])
def added(a, b):
    return a + b

@numba.guvectorize(["void(float64[:], float64[:])"], "(n)->()")
def summed(row, out):
    out[0] = row.sum()

@numba.njit(parallel=True)
def shared_sum(rows):
    total = 0.0
    for i in numba.prange(len(rows)):
        total += rows[i]
    return total

@numba.njit
def laid(rows, row):
    rows[0, :2] = row

@numba.njit
def untyped(x):
    return x.nothing

def use():
    rows = np.arange(12.0).reshape(3, 4)
    show(lambda: Point(3.0).twice())
    show(lambda: doubled.ctypes(4.0))
    show(lambda: added(rows[0], 1.0))
    show(lambda: summed(rows))
    show(lambda: shared_sum(rows[0]))
    show(lambda: laid(rows, np.zeros(3)))
    show(lambda: untyped(1.0))
    print(type(cpu_target.target_context.codegen().create_library("mine")).__name__)
    print({kind: len(listeners) for kind, listeners in event._registered.items() if listeners})
"""
# Before it: an environment is made; a fork of the process would be printed.
MAKE = """
import os
os.register_at_fork(before=lambda: print("fork"))
import gymnasium
import wheelchair_gym
env = gymnasium.make("wheelchair_gym/Navigation-v1", scene="empty")
env.reset(seed=0)
"""


def run(folder: Path, code: str, **changes) -> subprocess.CompletedProcess[str]:
    """Run code after the toy kernels, with an empty folder for what is compiled."""
    with start(folder, code, **changes) as process:
        out, err = process.communicate()
    return subprocess.CompletedProcess([], process.returncode, out, err)


def start(folder: Path, code: str, stderr: int = subprocess.PIPE) -> subprocess.Popen[str]:
    """Start a process for `run`."""
    (folder / "toy.py").write_text(TOY)
    return subprocess.Popen(
        [sys.executable, "-c", HEAD + code], cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(folder / "compiled")},
        stdout=subprocess.PIPE, stderr=stderr, text=True,
    )  # fmt: skip


def test_machine_code_is_made_for_what_python_calls_alone(tmp_path):
    ran = run(
        tmp_path,
        "print(high(3.0))\n"
        "for k in (low, middle):\n"
        "    part, = k.part.overloads.values()\n"
        "    print(len(k.overloads), part.library._finalized)\n"
        "print(low(5.0), len(low.overloads))\n",
    )
    assert ran.stdout == "13.0\n0 False\n0 False\n10.0 1\n", ran.stderr


def test_a_user_of_numba_sees_no_difference(tmp_path):
    """Types, error texts, code generation and listeners of numba are as without the project."""
    seen = []
    (tmp_path / "make.py").write_text(MAKE)
    for first in ("sys", "make"):
        process = subprocess.run(
            [sys.executable, "-c", f"import {first}\n{USER}use()\n"],
            cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_OPT": "0"},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        seen.append(process.stdout)
    assert seen[0] == seen[1]
    assert "6.0\n8.0\n[1. 2. 3. 4.]\n[ 6. 22. 38.]\n6.0\nValueError" in seen[0]
    assert "JITCodeLibrary" in seen[0]


def test_a_function_of_a_user_calls_kernels_that_were_loaded(tmp_path):
    """A kernel is pickled by its name."""
    code = (
        "import numba, pickle\n"
        "@numba.njit\n"
        "def user(x):\n"
        "    return high(x) + low(x)\n"
        "print(user(2.0), high(3.0), user(3.0), pickle.loads(pickle.dumps(high)) is high)\n"
    )
    for _ in range(2):
        ran = run(tmp_path, code)
        assert ran.stdout == "13.0 13.0 19.0 True\n", ran.stderr


def test_a_terminal_shows_a_count_from_the_first_kernel_on(tmp_path):
    need_pty()
    ours, theirs = pty.openpty()
    ran = run(tmp_path, "high(3.0)\n", stderr=theirs)
    os.close(theirs)
    with os.fdopen(ours, "rb") as terminal:
        shown = terminal.read1(10000).decode()
    assert ran.returncode == 0
    for k, name in enumerate(("high", "middle", "low"), start=1):
        line = f"compiling kernel {k}, once on this machine: toy.{name}"
        assert f"\r\033[K{line}" in shown
    assert shown.endswith("\r\033[K")


def test_a_log_gets_a_line_now_and_then(tmp_path):
    code = "progress._due, second_process._LOG_PAUSE = 0.0, 600.0\nhigh(3.0)\n"
    shown = run(tmp_path, code).stderr
    assert shown == "compiling kernel 1, once on this machine; 0 s so far\n"
    assert run(tmp_path, code).stderr == ""  # it was compiled before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="helpers are for Linux")
def test_a_helper_compiles_what_its_parent_then_loads(tmp_path):
    ran = run(tmp_path, BESIDE + "beside()\nbeside()\n")
    assert ran.stdout == "1 13.0 []\n1 13.0 []\n", ran.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="helpers are for Linux")
def test_helpers_of_the_process_that_warms_the_studio_up_compile(tmp_path):
    code = (
        "from agents.studio import warm_up\n"
        "warm_up.first_drive, warm_up.everything = beside, lambda: print('everything')\n"
        "warm_up.compile_in_process()\n"
    )
    ran = run(tmp_path, BESIDE + code)
    told = ["1 13.0 []", "the first drive may begin", "everything"]
    assert ran.stdout.splitlines() == told, ran.stderr


def test_a_part_is_compiled_without_being_run(tmp_path):
    code = (
        "from wheelchair_gym.compiled.kernel import compile_part\n"
        "compile_part(low, 1.0)\n"
        "print(lowered(), len(low.overloads), high(3.0))\n"
        "print(lowered().count('native_lowering [low]'))\n"
    )
    ran = run(tmp_path, code)
    assert ran.stdout == "['native_lowering [low]'] 0 13.0\n1\n", ran.stdout + ran.stderr


def test_a_kernel_that_calls_one_below_it_follows_an_edit_of_what_that_imports(tmp_path):
    """Of a kernel, or of a constant that it freezes: a shield may not go on with an old copy.

    Neither may it where a process was killed while it stored the new one.
    """
    (tmp_path / "late.py").write_text(LATE)
    killed = "import numba.core.caching as caching\nfrom late import first\n"
    killed += "caching.IndexDataCacheFile._save_data = lambda *_: os._exit(9)\nfirst(3.0)"
    # Of other lengths each: Python's own cache tells seconds and size.
    for scale, body, result in ((2.0, "x", 6.0), (15.0, "x", 45.0), (15.0, "x + 1.0", 60.0)):
        (tmp_path / "early.py").write_text(EARLY.format(scale, body))
        assert run(tmp_path, f"import os\n{killed}").returncode == 9
        ran = run(tmp_path, "from late import first\nprint(first(3.0))")
        assert ran.stdout.split() == [str(result)], ran.stderr


@pytest.mark.parametrize("name", ["plain", "record"])
def test_a_kernel_follows_an_edit_of_an_intrinsic_that_it_calls(tmp_path, name):
    (tmp_path / "caller.py").write_text(CALLER.format(name))
    for value in (2.0, 15.0):
        (tmp_path / "intrinsics.py").write_text(INTRINSIC.format(value))
        ran = run(tmp_path, "from caller import value\nprint(value())")
        assert ran.stdout.split() == [str(value)], ran.stderr


def test_what_was_compiled_for_a_class_that_is_gone_is_compiled_anew(tmp_path):
    text = (
        "from typing import NamedTuple\n"
        "from wheelchair_gym.compiled.kernel import kernel\n"
        "class Old(NamedTuple):\n    x: float\n"
        "@kernel\ndef twice(own):\n    return 2.0 * own.x\n"
        "if __name__ != '__main__':\n    print(twice(Old(3.0)))\n"
    )
    for name in ("Old", "Young", "Young"):
        (tmp_path / "changing.py").write_text(text.replace("Old", name))
        ran = run(tmp_path, "import changing\n")
        assert ran.stdout == "6.0\n", ran.stderr


def test_two_processes_compile_a_kernel_once(tmp_path):
    both = [start(tmp_path, "print(high(3.0), lowered())\n") for _ in range(2)]
    told = "".join(process.communicate()[0] for process in both)
    assert told.count("13.0") == 2
    assert told.count("native_lowering [high]") == 1


def test_a_process_that_hangs_with_a_lock_delays_the_others_only(tmp_path):
    code = (
        "import fcntl, wheelchair_gym.compiled.second_process as beside\n"
        "held, beside._PATIENCE = [], 0.7\n"
        "for lock in (low, high):\n"
        "    path = f'{lock._cache._cache_file._index_path}.lock'\n"
        "    beside.Path(path).parent.mkdir(parents=True, exist_ok=True)\n"
        "    held.append(open(path, 'ab'))\n"
        "    fcntl.flock(held[-1], fcntl.LOCK_EX)\n"
        "print(high(3.0))\n"
    )
    ran = run(tmp_path, code)
    assert ran.stdout == "13.0\n", ran.stderr
    assert "waiting for another process" in ran.stderr


def test_a_system_may_lack_folders_locks_and_large_pages(monkeypatch, tmp_path):
    monkeypatch.setattr(fcntl, "flock", Mock(side_effect=OSError(errno.ENOLCK, "no locks")))
    monkeypatch.setattr(mmap, "MADV_HUGEPAGE", 9999)  # which no kernel knows
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    with second_process.locked(tmp_path / "lock"):
        assert len(results._fresh_memory(1 << 21)) == 1 << 21
    with pytest.raises(InputError, match="set NUMBA_CACHE_DIR"):
        kernel.kernel(lambda x: x)
