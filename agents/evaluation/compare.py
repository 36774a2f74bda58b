"""Comparisons: suites of policies and scenes, and all that is written about one.

The report has tables, the winners of each scene, and a page with the answer.
"""

import dataclasses
import io
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from PIL import Image

from agents import read_data
from agents.evaluation import assisted, metrics
from agents.evaluation.evaluate import (
    NO_WATCH,
    Spec,
    distinct,
    drive_episode,
    env_settings,
    evaluate,
    label,
    make_env,
    without_labels,
)
from agents.evaluation.metrics import EFFICIENCIES, SOCIAL_MEANS, Record, summarise
from agents.evaluation.plots import figures
from agents.evaluation.provenance import command_line, now, provenance, write_json, write_text
from agents.evaluation.statistics import mcnemar
from agents.evaluation.tables import Column, Table, data_uri, make_table, write_page
from agents.policies import kind_of, make_policy
from agents.policies.planned import PlannedDriver
from agents.studies.plan_pictures import SHORTENS, PlanPictures
from agents.watch import Watch
from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError, dump, suggest
from wheelchair_gym.rendering.picture import with_legend
from wheelchair_gym.rendering.video import video_suffix, write_video
from wheelchair_gym.scenes.arena import Doorway

Evaluation = Mapping[str, Any]  # the content of results.json

POLICY, SCENE = Column("policy", "policy", None), Column("scene", "scene", None)


def webp(path: Path) -> bytes:
    """A picture file as WebP: a top view takes a tenth of its PNG and looks the same."""
    out = io.BytesIO()
    with Image.open(path) as picture:
        picture.convert("RGB").save(out, "webp", quality=50, method=6)
    return out.getvalue()


_VALUES = vars(metrics) | vars(assisted)  # that names and meanings of columns quote
_ALL = tuple(
    Column(**row | {key: row[key].format(**_VALUES) for key in ("name", "meaning")})
    for row in read_data("columns.yaml")
)
COLUMN_OF = {column.key: column for column in _ALL}
_SOCIAL = tuple(column for column in _ALL if column.key in (*SOCIAL_MEANS, *EFFICIENCIES))
_ASSISTED = tuple(column for column in _ALL if column.key in assisted.MEASURES)
# Of every evaluation.
COLUMNS = tuple(column for column in _ALL if column not in (*_SOCIAL, *_ASSISTED))
SUCCESS = COLUMNS[1]
# The columns in parts that a screen shows whole.
_TIME = next(k for k, column in enumerate(COLUMNS) if column.key == "time")
PARTS = ((": arrivals", COLUMNS[:_TIME]), (": how it drove", COLUMNS[_TIME:]))
LEVEL = 0.05  # of a test
FEWEST = 6  # pairs: with fewer, the paired test cannot be significant at that level
RANKING_NOTE = (
    "Success. Bold: the most on that scene, or not significantly less in these episodes "
    f"(McNemar's exact paired test, {LEVEL:g}, each pair by itself)."
)
# Bytes that are embedded; larger files are linked, so that the page stays quick to open.
_LARGEST_VIDEO = 3e6
_MAX_PICTURES = 3e6  # about 500 failures


def ranked(summary: Sequence[Record], scene: str = "all") -> list[Record]:
    """The rows of a scene: by contacts, then by success, then by SPL."""
    rows = [row for row in summary if row["scene"] == scene]
    return sorted(
        rows,
        key=lambda row: (row["collision"] or 0.0, -(row["success"] or 0.0), -(row["spl"] or 0.0)),
    )


def best_of(rows: Sequence[Record]) -> Record | None:
    """The first of ranked rows where intervals tell it from all others; None where they do not.

    It has fewer contacts than another, or more successes where the intervals of contacts overlap.
    """

    def is_ahead(row: Record, other: Record) -> bool:
        fewer = bool(row["collision_high"] < other["collision_low"])
        level = row["collision_low"] <= other["collision_high"]
        return fewer or bool(level and row["success_low"] > other["success_high"])

    return rows[0] if rows and all(is_ahead(rows[0], other) for other in rows[1:]) else None


