"""The sessions of the pages Drive and Compare.

Drive: a thread owns the environment and steps it in real time. Whatever happens, the chair stops: a
stick or a switch that is not confirmed for a moment counts as released; a page that is closed ends
the drive once the chair stands. Compare: two drives of one episode, or two recordings, in parallel.
"""

import dataclasses
import logging
import os
import threading
import time
from contextlib import suppress
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

from agents.evaluation.compare import RESULTS
from agents.evaluation.evaluate import drive_episode, env_settings, label, make_env, without_labels
from agents.people import ASSISTANTS, is_shielded
from agents.policies import make_policy
from agents.studio import PageError
from agents.studio.catalogue import NO_HAND, NO_SIGHT, Place
from agents.studio.drive import Drive, Order, Track, film, recorded_track
from agents.studio.messages import IDLE, Message, Outbox, PageSession, entry, fields_of, one_of
from wheelchair_gym.base.files import read_json
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.people.drivers import DRIVERS
from wheelchair_gym.people.drivers.live_person import IMPAIRMENTS, SIGHTS

_LOG = logging.getLogger(__name__)
DEAD_MAN: Final = 0.4  # s for which a deflection or a switch counts; the page confirms it sooner
_LATE: Final = 0.25  # s: a drive that is later gives up catching up with real time


