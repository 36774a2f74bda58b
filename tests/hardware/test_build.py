"""A missing tool is named, with the command that installs it."""

import pytest

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.twin import board as build


@pytest.fixture
def bare(monkeypatch, tmp_path):
    """A machine without compilers and without anything built."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(build, "_SIMAVR", tmp_path / "sim_avr.h")
    monkeypatch.setattr(build, "_folder", lambda: tmp_path / "built")
    build.build_target.cache_clear()
    yield
    build.build_target.cache_clear()


@pytest.mark.parametrize(
    ("target", "needs"),
    [("drive.elf", ["make", "avr-gcc"]), ("libemulator.so", ["make", "cc", "simavr"])],
)
def test_a_missing_compiler_is_named_with_the_command_that_installs_it(bare, target, needs):
    assert build.missing_tools(target) == needs
    with pytest.raises(InputError, match=f"{target} needs .*run `make emulator`"):
        build.build_target(target)


def test_a_place_that_cannot_be_written_is_said_so(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(build, "_folder", lambda: tmp_path / "file" / "built")
    build.build_target.cache_clear()
    if build.missing_tools("libfirmware.so"):
        pytest.skip("libfirmware.so needs a compiler: run `make emulator`")
    with pytest.raises(InputError, match=r"cannot be made .*XDG_CACHE_HOME"):
        build.build_target("libfirmware.so")
    build.build_target.cache_clear()