def heads(evaluation: Evaluation) -> tuple[Column, Column]:
    """Columns of what is compared and where: of assistants and drivers, where a person drives."""
    if any("authority" in row for row in evaluation["summary"]):
        return POLICY._replace(name="assistant"), SCENE._replace(name="scene, driver")
    return POLICY, SCENE


def level_with(successes: Mapping[int, bool], others: Mapping[int, bool]) -> bool:
    """Whether two policies' successes by seed do not differ significantly, on common seeds."""
    both = successes.keys() & others.keys()
    *_, p = mcnemar([successes[seed] for seed in both], [others[seed] for seed in both])
    return p >= LEVEL


def winners(evaluation: Evaluation) -> dict[str, list[str]]:
    """Scene -> the policies with most successes, or not significantly less; none without any."""
    found = {}
    for scene in evaluation["scenes"]:
        rows = ranked(evaluation["summary"], scene)
        rows.sort(key=lambda row: -(row["success"] or 0.0))
        of: dict[str, dict[int, bool]] = {row["policy"]: {} for row in rows}
        for record in evaluation["records"]:
            if record["scene"] == scene:
                of[record["policy"]][record["seed"]] = record["success"]
        best = next(iter(of.values()), {})
        found[scene] = [name for name in of if any(best.values()) and level_with(best, of[name])]
    return found


def ranking_table(evaluation: Evaluation) -> Table | None:
    """Success of each policy on each scene, winners in bold.

    None for a single policy or scene, and where episodes are too few to rank by.
    """
    several = len(evaluation["policies"]) > 1 and len(evaluation["scenes"]) > 1
    if not several or len({record["seed"] for record in evaluation["records"]}) < FEWEST:
        return None
    rows = {(row["policy"], row["scene"]): row for row in evaluation["summary"]}
    winning = winners(evaluation)
    body = []
    for best in ranked(evaluation["summary"]):
        policy, cells = best["policy"], [POLICY.cell(best)]
        for scene, names in winning.items():
            cells.append(SUCCESS.cell(rows[policy, scene])._replace(bold=policy in names))
        body.append(cells)
    columns = [SUCCESS._replace(name=scene, unit="%", meaning="success") for scene in winning]
    return Table("Who wins where", [heads(evaluation)[0], *columns], [body], RANKING_NOTE)


def who_wins_where(evaluation: Evaluation) -> str:
    """One sentence: the best of each scene, and the successes of each kind of policy.

    Empty for a single policy.
    """
    records, kinds = evaluation["records"], evaluation.get("kinds", {})  # older results have none
    if len(evaluation["policies"]) < 2 or not records:
        return ""

    def hits(policies: Sequence[str]) -> str:
        of = [record for record in records if record["policy"] in policies]
        return f"{sum(record['success'] for record in of)} of {len(of)}"

    bests = {scene: best_of(ranked(evaluation["summary"], scene)) for scene in evaluation["scenes"]}
    parts = [
        f"{best['policy']} on {scene} ({COLUMN_OF['collision'].text(best['collision'])} % "
        f"contacts, {SUCCESS.text(best['success'])} % success)"
        for scene, best in bests.items() if best is not None
    ]  # fmt: skip
    if missing := [scene for scene, best in bests.items() if best is None]:
        parts.append(f"none on {' or '.join(missing)}, where 95 % intervals overlap")
    for kind in ("planned", "learned"):
        if names := [name for name in evaluation["policies"] if kinds.get(name) == kind]:
            parts.append(f"all {kind} policies {hits(names)}")
    return f"Best {heads(evaluation)[0].name} by contacts, then by success: {', '.join(parts)}."


