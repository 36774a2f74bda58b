"""Signals are declared once: the classes have their fields, and what is declared is written."""

import pytest

from wheelchair_gym.compiled.kernel import check_written
from wheelchair_gym.signals import READING, TRUTH
from wheelchair_gym.task.rewards import TERMS, write_terms
from wheelchair_gym.types import Reading, Truth


@pytest.mark.parametrize(("owner", "signals"), [(Reading, READING), (Truth, TRUTH)])
def test_the_classes_have_the_fields_of_the_table(owner, signals):
    """The environment fills in the further fields of a reading for a policy."""
    names = owner._fields[: len(signals)]
    assert {signal.name for signal in signals} == set(names)
    more = {"halted", "action", "shield_intervention", "map", "stick"}
    assert set(owner._fields[len(signals) :]) <= more


def test_what_no_kernel_writes_is_refused():
    with pytest.raises(TypeError, match="'comfort' is declared, and write_terms never writes it"):
        check_written("reward term", (*TERMS, "comfort"), write_terms)
