"""The plan of an experiment with participants, as settings, and each participant's order."""

from collections.abc import Iterator
from typing import Any, Literal, NamedTuple

import numpy as np

from agents.evaluation.evaluate import without_labels
from agents.people import make_assistant
from agents.studio import page_texts
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.people.drivers.settings import Hand, Perception
from wheelchair_gym.scenes import make_scene

_OWN = "the experimenter's choice"
Device = Literal["keyboard", "gamepad", "touch", "switch"]
MOST_ANSWERS = 100  # as in `values` of a message of the page (messages.yaml)
DEVICES: tuple[Device, ...] = ("keyboard", "gamepad", "touch", "switch")
MIN_SCAN = 0.3  # s for which a command must be lit, so that a person can press
_GROUPS, _CONDITIONS, _TASKS, _WORLDS = range(4)  # what is drawn by the seed of a protocol
_ATTEMPTS = 1000  # at one drive, each with a world of its own
_HIDDEN = ("left", "right", "neglect", "noticed")  # of a perception


@settings
class Task:
    """A drive that every participant makes in every condition."""

    name: str
    """Name of the task; part of the names of recordings."""
    scene: Any = setting(default="floor_plan", source=_OWN)
    """A scene: its name, or a mapping with its settings."""
    seed: int | None = setting(default=None, low=0, source=_OWN)
    """Seed of one world for every condition; null: another world in each condition and attempt."""
    text: str = setting(default="", source=_OWN)
    """Instruction that the participant reads."""


@settings
class Condition:
    """One of the compared conditions: the help that a participant has."""

    name: str
    """Name in tables."""
    assist: Any = setting(default="shield", source=_OWN)
    """An assistant: its name, or a mapping with its settings."""
    hand: Hand = setting(default=Hand(), source=_OWN)
    """An impairment that is simulated at the stick: settings of a driver's hand."""
    perception: Perception = setting(default=Perception(), source=_OWN)
    """Parts of the scene hidden from the participant: `left`, `right`, `neglect` and `noticed` of a
    driver's perception."""
    text: str = setting(default="", source=_OWN)
    """Text about the condition that the participant reads."""

    def __post_init__(self) -> None:
        """Refuse what nobody can hide: reactions, attention and habits are the participant's."""
        for name, value in vars(self.perception).items():
            if name not in _HIDDEN and value != getattr(Perception(), name):
                raise InputError(
                    f"perception.{name} is the participant's own; expected {', '.join(_HIDDEN)}"
                )


@settings
class Group:
    """A group of participants, who drive in some of the conditions."""

    name: str
    """Name in tables."""
    conditions: tuple[str, ...]
    """Names of the conditions that the participants of this group have."""


@settings
class Questionnaire:
    """Statements that a participant rates on one scale (Likert)."""

    name: str
    """Name in tables."""
    statements: tuple[str, ...]
    """Statements to rate, in order."""
    points: int = setting(default=7, low=2, high=11, source="common for a Likert scale")
    """Steps of the scale; the answers are 1 to `points`."""
    low: str = setting(default="strongly disagree", source="common for a Likert scale")
    """Meaning of 1."""
    high: str = setting(default="strongly agree", source="common for a Likert scale")
    """Meaning of the last step."""
    after: Literal["condition", "experiment"] = "condition"
    """Whether it is asked after every condition, or once at the end."""


class Item(NamedTuple):
    """A question: its name, text, the ends of its scale, and the numbers that it may have."""

    name: str
    text: str
    low: str
    high: str
    values: range


NASA_TLX = "nasa_tlx"
_TLX = ("mental", "physical", "temporal", "performance", "effort", "frustration")
_TLX_VALUES = range(0, 101, 5)


class Step(NamedTuple):
    """One thing that a participant does; the key is unique in a session."""

    key: str
    kind: Literal["consent", "drive", "answers"]
    condition: str = ""
    position: int = 0  # of the condition in the participant's order, from 1; practice is in it
    task: str = ""
    practice: bool = False
    questionnaire: str = ""