def _more_columns(summary: Sequence[Record]) -> dict[str, tuple[Column, ...]]:
    """The columns that only some episodes have, by what they are about: people, a driver."""
    groups = {": among people": _SOCIAL, ": with a person at the stick": _ASSISTED}
    return {
        name: columns
        for name, columns in groups.items()
        if any(columns[0].key in row for row in summary)
    }


# Columns of the table in a terminal, after policy and scene.
BRIEF = ("episodes", "success", "collision", "at_fault", "spl", "time")


def markdown(evaluation: Evaluation) -> str:
    """The summary as Markdown, under the command, and who wins where."""
    summary, table = evaluation["summary"], ranking_table(evaluation)
    rows = [*ranked(summary), *(row for row in summary if row["scene"] != "all")]
    more = chain(*_more_columns(summary).values())
    parts = [
        f"# {evaluation['title']}", f"`{evaluation['command']}`",
        "Shares carry their 95 % Wilson interval.",
        who_wins_where(evaluation),
        table.markdown() if table else "",
        make_table("", [*heads(evaluation), *COLUMNS, *more], [rows]).markdown(),
    ]  # fmt: skip
    return "\n\n".join(part.rstrip("\n") for part in parts if part) + "\n"


def terminal_table(evaluation: Evaluation, keys: Sequence[str] = BRIEF) -> str:
    """The summary as aligned columns; `keys` are those of columns, or 'all' alone.

    Raises:
        InputError: there is no such column.
    """
    for key in keys:
        if key not in COLUMN_OF and list(keys) != ["all"]:
            known = f"known: all, {', '.join(COLUMN_OF)}{suggest(key, COLUMN_OF)}"
            raise InputError(f"--columns {key} is unknown; {known}")
    summary = evaluation["summary"]
    every = [*COLUMNS, *chain(*_more_columns(summary).values())]
    chosen = [COLUMN_OF[key] for key in keys if key in COLUMN_OF] or every
    rows = [*ranked(summary), *(row for row in summary if row["scene"] != "all")]
    if len(evaluation["scenes"]) == 1:
        rows = ranked(summary)
    return make_table("", [*heads(evaluation), *chosen], [rows]).text()


def write_report(evaluation: Evaluation, folder: str | Path) -> Path:
    """Write report.html and its figures as figures/*.svg.

    The page needs no other file, unless a long video or hundreds of failures would make it large:
    then it links them.

    Args:
        evaluation: the content of results.json.
        folder: that holds the pictures and the video, and gets the page.

    Returns:
        The page's path.
    """
    folder = Path(folder)
    drawn = figures(evaluation)
    for name, (_, svg) in drawn.items():
        with atomic_write(folder / "figures" / f"{name}.svg") as part:
            part.write_bytes(svg)
    best, more = ranked(evaluation["summary"]), _more_columns(evaluation["summary"])
    parts = (*PARTS, *more.items())
    scenes, several = evaluation["scenes"], len(evaluation["scenes"]) > 1
    policy, scene = heads(evaluation)
    caption = "All scenes, fewest contacts first" if several else "Fewest contacts first"
    tables = [make_table(caption + what, [policy, *part], [best]) for what, part in parts]
    tables += filter(None, [ranking_table(evaluation)])
    if several:
        groups = [ranked(evaluation["summary"], name) for name in scenes]
        tables += [
            make_table(f"By scene, fewest contacts first{what}", [policy, scene, *part], groups)
            for what, part in parts
        ]
    some = bool(best and evaluation["records"])
    first = best[0]["policy"] if some else ""
    of = [record for record in evaluation["records"] if record["policy"] == first]
    return write_page(
        folder / "report.html", "evaluation.html", title=evaluation["title"], source=evaluation,
        best=best[0] if some else None, second=best[1] if some and len(best) > 1 else None,
        comparison=who_wins_where(evaluation), success=SUCCESS, policy=policy.name,
        collision=COLUMN_OF["collision"], is_best=best_of(best) is not None,
        columns=(*COLUMNS, *chain(*more.values())),
        ended=Counter(record["outcome"] for record in of), tables=tables,
        figures=drawn, video=_video(evaluation["video"], folder),
        failures=_failures(evaluation["records"], [row["policy"] for row in best], folder),
    )  # fmt: skip


