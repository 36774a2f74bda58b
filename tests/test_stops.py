"""Laws of the table of stops: it has every message of a part, and nothing goes on by mistake."""

import pytest

from wheelchair_gym.hardware.boards.protocol import Fault
from wheelchair_gym.safety import stops as causes
from wheelchair_gym.safety.state import REASONS, UNSEEN

BOARD = "the drive board has stopped ({}); a person must re-arm it"


def test_every_fault_of_the_board_and_of_the_shield_has_its_row():
    for fault in Fault:
        (row,) = causes.matching_stops(BOARD.format(fault.name))
        assert (row.name, row.ends) == (fault.name, causes.Ends.NEW_RUN)
    for name in REASONS[UNSEEN + 1 :]:
        (row,) = causes.matching_stops(causes.shield_message(name))
        assert (row.name, row.part, row.ends) == (name, "shield", causes.Ends.REARM)
    assert {s.name for s in causes.STOPS if s.part == "shield"} == set(REASONS[UNSEEN + 1 :])


def test_several_faults_are_several_rows():
    both = BOARD.format((Fault.LINK | Fault.STALL).name)
    assert {row.name for row in causes.matching_stops(both)} == {"LINK", "STALL"}
    assert "USB" in causes.advice_for(both)
    assert "wheel" in causes.advice_for(both)


@pytest.mark.parametrize(
    ("message", "ends"),
    [
        ("the laser is silent (unplugged)", causes.Ends.ITSELF),
        ("the second laser is silent", causes.Ends.ITSELF),
        ("the third laser is late: its scans may be 0.5 s old", causes.Ends.ITSELF),
        ("/scan is silent (its last message lacks 'ranges')", causes.Ends.ITSELF),
        ("/tf does not report where base_link is on map", causes.Ends.ITSELF),
        ("/clock has stood still for 2.1 s: the simulation is paused or over", causes.Ends.ITSELF),
        ("the drive board brings it to rest", causes.Ends.ITSELF),
        ("a person drives it by the joystick", causes.Ends.PERSON),
        ("ws://x: the link is lost: closed", causes.Ends.NEW_RUN),
        ("the drive board has stopped (NEW_FAULT); a person must re-arm it", causes.Ends.NEW_RUN),
        ("something that nobody has thought of", causes.Ends.ITSELF),
    ],
)
def test_what_the_parts_say_is_found(message, ends):
    (row,) = causes.matching_stops(message)
    assert row.ends is ends
    assert (row.name == "unknown") == message.startswith("something")


def test_it_goes_on_only_when_nothing_holds_it():
    stops, shield = causes.StopMonitor(), causes.shield_message("laser silent")
    assert stops.update(0.0, [""]) == []
    (line,) = stops.update(1.0, ["the laser is silent"])
    assert line.startswith("stands: the laser is silent; ")
    (line,) = stops.update(2.0, ["the laser is silent", shield])
    assert "needs a re-arm by a person" in line
    assert stops.update(3.0, ["the laser is silent (unplugged)", shield]) == []
    (line,) = stops.update(4.0, [shield])
    assert line.startswith("no longer: the laser is silent (unplugged); still stands: the shield")
    assert stops.waited == 3.0
    stops.update(5.0, [shield, "a person drives it by the joystick"])
    assert stops.waited == 0.0
    stops.update(8.0, [shield])
    assert stops.waited == 3.0
    assert stops.update(9.0, []) == ["goes on"]
    assert stops.waited == 0.0


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("the laser is silent", "the second laser is silent"),
        ("/scan is late: 0.3 s", "/odom is late: 0.3 s"),
        (BOARD.format("RESET"), BOARD.format("RESET|UNDER_VOLTAGE")),
        (BOARD.format("NEW_FAULT"), BOARD.format("OTHER_FAULT")),
    ],
)
def test_reasons_of_one_row_are_told_apart(first, second):
    stops = causes.StopMonitor()
    assert len(stops.update(0.0, [first])) == 1
    assert stops.update(1.0, [first + " (0.4 s)"]) == []
    assert stops.update(2.0, [first, second])[0].startswith(f"stands: {second}; ")
    assert stops.why == f"{first}; {second}"
    assert stops.update(3.0, [second]) == [f"no longer: {first}; still stands: {second}"]
