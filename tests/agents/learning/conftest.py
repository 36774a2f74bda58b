"""A run that the tests of learning look at."""

import pytest

from agents.learning.run import Run
from tests.agents.learning.tiny_runs import tiny


@pytest.fixture(scope="package")
def trained(tmp_path_factory):
    run = Run(tiny("ppo"), 0, tmp_path_factory.mktemp("trained"))
    while not run.done:
        run.learn()
    run.close()
    return run, run.folder