def _video(video: Record | None, folder: Path) -> dict[str, Any] | None:
    if video is None or not (path := folder / video["file"]).is_file():
        return None
    small = path.stat().st_size <= _LARGEST_VIDEO
    source = data_uri(path.read_bytes(), path.suffix) if small else quote(video["file"])
    return {**video, "source": source}


def _failures(
    records: Sequence[Record], policies: Sequence[str], folder: Path
) -> list[dict[str, Any]]:
    """Every failure with its picture, those of the best policy first."""
    failed = [record for record in records if not record["success"]]
    failed.sort(key=lambda record: policies.index(record["policy"]))
    left, found = _MAX_PICTURES, []
    for record in failed:
        source, picture = "", record.get("picture")
        if picture and (folder / picture).is_file():
            source = data_uri(webp(folder / picture), ".webp") if left > 0 else quote(picture)
            left -= len(source)
        found.append({**record, "source": source})
    return found


BEST = "lattice+window"  # chosen on training seeds; test seeds are 0 to n-1
FILM, FILMS = "episode", (".mp4", ".gif")
RESULTS = "results.json"
PLANNED, PAUSE = 6, 10  # a film shows every n-th picture of a plan, and stays at its end


@dataclass(frozen=True)
class Suite:
    """The policies, scenes and episodes of a comparison."""

    title: str
    policies: Sequence[Spec]
    scenes: Sequence[Spec]
    episodes: int  # test seeds 0 to episodes - 1
    env: Mapping[str, Any] = field(default_factory=lambda: {"pose_source": "modelled"})
    video: bool = True
    film: Sequence[str] = ()  # names of the policies to film; none: the best one


def _scene(spec: Spec) -> Spec:
    """A scene; a doorway is labelled with the margin that the best manoeuvre leaves."""
    if not isinstance(spec, Mapping) or spec["name"] != "doorway":
        return spec
    door, corridor = spec["door_width"], spec["corridor_width"]
    margin = Doorway(door_width=door, corridor_width=corridor).margin()
    return {**spec, "label": f"door {door:.2f} corridor {corridor:.2f} margin {margin:.3f}"}


SUITES = {
    name: Suite(**one | {"scenes": tuple(map(_scene, one["scenes"]))})
    for name, one in read_data("suites.yaml").items()
}


def suite(name: str) -> Suite:
    """A suite by name.

    Raises:
        InputError: there is none of that name.
    """
    if name not in SUITES:
        near = suggest(name, SUITES)
        raise InputError(f"suite {name!r} is unknown; known: {', '.join(sorted(SUITES))}{near}")
    return SUITES[name]


def compare(
    what: Suite,
    folder: str | Path,
    *,
    jobs: int = 1,
    progress: bool = True,
    seeds: Sequence[int] | None = None,
    watch: Watch = NO_WATCH,
) -> dict[str, Any]:
    """Evaluate a suite and write results.json, table.md, a video and report.html to a folder.

    Raises:
        InputError: a name in the suite or the folder is wrong.
        StoppedError: Ctrl-C; the same call computes only what is missing.
    """
    begun = time.perf_counter()
    folder = Path(folder)
    what = dataclasses.replace(
        what, policies=distinct(what.policies, "policies"), scenes=distinct(what.scenes, "scenes")
    )
    seeds = list(range(what.episodes)) if seeds is None else list(seeds)
    records = evaluate(
        what.policies, what.scenes, seeds, env=what.env, folder=folder, jobs=jobs,
        progress=progress, watch=watch,
    )  # fmt: skip
    summary = summarise(records)
    evaluation: dict[str, Any] = {
        "title": what.title,
        "command": command_line(),
        "provenance": {
            "config": dump(dataclasses.asdict(what)),
            "seeds": seeds,
            **provenance(jobs=jobs),
            "finished": now(),
        },
        "policies": [label(policy) for policy in what.policies],
        "kinds": {label(policy): kind_of(without_labels(policy)) for policy in what.policies},
        "scenes": [label(scene) for scene in what.scenes],
        "records": records,
        "summary": summary,
        "video": None,
    }
    if (folder / RESULTS).exists():  # then a film there is of another comparison
        for suffix in FILMS:
            (folder / f"{FILM}{suffix}").unlink(missing_ok=True)
    try:
        if what.video and records:
            evaluation["video"] = film(what, evaluation, folder)
    finally:  # the results are there without a film, too
        evaluation["provenance"]["wall_time_s"] = round(time.perf_counter() - begun, 2)
        write_json(folder / RESULTS, evaluation)
        write_text(folder / "table.md", markdown(evaluation))
        write_report(evaluation, folder)
    return evaluation


