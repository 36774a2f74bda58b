"""Recorded drives of a person: judged again with another assistant, and what is fitted to them."""

import dataclasses
import json

import numpy as np
import pytest

from agents.cli import main
from agents.evaluation.evaluate import drive_episode
from agents.people.fit_driver import fit_driver
from agents.people.recorded_stick import StickSession, open_loop, prompt_text, schedule, session_of
from agents.policies import make_policy
from tests.conftest import at_start, json_of, output_of, refusal
from wheelchair_gym import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.people.drivers import make_driver
from wheelchair_gym.people.drivers.settings import (
    Driver,
    Hand,
    Perception,
    ProportionalStick,
    Switches,
)
from wheelchair_gym.people.drivers.state import DRIVER, constants_of
from wheelchair_gym.people.drivers.step import begin_signal, give_signal
from wheelchair_gym.recording.record import RecordEpisodes
from wheelchair_gym.recording.replay import read_recording
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Stick

RATE = 50.0
# How near each setting comes to the true one, for tremors up to 0.2, in sessions of 75 s.
WITHIN = {
    "delay": 0.03, "hand.lag": 0.03, "hand.return_lag": 0.03, "hand.forward": 0.05,
    "hand.backward": 0.05, "hand.leftward": 0.05, "hand.rightward": 0.05, "hand.rotation": 0.03,
    "hand.offset_forward": 0.02, "hand.offset_left": 0.03, "hand.tremor": 0.02,
    "hand.tremor_frequency": 0.2, "hand.tremor_band": 0.35, "interface.dead_zone": 0.002,
}  # fmt: skip
PEOPLE = {
    "steady": Driver(),
    "trembling and weak": Driver(
        hand=Hand(
            tremor=0.15, leftward=0.5, forward=0.7, rotation=0.2, offset_left=0.05, lag=0.15,
            return_lag=0.25,
        )
    ),
    "slow, another stick": Driver(
        hand=Hand(tremor=0.06, tremor_frequency=8.0, tremor_band=2.0, offset_forward=-0.06),
        perception=Perception(reaction=0.5), interface=ProportionalStick(dead_zone=0.16),
    ),
}  # fmt: skip


class Prompted:
    """The stick of a driver that does what prompts ask for, one control period a call.

    Hand and interface are as they drive, without intention.
    """

    def __init__(self, driver, rate=50.0, seed=0):
        switches = driver.interface.kind == "switches"
        directions = driver.interface.directions if switches else 8
        sizes = (1.0,) * 4 if switches else (1.0, 0.5)
        self.prompts = np.array(schedule(seed, sizes, directions))
        self._records = constants_of(driver, ChairSettings(), SensorSettings(), 1.0 / rate)
        self._state = np.zeros(1, DRIVER)
        device = driver.interface
        asked = self.prompts[:, 1:] * getattr(device, "gain", 1.0)
        if device.kind == "stick":  # which signals it has follows from the prompts
            self._records["signals"][0][: len(asked)] = asked
            self._signals, late = np.arange(len(asked)), driver.perception.reaction + device.delay
        else:
            known = self._records["signals"][0][: self._records["n_signals"][0]]
            want = np.where(np.abs(asked) > 0.1, np.sign(asked), 0.0)
            self._signals = np.array(
                [np.flatnonzero((np.sign(known) == one).all(axis=1))[0] for one in want]
            )
            late = driver.perception.reaction
        self._times = self.prompts[:, 0] + late
        self.period, self._k = 1.0 / rate, 0
        begin_signal(self._state[0], np.uint64(seed + 1))

    def __call__(self):
        row = np.searchsorted(self._times, self._k * self.period + 1e-9, "right") - 1
        self._k += 1
        self._state[0]["intended"] = self._signals[row] if row >= 0 else 0
        give_signal(self._records[0], self._state[0], 0.0, False)
        forward, left = self._state[0]["stick"].tolist()
        return Stick(forward, left, bool(self._state[0]["latched"]))


def session(driver, seed=0, rate=RATE):
    person = Prompted(driver, rate, seed)
    n = round((person.prompts[-1, 0] + 2.0) * rate)
    sticks = [person() for _ in range(n)]
    return StickSession(
        1.0 / rate, np.array([(0.0, 0.0), *(one[:2] for one in sticks)]),
        any(one.latched for one in sticks), np.zeros(n + 1, np.bool_), person.prompts,
        driver.interface.kind, 1.0,
    )  # fmt: skip


