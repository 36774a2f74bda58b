"""Requirements of the hardware tests: compilers, and the emulator."""

import os
from contextlib import ExitStack, closing

import pytest

from wheelchair_gym.hardware.twin.board import TARGETS, build_target, missing_tools


def build(target):
    """The path of a built target; a skip, or a failure where it is required."""
    if lacks := missing_tools(target):
        reason = f"{target} needs {' and '.join(lacks)}: run `make emulator`"
        if os.environ.get("WHEELCHAIR_EMULATOR") == "required":
            pytest.fail(reason)
        pytest.skip(reason)
    return build_target(target)


def build_twin():
    """Build the emulator and the firmware of both boards, as `build` does."""
    for target in TARGETS:
        build(target)


@pytest.fixture(scope="session")
def firmware():
    from tests.hardware.native import Native

    return Native(build("libfirmware.so"))


@pytest.fixture
def host():
    """Makes hosts of twins, as `Hosted` does, which are closed at the end of the test."""
    from tests.hardware.hosted import Hosted

    with ExitStack() as stack:
        yield lambda *given, **more: stack.enter_context(closing(Hosted(*given, **more)))


@pytest.fixture
def bench(firmware):
    from tests.hardware.bench import Bench

    return Bench(firmware)