class DriveSession(PageSession):
    """Serves the page Drive.

    Args:
        places: what may be driven, by key.
        folder: where recordings and films go.
        outbox: of the page.
        ready: set once a first drive is compiled.
    """

    fields = fields_of(
        "drive", assist=ASSISTANTS, hand=(NO_HAND, *IMPAIRMENTS), sight=(NO_SIGHT, *SIGHTS)
    )

    def __init__(
        self, places: dict[str, Place], folder: Path, outbox: Outbox, ready: threading.Event
    ) -> None:
        self._places, self._folder, self._ready = places, folder, ready
        # Deflections, what moves the stick, and when they came [s].
        self._stick = 0.0, 0.0, "", -1.0
        self._drive: Drive | None = None
        self._recorded: Path | None = None
        self._paused, self._scan_period = False, 0.0
        super().__init__(outbox)

    def receive(self, message: Message) -> None:
        """See `PageSession.receive`; only the latest deflection counts."""
        if message["type"] == "stick":
            self._stick = message["forward"], message["left"], message["by"], time.monotonic()
            return
        super().receive(message)

    def _run(self) -> None:
        due = time.monotonic()
        try:
            while not self._closing.is_set():
                if not self._drives:
                    due = time.monotonic()
                self._handle(max(0.0, due - time.monotonic()) if self._drives else IDLE)
                now = time.monotonic()
                if self._drives and self._drive is not None and now >= due:
                    late = now - due > _LATE
                    due = (now if late else due) + 1.0 / self._drive.order.rate
                    self._step(self._drive)
        finally:
            self._end()

    @property
    def _drives(self) -> bool:
        return self._drive is not None and not self._paused

    def _step(self, drive: Drive) -> None:
        forward, left, by, at = self._stick
        if time.monotonic() - at > DEAD_MAN:
            forward, left, by = 0.0, 0.0, ""
            drive.release_switch()
        try:
            drive.step(forward, left, by)
        except Exception as error:  # an assistant of somebody's, a full disk: the chair stops
            _LOG.exception("studio: the drive failed")
            text = f"{type(error).__name__}: {error}"
            self._out.refuse(PageError("drive_failed", text=text))
            self._end()
            if not drive.steps:
                self._unbegun()
            return
        self._out.show(*drive.picture())
        if drive.over:
            self._end()

    def on_start(self, message: Message) -> None:
        """Begin a drive."""
        place = entry(self._places, message["place"], "start.place")
        self._end()
        order = Order(
            message["place"], place, message["seed"], message["assist"], message["hand"],
            message["rate"], sight=message["sight"],
        )  # fmt: skip
        self._begin_when_ready(order)

    def _begin_when_ready(self, order: Order) -> None:
        self._out.send("busy")
        while not self._ready.wait(IDLE):
            if self._closing.is_set():
                return
        self._begin(order)

    def _begin(self, order: Order) -> None:
        self._drive = drive = self._make(order)
        self._paused = False
        self._stick = (0.0, 0.0, "", -1.0)
        self._out.send("world", **drive.world())
        self._out.show(*drive.picture())

    def _make(self, order: Order) -> Drive:
        return Drive(order, self._folder, self._scan_period)

    def on_press(self, message: Message) -> None:
        """Press the single switch."""
        if self._drive is not None:
            self._drive.press()

    def on_device(self, message: Message) -> None:
        """Take another device."""
        self._scan_period = message["scan_period"] if message["name"] == "switch" else 0.0
        if self._drive is not None:
            self._drive.set_device(self._scan_period)

    def on_assist(self, message: Message) -> None:
        """Take another assistant."""
        name, drive = message["name"], self._drive
        if drive is None or drive.over:
            return
        if is_shielded(name) == is_shielded(drive.order.assist):
            drive.set_assistant(name)
            self._out.send("assist", name=name, anew=False)
        else:  # the shield comes or goes: a judged drive has it from start to end, or not at all
            order = drive.order
            self._end()
            self._begin(dataclasses.replace(order, assist=name))
            self._out.send("assist", name=name, anew=True)

    def on_hand(self, message: Message) -> None:
        """Take another hand."""
        if self._drive is not None:
            self._drive.set_hand(message["name"])

    def on_sight(self, message: Message) -> None:
        """Take another sight."""
        if self._drive is not None:
            self._drive.set_sight(message["name"])

    def on_pause(self, message: Message) -> None:
        """Pause or resume time."""
        self._paused = message["on"]
        self._out.send("paused", on=self._paused)

    def on_stop(self, message: Message) -> None:
        """End the drive."""
        drive = self._drive
        self._end()
        if drive is not None and not drive.steps:
            self._unbegun()

    def on_film(self, message: Message) -> None:
        """Make a film of the latest drive."""
        if self._drive is not None and not self._drive.over:
            raise InputError("film: end the drive first")
        if self._recorded is None:
            raise InputError("film: there is no recorded drive yet")
        self._out.send("filming")
        target = film(self._recorded, self._closing.is_set)
        self._out.send("film", file=target.name)

    def _end(self) -> None:
        """End the drive, if there is one: the chair stops, and its recording is complete."""
        drive, self._drive = self._drive, None
        if drive is None:
            return
        try:
            drive.close()
        except Exception as error:
            _LOG.exception("studio: the drive could not be ended")
            self._out.refuse(PageError("recording_cut", text=error))
        if drive.steps:
            self._recorded = drive.file
            self._out.send("ended", **drive.summary())
            self._after(drive)

    def _unbegun(self) -> None:
        """A drive has ended before its first step."""
        self._out.send("unbegun")

    def _after(self, drive: Drive) -> None:
        """A drive of at least one step has ended."""


NOBODY: Final = "nobody"  # drives: policies are compared
POLICIES: Final = (
    "lattice+window", "a_star+window", "a_star+pure_pursuit", "rrt_star_woa_local+window",
    "rrt_star_woa_global+controls", "se2_rrt_star_woa+whales", "ppo_guided", "ppo_goal",
    "td3_guided", "straight",
)  # fmt: skip
_MAX_FILES: Final = 300  # recordings and run folders that are listed
_MAX_SEEN: Final = 20_000  # files that are looked at for them
_SIDES: Final = ("left", "right")