def true_of(driver, name):
    if name == "delay":
        return driver.perception.reaction + driver.interface.delay
    part, _, key = name.partition(".")
    return getattr(getattr(driver, part), key)


@pytest.mark.parametrize("name", PEOPLE)
def test_a_prompted_session_tells_hand_and_stick(name):
    driver = PEOPLE[name]
    fit = fit_driver([session(driver)], Driver(), repeats=8)
    trembles = driver.hand.tremor > 0.0
    for key, within in WITHIN.items():
        if not trembles and "tremor" in key:
            continue
        one = fit.estimates[key]
        assert one.value == pytest.approx(true_of(driver, key), abs=within), key
        assert one.low <= one.value <= one.high
    assert (
        fit.estimates["hand.tremor"].value > 0.0 if trembles else not fit.driver["hand"]["tremor"]
    )
    assert ("hand.tremor_frequency" in fit.unidentified) == (not trembles)
    again = make_driver(fit.driver)
    assert again.hand.leftward == fit.estimates["hand.leftward"].value
    late = again.perception.reaction + again.interface.delay
    assert late == pytest.approx(fit.estimates["delay"].value)


@pytest.mark.parametrize("name", ["sip_and_puff", "head_array"])
def test_a_prompted_session_tells_delay_and_errors_of_switches(name):
    """Errors: within 3.3 standard deviations of a share, of 224 and more answers."""
    driver = make_driver({"name": name, "interface": {"error": 0.2}})
    sessions = [session(driver, seed) for seed in range(7)]
    fit = fit_driver(sessions, Driver(interface=Switches()), repeats=50)
    assert fit.estimates["delay"].value == pytest.approx(true_of(driver, "delay"), abs=0.02)
    for key in ("interface.speed", "interface.turn"):
        assert fit.estimates[key].value == true_of(driver, key)
    error = fit.estimates["interface.error"]
    assert error.value == pytest.approx(0.2, abs=0.09)
    assert error.low < 0.2 < error.high
    assert fit.driver["interface"]["latched"] == driver.interface.latched
    assert fit.figures["changes_per_minute"] > 20.0


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Recorded drives of somebody who trembles, and a prompted session, as files."""
    folder = tmp_path_factory.mktemp("drives")
    env = NavigationEnv("clutter", rate=RATE, driver="essential_tremor", shield=True, split="test")
    env = RecordEpisodes(env, folder / "drive.mcap")
    for seed in range(3):
        drive_episode(env, make_policy({"name": "assisted", "assist": "direct"}), seed)
    env.close()
    person = Prompted(PEOPLE["trembling and weak"])
    env = NavigationEnv("empty", rate=RATE, person=person, split="test")
    env.labels = {"interface": "board", "prompts": person.prompts.tolist(), "share": 1.0}
    env = at_start(RecordEpisodes(env, folder / "session.mcap"))
    for _ in range(round((person.prompts[-1, 0] + 2.0) * RATE)):
        if env.step(np.zeros(2))[3]:
            break
    env.close()
    return folder


@pytest.mark.long
def test_drives_tell_the_tremor_and_the_dead_zone_and_the_rest_is_named(drives, tmp_path, capsys):
    file = tmp_path / "fit.json"
    log = drives / "drive.mcap"
    said = output_of(["fit-driver", log, "--repeats", "8", "--json", file], capsys)
    assert "hand.leftward            not fitted: a drive does not show" in said
    found = json.loads(file.read_text())
    hand = found["fitted"]["hand"]
    assert hand["tremor"] == pytest.approx(0.15, abs=0.02)
    assert hand["tremor_frequency"] == pytest.approx(6.0, abs=0.2)
    assert hand["tremor_band"] == pytest.approx(1.0, abs=0.4)
    assert found["fitted"]["interface"]["dead_zone"] == pytest.approx(0.1, abs=0.002)
    words = ["simulate", "--scene", "empty", "--seed", "1", "--driver", f"{file}:fitted"]
    assert main(words) == 0


def test_a_recorded_prompted_session_is_fitted(drives, capsys):
    words = ["fit-driver", drives / "session.mcap", "--repeats", "4"]
    hand = json_of(words, capsys)["fitted"]["hand"]
    assert hand["leftward"] == pytest.approx(0.5, abs=0.05)
    assert hand["rotation"] == pytest.approx(0.2, abs=0.03)


def test_what_a_recording_cannot_tell_is_said(drives):
    broken = read_recording(drives / "session.mcap")[0]._replace(labels={"prompts": ["soon"]})
    slow = session(PEOPLE["trembling and weak"], rate=10.0)
    fit = fit_driver([slow._replace(prompts=np.empty((0, 3)))], Driver(), repeats=2)
    assert "10 Hz" in fit.unidentified["hand.tremor"]
    short = session(Driver())
    short = short._replace(sticks=short.sticks[:300], near_goal=short.near_goal[:300])
    fit = fit_driver([short._replace(prompts=np.empty((0, 3)))], Driver(), repeats=2)
    assert "stretches" in fit.unidentified["hand.tremor"]
    other = session(make_driver("head_array"))
    with pytest.raises(InputError, match="one interface"):
        fit_driver([short, other], Driver())
    with pytest.raises(InputError, match="interface scanning"):
        fit_driver([short._replace(interface="scanning")], Driver())
    with pytest.raises(InputError, match="malformed"):
        session_of(broken)
    # A stick without steps leaves no grid.
    smooth = dataclasses.replace(Driver(), interface=ProportionalStick(levels=1e6))
    fit = fit_driver([session(smooth)._replace(prompts=np.empty((0, 3)))], Driver(), repeats=2)
    assert "steps" in fit.unidentified["interface.dead_zone"]


def test_prompts_ask_for_every_direction_and_for_the_centre_between():
    rows = np.array(schedule(3))
    assert (np.diff(rows[:, 0]) > 0.0).all()
    assert not rows[::2, 1:].any()
    assert len({tuple(np.round(row, 6)) for row in rows[1::2, 1:]}) == 16
    assert prompt_text(0.5, 0.0) == "push by half forward"
    assert prompt_text(-0.71, -0.71) == "push fully backward and right"
    assert prompt_text(0.0, 0.0) == "let go: centre"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("drives") / "drive.mcap"
    drive = ["simulate", "--scene", "clutter", "--seed", "4", "--driver", "weak_left"]
    assert main([*drive, "--assist", "vfh", "--record", str(file)]) == 0
    return file


@pytest.fixture(scope="module")
def episode(recorded):
    (episode,) = read_recording(recorded)
    return episode


def test_stick_interface_and_assistant_are_in_the_recording(episode):
    assert episode.has_person
    assert episode.labels == {"assistant": "vfh", "interface": "stick"}
    assert episode.seed == 4
    assert episode.settings.driver["hand"]["leftward"] == 0.4
    sticks = [state.reading.stick for state in episode.states]
    assert sticks[0] == Stick(0.0, 0.0, False)
    assert max(stick.forward for stick in sticks) > 0.3


def test_the_same_assistant_answers_the_same_to_the_bit(recorded, episode, capsys):
    figures = open_loop(episode, "vfh")
    assert figures["same_answers"]
    assert (figures["difference_share"], figures["difference_size"]) == (0.0, 0.0)
    assert figures["recorded"] == figures["other"]
    said = output_of(["replay", recorded, "--assist", "vfh"], capsys)
    assert "the same rewards" in said
    assert "the same, to the bit" in said


def test_another_assistant_answers_beside_the_recorded_one(episode, recorded, capsys):
    (record,) = json_of(["replay", recorded, "--assist", "slide"], capsys)
    assert record["same"]
    assert not record["same_answers"]
    assert 0.0 < record["difference_share"] < 1.0
    start, end = record["longest"]
    assert 0.0 <= start < end <= episode.states[-1].reading.stamp + 1e-9
    # The bare stick changes nothing; it differs from the recording as much as that did from it.
    bare = open_loop(episode, "direct")
    assert bare["other"]["intervention_share"] == 0.0 < bare["difference_share"]
    assert bare["difference_share"] == bare["recorded"]["intervention_share"]


def test_what_is_missing_is_said_in_a_line(tmp_path, capsys):
    file = tmp_path / "drive.mcap"
    words = ["simulate", "--scene", "empty", "--policy", "straight", "--record", str(file)]
    output_of(words, capsys)
    for command in (["fit-driver", file], ["replay", file, "--assist", "vfh"]):
        assert "a person drives" in refusal(command, capsys)