def film(what: Suite, evaluation: Evaluation, folder: Path) -> Record:
    """Film the suite's policies side by side, or the best policy's first success or episode.

    Returns:
        The file, the policies, the scene and the seed.
    """
    best = ranked(evaluation["summary"])[0]["policy"]
    policies = [spec for spec in what.policies if label(spec) in what.film]
    policies = policies or [spec for spec in what.policies if label(spec) == best]
    of = [record for record in evaluation["records"] if record["policy"] == label(policies[0])]
    chosen = next((record for record in of if record["success"]), of[0])
    scene = next(spec for spec in what.scenes if label(spec) == chosen["scene"])
    frames, period = side_by_side(policies, scene, chosen["seed"], env_settings(**what.env))
    path = folder / f"{FILM}{video_suffix()}"
    write_video(path, frames, 1.0 / period)
    names = ", ".join(map(label, policies))
    return {"file": path.name, "policy": names, "scene": chosen["scene"], "seed": chosen["seed"]}


def side_by_side(
    policies: Sequence[Spec], scene: Spec, seed: int, env: Mapping[str, Any], periods: int = 1
) -> tuple[list[Any], float]:
    """Pictures of the policies' drives, every n-th control period, and the time between two [s].

    A policy whose whales shorten a path plans first, see `PlanPictures.of_drive`. Several drives
    have titles.
    """
    parts = [_pictures(policy, scene, seed, env) for policy in policies]
    before = max(len(planned) for planned, _, _ in parts)
    after = max(len(driven) for _, driven, _ in parts) + PAUSE
    columns = []
    for policy, (planned, driven, _) in zip(policies, parts, strict=True):
        drive = driven + driven[-1:] * (after - len(driven))
        still = (planned[-1:] or driven[:1]) * (before - len(planned))
        pictures = planned + still + drive[::periods]
        titled = (with_legend(picture, [], label(policy)) for picture in pictures)
        columns.append([*titled] if len(parts) > 1 else pictures)
    return [np.hstack(row) for row in zip(*columns, strict=True)], periods * parts[0][2]


def _pictures(
    policy: Spec, scene: Spec, seed: int, settings: Mapping[str, Any]
) -> tuple[list[Any], list[Any], float]:
    """Pictures of a plan with whales, if there is one, and of the drive; the control period [s]."""
    driver: Any = make_policy(without_labels(policy))
    planned: list[Any] = []
    driven: list[Any] = []

    def add(env: Any) -> None:
        driven.append(env.render())
        planner = driver.config.planner["name"] if isinstance(driver, PlannedDriver) else ""
        mission = env.unwrapped.mission
        if len(driven) == 1 and planner == SHORTENS and mission.map is not None:
            film = PlanPictures.of_drive(driver, mission, size=driven[0].shape[:2]).film()
            planned.extend([*film][::PLANNED])

    with closing(make_env(scene, settings, policy=policy)) as env:
        drive_episode(env, driver, seed, add)
        return planned, driven, env.unwrapped.task.period