class CompareSession(PageSession):
    """Serves the page Compare.

    Args:
        places: where may be driven, by key.
        folder: below which recordings and run folders of `compare` are found.
        outbox: of the page.
    """

    fields = fields_of("compare", side=_SIDES)

    def __init__(self, places: dict[str, Place], folder: Path, outbox: Outbox) -> None:
        self._places = places
        self._recordings, self._runs = _found(folder)
        outbox.send(
            "sources", drivers=[NOBODY, *sorted(DRIVERS.built_in)], policies=POLICIES,
            assistants=sorted(ASSISTANTS), recordings=list(self._recordings), runs=list(self._runs),
        )  # fmt: skip
        super().__init__(outbox)

    def on_pair(self, message: Message) -> None:
        """Run two policies, or a simulated person with two assistants."""
        place = entry(self._places, message["place"], "pair.place")
        driver = message["driver"]
        one_of((NOBODY, *DRIVERS.built_in)).check(driver, "pair.driver")
        known = POLICIES if driver == NOBODY else (*ASSISTANTS,)
        for side in _SIDES:
            one_of(known).check(message[side], f"pair.{side}")
        for side in _SIDES:
            name, env = message[side], {"shield": True, **place.env}
            policy: Any = name
            if driver != NOBODY:
                policy = {"name": "assisted", "assist": name}
                env |= {"driver": driver, "shield": is_shielded(name)}
            self._drive(side, name, policy, place.scene, env, message["seed"])

    def _drive(self, side: str, name: str, policy: Any, scene: Any, env: Any, seed: int) -> None:
        if self._closing.is_set():
            return
        self._out.send("driving", side=side, name=name)
        world, track = make_env(scene, env, None, policy), Track(self._closing.is_set)
        try:
            record = drive_episode(world, make_policy(without_labels(policy)), seed, track)
        finally:
            world.close()
        self._out.send("track", side=side, **track.content(name, record["outcome"]))

    def on_open(self, message: Message) -> None:
        """Show a recording on one side."""
        name = message["name"]
        path = entry(self._recordings, name, "open.name")
        self._out.send("driving", side=message["side"], name=name)
        found = recorded_track(path, message["episode"], name, self._closing.is_set)
        self._out.send("track", side=message["side"], **found)

    def on_choose(self, message: Message) -> None:
        """Say what a run of `compare` holds."""
        results = self._results(message["run"])
        episodes = {(str(one["scene"]), int(one["seed"])): None for one in results["records"]}
        self._out.send(
            "run", run=message["run"], policies=results["policies"], episodes=list(episodes),
            outcomes=[
                [one["policy"], one["scene"], one["seed"], one["outcome"]]
                for one in results["records"]
            ],
        )  # fmt: skip

    def on_run(self, message: Message) -> None:
        """Drive an episode of a run again, by two of its policies."""
        config = self._results(message["run"])["provenance"]["config"]
        known = {of: {label(one): one for one in config[of]} for of in ("scenes", "policies")}
        scene = entry(known["scenes"], message["scene"], "run.scene")
        for side in _SIDES:
            policy = entry(known["policies"], message[side], f"run.{side}")
            env = env_settings(**config["env"])
            self._drive(side, message[side], policy, scene, env, message["seed"])

    def _results(self, name: str) -> Any:
        """Read the results of a run folder; refuse an unknown folder, and a broken file."""
        results = read_json(entry(self._runs, name, "run"))
        try:
            itemgetter("policies", "scenes", "env")(results["provenance"]["config"])
            itemgetter("policies", "records")(results)
        except (KeyError, TypeError):
            raise InputError(f"{name}: expected results of `wheelchair compare`") from None
        return results


def _found(folder: Path) -> tuple[dict[str, Path], dict[str, Path]]:
    """Recordings, and results of runs, below a folder by their relative names, newest first.

    They are regular files, no links, and not too many.
    """
    files = (Path(parent) / name for parent, _, names in os.walk(folder) for name in names)
    found = []
    for path in islice(files, _MAX_SEEN):
        if path.suffix in (".mcap", ".json") and path.is_file() and not path.is_symlink():
            with suppress(OSError):  # it may be gone by now
                found.append((path.stat().st_mtime, path.relative_to(folder)))
    newest = [name for _, name in sorted(found, reverse=True)]
    recordings = [name for name in newest if name.suffix == ".mcap"][:_MAX_FILES]
    runs = [name for name in newest if name.name == RESULTS][:_MAX_FILES]
    return (
        {name.as_posix(): folder / name for name in recordings},
        {name.parent.as_posix(): folder / name for name in runs},
    )
