"""The session of the page Compare: two drives of one episode, or two recordings, side by side."""

from __future__ import annotations

import os
from contextlib import suppress
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

from agents.evaluation.compare import RESULTS
from agents.evaluation.evaluate import drive_episode, env_settings, label, make_env, without_labels
from agents.people import ASSISTANTS, is_shielded
from agents.policies import make_policy
from agents.studio.catalogue import Place
from agents.studio.drive import Track, recorded_track
from agents.studio.messages import Message, Outbox, PageSession, entry, fields_of, one_of
from wheelchair_gym.base.files import read_json
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.people.drivers import DRIVERS

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
        """Read the results of a run folder.

        Raises:
            InputError: there is no such folder, or its file is broken.
        """
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