def williams(n: int) -> list[list[int]]:
    """Return the rows of a Latin square in which each number follows each other equally often.

    It has n rows for an even n and 2 n for an odd one (Williams 1949).
    """
    # 0, 1, n - 1, 2, n - 2, ...: neighbours differ by every number once.
    zigzag = [(k + 1) // 2 if k % 2 else (n - k // 2) % n for k in range(n)]
    rows = [[(place + row) % n for place in zigzag] for row in range(n)]
    return rows if n % 2 == 0 else rows + [row[::-1] for row in rows]


@settings
class Protocol:
    """An experiment within subjects, also between groups of them.

    NASA-TLX is the raw version, without weighing (Hart 2006, NASA-TLX 20 years later). Balanced
    orders are rows of a Latin square (Williams 1949), which `seed` shuffles: complete after n
    participants of a group for an even number n of conditions, and after 2 n for an odd one.
    """

    title: str
    """Title of the experiment."""
    consent: str
    """Text that a participant agrees to before anything else."""
    conditions: tuple[Condition, ...]
    """Conditions that are compared."""
    tasks: tuple[Task, ...]
    """Drives that every participant makes in every condition."""
    practice: tuple[Task, ...] = ()
    """Drives before the tasks of each condition, which are not evaluated."""
    practice_until: Literal["driven", "arrived"] = "driven"
    """Criterion of a practice drive: driven to its end, or arrived without contact."""
    practice_tries: int = setting(default=3, low=1, high=100, source=_OWN)
    """Max. number of attempts at a practice drive whose criterion is not met."""
    tries: int = setting(default=1, low=1, high=100, source=_OWN)
    """Max. number of attempts at a task that the participant ends before its goal."""
    max_contacts: int = setting(default=0, low=0, source=_OWN)
    """Number of drives ended by a contact after which the session is stopped; 0: never."""
    max_minutes: float = setting(default=0.0, unit="min", low=0.0, source=_OWN)
    """Driving time of all attempts after which the session is stopped; 0: never."""
    seed: int = setting(default=0, low=0, source=_OWN)
    """Seed of the orders and worlds of all participants."""
    order: Literal["balanced", "listed"] = "balanced"
    """Order of conditions: balanced over participants, or as listed for everybody."""
    task_order: Literal["balanced", "listed"] = "balanced"
    """Order of the tasks in each condition: balanced over participants, or as listed."""
    groups: tuple[Group, ...] = ()
    """Groups of participants; none: every participant has all conditions."""
    blind: bool = True
    """Whether the page hides condition texts, and readings and arrows of shield and help."""
    language: str = setting(default="en", source=_OWN)
    """Language of the page for every participant: one that the page has texts in."""
    nasa_tlx: bool = True
    """Whether the NASA-TLX is asked after each condition."""
    questionnaires: tuple[Questionnaire, ...] = ()
    """Further questionnaires."""
    devices: tuple[Device, ...] = setting(default=DEVICES, source=_OWN)
    """Input devices that a participant may use. With more than one, the device is chosen before
    each drive; in a drive it stays."""
    scan_period: float = setting(default=0.0, unit="s", low=0.0, high=10.0, source=_OWN)
    """Time for which a single switch lights each command, min 0.3; 0: chosen before each drive."""

    def __post_init__(self) -> None:
        """Refuse what is empty, and names that are not distinct."""
        for key in ("title", "consent"):
            if not getattr(self, key).strip():
                raise InputError(f"Protocol.{key} is empty; expected text")
        if self.language not in (known := page_texts()):
            wrong = shorten(self.language)
            raise InputError(f"Protocol.language is {wrong}; expected one of {', '.join(known)}")
        kinds: dict[str, tuple[Any, ...]] = {
            "conditions": self.conditions, "tasks": self.practice + self.tasks,
            "questionnaires": self.questionnaires, "groups": self.groups,
        }  # fmt: skip
        used = {NASA_TLX, "consent", "drive"}  # names in the keys of steps, and of sources
        for key, entries in kinds.items():
            names = [entry.name for entry in entries]
            for name in names:
                if names.count(name) > 1 or name in used:
                    raise InputError(f"{key}: the name {shorten(name)} is taken; expected another")
                if not name.strip() or "/" in name or ": " in name:
                    wrong = "expected no slash and no ': ' in it"
                    raise InputError(f"{key}: the name is {shorten(name)}; {wrong}")
            used |= set(names) if key == "tasks" else set()
        if not self.devices or len(set(self.devices)) < len(self.devices):
            raise InputError(f"Protocol.devices: expected some of {', '.join(DEVICES)}, each once")
        if 0.0 < self.scan_period < MIN_SCAN:
            raise InputError(f"Protocol.scan_period is {self.scan_period:g}; expected 0 or >= 0.3")
        if not self.conditions or not self.tasks:
            raise InputError("Protocol: expected at least one condition and one task")
        for asked in self.questionnaires:
            if not 0 < len(set(asked.statements)) == len(asked.statements) <= MOST_ANSWERS:
                wrong = f"expected 1 to {MOST_ANSWERS} different statements"
                raise InputError(f"questionnaire {asked.name}: {wrong}")
        conditions = [condition.name for condition in self.conditions]
        for group in self.groups:
            named = group.conditions
            if not named or len(set(named)) < len(named) or not set(named) <= set(conditions):
                raise InputError(f"group {group.name}: expected some of {', '.join(conditions)}")
        # Not only when a participant comes to them.
        for condition in self.conditions:
            make_assistant(condition.assist)
        for task in (*self.practice, *self.tasks):
            make_scene(without_labels(task.scene))

    def group_of(self, participant: int) -> Group:
        """Return the group of a participant (a number from 1); without groups, one of all."""
        if not self.groups:
            return Group("", tuple(condition.name for condition in self.conditions))
        block, k = divmod(participant - 1, len(self.groups))
        shuffled = np.random.default_rng([self.seed, _GROUPS, block]).permutation(len(self.groups))
        return self.groups[int(shuffled[k])]

    def _row(self, participant: int, n: int, *of: int) -> list[int]:
        """Return a balanced order of n things: each block of participants has a whole square."""
        return williams(n)[self._drawn(participant, len(williams(n)), *of)[1]]

    def _drawn(self, participant: int, n: int, *of: int) -> tuple[int, int]:
        """Return a participant's block, and which of n rows it has: a block has each once."""
        block, k = divmod((participant - 1) // max(1, len(self.groups)), n)
        return block, int(np.random.default_rng([self.seed, *of, block]).permutation(n)[k])

    def conditions_of(self, participant: int) -> tuple[Condition, ...]:
        """Return the conditions in the order of a participant (a number from 1)."""
        names = self.group_of(participant).conditions
        mine = [one for one in self.conditions if one.name in names]
        row = self._row(participant, len(mine), _CONDITIONS)
        return tuple(mine) if self.order == "listed" else tuple(mine[k] for k in row)

    def steps(self, participant: int) -> Iterator[Step]:
        """Yield everything that a participant (a number from 1) does, in order."""
        yield Step("consent", "consent")
        for position, condition in enumerate(self.conditions_of(participant), 1):
            name = condition.name
            row = self._row(participant, len(self.tasks), _TASKS, position)
            listed = self.task_order == "listed"
            ordered = self.tasks if listed else tuple(self.tasks[k] for k in row)
            for practice, tasks in ((True, self.practice), (False, ordered)):
                for task in tasks:
                    key = f"{name}/{task.name}"
                    yield Step(key, "drive", name, position, task.name, practice)
            for asked in self._asked("condition"):
                yield Step(f"{name}/{asked}", "answers", name, position, questionnaire=asked)
        for asked in self._asked("experiment"):
            yield Step(asked, "answers", questionnaire=asked)

    def world(self, participant: int, step: Step, attempt: int) -> int:
        """Return the seed of the world of a drive; `attempt` counts from 1.

        Without a seed of its task, a participant drives in no world twice. The worlds of a task are
        the same for all participants; each is met at each place, and in each condition, as often.
        """
        tasks = (*self.practice, *self.tasks)
        number = [task.name for task in tasks].index(step.task)
        seed = tasks[number].seed
        if seed is not None:
            return seed
        rows = williams(n := len(self.conditions_of(participant)))
        block, row = self._drawn(participant, len(rows), _CONDITIONS)
        place = (rows[row][step.position - 1] + (block * len(rows) + row) // n + number) % n
        first = int(np.random.default_rng([self.seed, _WORLDS]).integers(2**30))
        return first + _ATTEMPTS * (number * len(self.conditions) + place) + attempt - 1

    def _asked(self, after: str) -> list[str]:
        first = [NASA_TLX] if self.nasa_tlx and after == "condition" else []
        return first + [one.name for one in self.questionnaires if one.after == after]

    def items(self, questionnaire: str) -> tuple[Item, ...]:
        """Return the questions of a questionnaire; those of the NASA-TLX are keys of page texts."""
        if questionnaire == NASA_TLX:
            ends = {"performance": ("tlx_perfect", "tlx_failure")}
            return tuple(
                Item(name, f"tlx_{name}", *ends.get(name, ("tlx_low", "tlx_high")), _TLX_VALUES)
                for name in _TLX
            )
        (asked,) = (one for one in self.questionnaires if one.name == questionnaire)
        values = range(1, asked.points + 1)
        return tuple(
            Item(f"{number}", text, asked.low, asked.high, values)
            for number, text in enumerate(asked.statements, 1)
        )
