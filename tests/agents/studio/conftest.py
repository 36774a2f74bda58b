"""A studio for the tests of a module."""

import pytest

from tests.agents.studio.served import serving


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("studio")) as one:
        yield one
