"""Tables of results: `python docs/tables.py` fills them into README.md and the pages of docs.

A page holds `<!-- figures: NAME -->`, the table and `<!-- end -->`; a function here writes the
table from result files, docs/results/data/*.json, and from the cards of the shipped weights. The
words of pages, columns and rows stand in docs/tables.yaml.
`python docs/tables.py take NAME FILE` makes such a file from the results.json of a comparison, the
env.json of `wheelchair bench env`, the t1-agreement.json, t1-budget.json or verdicts.csv of
`wheelchair study`: counts and means, from which intervals follow.
`python docs/tables.py run [NAME ...]` (`make results`) repeats the commands of result files, of all
without a name, and takes what they find; finished episodes are kept, so that it can be stopped.
Maps that a command names are those of the folder from which it is called.
`python docs/tables.py try [NAME ...]` drives one episode of each policy and scene for a try.
"""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from agents.benchmarks.tracks import TRACKS, read_result  # noqa: E402
from agents.control import FOLLOWERS  # noqa: E402
from agents.evaluation.compare import BEST  # noqa: E402
from agents.evaluation.evaluate import label  # noqa: E402
from agents.evaluation.metrics import WIDE  # noqa: E402
from agents.evaluation.provenance import without_outputs, write_text  # noqa: E402
from agents.evaluation.statistics import mcnemar, mcnemar_p, ratio_interval, wilson  # noqa: E402
from agents.evaluation.tables import markdown_table  # noqa: E402
from agents.learning.weights import load_weights  # noqa: E402
from agents.people import ASSISTANTS  # noqa: E402
from agents.studies.runner import STUDIES, count_verdicts, effect_text  # noqa: E402
from planners import PLANNERS  # noqa: E402
from wheelchair_gym.base.settings import InputError, read_json  # noqa: E402
from wheelchair_gym.people.drivers import DRIVERS  # noqa: E402

DATA = ROOT / "docs" / "results" / "data"
WEIGHTS = ROOT / "agents" / "data" / "weights"
WORDS: dict[str, Any] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
CHAPTERS: dict[str, str] = WORDS["chapters"]
PAGES = (*WORDS["pages"], *(f"docs/studies/{name}.md" for name in CHAPTERS))
ASSISTANCE = ("agreement_angle", "intervention_share", "stick_effort")  # means are kept
EXCEPTIONS = 5  # files of other code that may stand beside the release's, with reasons
_PART = re.compile(r"(<!-- figures: (\w+) -->\n).*?(<!-- end -->\n)", re.S)

Row = Mapping[str, Any]


# ---- result files


def condensed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a comparison's or benchmark's results that a result file holds."""
    source = content.get("provenance", content)
    head = {
        "command": without_outputs(content["command"]),
        **{key: source[key] for key in ("commit", "trees", "finished") if key in source},
        "machine": {key: source["machine"][key] for key in ("cpu", "cores")},
        "versions": source["versions"],
    }
    if "verdicts" in content:
        return {**head, "command": "wheelchair study all", "rows": content["verdicts"]}
    if "readings" in content:
        return {**head, "runs": content["runs"], "rows": content["readings"] or content["gains"]}
    if "records" not in content:
        return {**head, "rows": [row for row in content["rows"] if "rate" in row]}
    head["seeds"] = [source["seeds"][0], source["seeds"][-1]]
    if "stick_effort" in content["records"][0]:
        return {**head, "rows": assisted(content["records"])}
    env = source["config"]["env"]
    poses = {
        label(scene): {**env, **(scene.get("env", {}) if isinstance(scene, dict) else {})}.get(
            "pose_source"
        )
        for scene in source["config"]["scenes"]
    }
    rows = []
    for name in content["policies"]:
        for pose in dict.fromkeys(poses.values()):
            records = [r for r in content["records"] if poses[r["scene"]] == pose]
            ours, best = ([r for r in records if r["policy"] == of] for of in (name, BEST))
            rows.append(drives(ours, best) | {"policy": name, "pose": pose})
    return {**head, "rows": rows}


def assisted(records: Sequence[Row]) -> list[dict[str, Any]]:
    """A row for each assistant, person and scene: times by seed (null: no success), and means."""
    rows: dict[tuple[str, ...], list[Row]] = {}
    for record in sorted(records, key=lambda record: int(record["seed"])):
        scene, _, driver = record["scene"].rpartition(", ")
        rows.setdefault((record["policy"], driver, scene), []).append(record)
    return [
        {
            "policy": policy, "driver": driver, "scene": scene,
            "times": [round(r["time"], 1) if r["success"] else None for r in of],
            "at_fault": sum(r["at_fault"] for r in of),
            **{key: _figure(np.mean, of, key) for key in ASSISTANCE},
        }
        for (policy, driver, scene), of in rows.items()
    ]  # fmt: skip


def drives(records: Sequence[Row], best: Sequence[Row]) -> dict[str, Any]:
    """Counts, means and medians of a policy's episodes; the best policy's are compared by pairs.

    Time is the mean of successful episodes; jerk and energy are medians of all.
    """
    successes = [record for record in records if record["success"]]
    wide = [r for r in records if r["margin"] is not None and r["margin"] >= WIDE]
    row: dict[str, Any] = {"policy": "", "pose": "", "episodes": len(records)}
    row |= {
        key: sum(record[key] for record in records)
        for key in ("success", "contact", "at_fault", "touched_actor")
    }
    row["timeout"] = sum(record["outcome"] == "timeout" for record in records)
    row["wide"] = {"episodes": len(wide), "success": sum(record["success"] for record in wide)}
    row["time"] = _figure(np.mean, successes, "time")
    row |= {key: _figure(np.mean, records, key) for key in ("barn", "barn_own")}
    row |= {key: _figure(np.median, records, key) for key in ("jerk_rms", "energy_per_m")}
    if best and best[0]["policy"] != records[0]["policy"]:
        row["beside_best"] = pairs(records, best)
    row["scenes"] = dict.fromkeys((record["scene"].partition(", ")[0] for record in records), 0)
    for record in successes:
        row["scenes"][record["scene"].partition(", ")[0]] += 1
    return row


def _figure(statistic: Callable[[Any], Any], records: Sequence[Row], key: str) -> float | None:
    values = [record[key] for record in records if record[key] is not None]
    return float(f"{statistic(values):.4g}") if values else None


def pairs(records: Sequence[Row], best: Sequence[Row]) -> dict[str, Any]:
    """In how many episodes either alone succeeds, and the ratio of their times where both do."""
    ours, theirs = (
        {(r["scene"], r["seed"]): r["time"] if r["success"] else None for r in of}
        for of in (records, best)
    )
    alone, other, _, ratio = compared(list(ours.values()), [theirs[key] for key in ours])
    found: dict[str, Any] = {"alone": alone, "best_alone": other}
    return found | ({"time_ratio": ratio} if ratio else {})


def compared(
    ours: Sequence[float | None], theirs: Sequence[float | None]
) -> tuple[int, int, float, list[float]]:
    """Compare times drive by drive; None is a drive without success.

    Returns:
        Successes of either alone, McNemar's p, and the geometric mean of the ratios of times where
        both succeed, with its 95 % interval (Student's t, of logarithms); empty with fewer than 2.
    """
    alone, other, p = mcnemar(*([one is not None for one in each] for each in (ours, theirs)))
    pairs = zip(ours, theirs, strict=True)
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    if len(both) < 2:
        return alone, other, p, []
    found = ratio_interval(*zip(*both, strict=True))
    return alone, other, p, [round(value, 3) for value in found]


def take(name: str, file: Path) -> Path:
    """Write a result file from results.json, env.json or verdicts.csv, one row a line.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    try:
        if file.name == "verdicts.csv":
            of_all = [read_json(file.with_name(f"{name}.json")) for name in STUDIES]
            verdicts = [
                {k: float(f"{v:.5g}") if isinstance(v, float) else v for k, v in row.items()}
                for of in of_all for row in ({"study": of["name"], **one} for one in of["claims"])
            ]  # fmt: skip
            found = condensed({**of_all[0], "verdicts": verdicts})
        else:
            found = condensed(read_json(file))
    except (LookupError, TypeError, AttributeError):
        raise InputError(
            f"{file}: expected results.json of `wheelchair compare`, env.json of `wheelchair bench "
            "env`, or t1-agreement.json or verdicts.csv of `wheelchair study`"
        ) from None
    rows = ",\n  ".join(json.dumps(row) for row in found.pop("rows"))
    head = "".join(f" {json.dumps(key)}: {json.dumps(value)},\n" for key, value in found.items())
    path = DATA / f"{name}.json"
    write_text(path, f'{{\n{head} "rows": [\n  {rows}\n ]\n}}\n')
    return path


def measure(names: Sequence[str], kept: bool = True) -> list[str]:
    """Repeat the commands of result files, of all without a name; unless kept, only for a try.

    Returns:
        The names whose command failed; their results are as before.

    Raises:
        InputError: a name is unknown, or a peer is not installed.
    """
    failed = []
    known = sorted(path.stem for path in DATA.glob("*.json"))
    for name in names:
        if name not in known:
            raise InputError(f"result file {name!r} is unknown; known: {', '.join(known)}")
    for name in names or known:
        words = shlex.split(results(name)["command"])[1:]
        of = "study" if words[0] == "study" else name  # studies share their runs
        folder = ROOT / "runs" / ("results" if kept else "tried") / of
        few = {"compare": ["--episodes", "1"], "study": ["--runs", "2"], "bench": []}
        more = ["--no-video"] * (words[0] == "compare") + ([] if kept else few[words[0]])
        if kept and words[0] == "bench" and find_spec("irsim") is None:
            raise InputError(f"{name} measures IR-SIM, too: pip install 'wheelchair_gym[peers]'")
        print(f"{name}: wheelchair {shlex.join(words)}", flush=True)
        command = [sys.executable, "-m", "wheelchair_gym", *words, *more, "--out", str(folder)]
        study = "verdicts.csv" if words[1] == "all" else f"{words[1]}.json"
        written = {"compare": "results.json", "bench": "env.json", "study": study}
        if subprocess.run(command, check=False).returncode:
            failed.append(name)
        elif kept:
            take(name, folder / written[words[0]])
    return failed


def stale() -> list[str]:
    """Result files of other code than the release's, without those that tables.yaml excepts.

    Raises:
        InputError: there are more exceptions than five.
    """
    excepted, released = WORDS["excepted"], WORDS["released"]
    if len(excepted) > EXCEPTIONS:
        raise InputError(f"docs/tables.yaml: excepted: expected at most {EXCEPTIONS} names")
    found = {path.stem: results(path.stem) for path in DATA.glob("*.json")}
    return sorted(
        name for name, of in found.items() if released and name not in excepted
        and (of.get("trees") != released or of["commit"].endswith("+"))
    )  # fmt: skip


def results(name: str) -> dict[str, Any]:
    """The content of a result file."""
    return dict(read_json(DATA / f"{name}.json"))


def row_of(name: str, policy: str = BEST, pose: str = "mcl") -> Row:
    """The row of a policy with a pose source in a result file."""
    rows = results(name)["rows"]
    return next(row for row in rows if row["policy"] == policy and row["pose"] == pose)


# ---- tables


def table(name: str, rows: Iterable[Sequence[Any]], **words: Any) -> str:
    """Rows as a Markdown table under the headings of docs/tables.yaml, with words filled in."""
    headings = [heading.format(**words) for heading in WORDS["columns"][name]]
    right = [heading.startswith(">") for heading in headings]
    return markdown_table([heading.removeprefix(">") for heading in headings], rows, right)


def percent(hits: int, of: int) -> str:
    """A share in percent with its 95 % interval."""
    low, high = wilson(hits, of)
    return f"{100 * hits / of:.1f} ({100 * low:.1f} to {100 * high:.1f})"


def success(row: Row) -> str:
    """The share of successes of a row."""
    return percent(row["success"], row["episodes"])


def contacts(*rows: Row) -> str:
    """Episodes with a contact, and those in which the chair was at fault for one."""
    return "; ".join(str(sum(row[key] for row in rows)) for key in ("contact", "at_fault"))


def number(value: float | None, digits: int) -> str:
    """A figure; empty where there is none."""
    return "" if value is None else f"{value:.{digits}f}"


def planned() -> str:
    """Planned policies on each suite."""
    rows = []
    for name, text, *which in WORDS["planned"]:
        row = row_of(name, *which)
        time = number(row["time"], 1)
        rows.append((text, f"{row['episodes']:,}", success(row), contacts(row), time))
        if name == "barn":
            wide = row["wide"]
            narrow = {key: row[key] - wide[key] for key in wide}
            for margin, of in (("of 5 cm or more", wide), ("below 5 cm", narrow)):
                text = f"the same, worlds with a footprint margin {margin}"
                rows.append((text, of["episodes"], success(of), "", ""))
    return table("planned", rows)


def barn_60() -> str:
    """BARN's own worlds with a known and with an unknown map."""
    rows = []
    for policy, note in WORDS["barn_60"].items():
        known, unknown = (row_of("barn_60", policy, pose) for pose in ("mcl", "slam"))
        scores = f"{known['barn']:.2f}; {known['barn_own']:.2f}"
        rows.append(
            (f"`{policy}`{note}", known["success"], unknown["success"], contacts(known, unknown),
             scores)
        )  # fmt: skip
    return table("barn_60", rows)


def league() -> str:
    """Each policy of the league with a known and with an unknown map, the best first."""
    notes = {"ppo_goal": ", which observes no map"}
    known, unknown = (
        {row["policy"]: row for row in results("league")["rows"] if row["pose"] == pose}
        for pose in ("modelled", "slam")
    )
    rows = [
        (f"`{row['policy']}`{notes.get(row['policy'], '')}", success(row),
         success(unknown[row["policy"]]), contacts(row, unknown[row["policy"]]),
         number(row["time"], 1), number(row["jerk_rms"], 2), number(row["energy_per_m"], 3))
        for row in sorted(known.values(), key=lambda row: -row["success"])
    ]  # fmt: skip
    return table("league", rows, episodes=results("league")["rows"][0]["episodes"])


def league_pairs() -> str:
    """The learned policy beside the planned one, episode by episode."""
    rows = []
    for pose, where in (("modelled", "known map"), ("slam", "unknown map")):
        row, best = (row_of("league", policy, pose) for policy in ("ppo_guided", BEST))
        middle, low, high = row["beside_best"]["time_ratio"]
        alone, other = (row["beside_best"][key] for key in ("alone", "best_alone"))
        p = mcnemar_p(alone, other)
        people = [sum(of["scenes"][k] for k in ("building", "hall")) for of in (row, best)]
        episodes = 2 * row["episodes"] // len(row["scenes"])
        rows.append(
            (where, f"{middle:.2f} ({low:.2f} to {high:.2f})", f"{alone}; {other}", f"{p:.2f}",
             f"{people[0]} of {episodes}; {people[1]} of {episodes}")
        )  # fmt: skip
    return table("league_pairs", rows)


def speed() -> str:
    """Steps per second beside those of a peer."""
    rows = []
    for beams in dict.fromkeys(row["beams"] for row in results("speed")["rows"]):
        rates = {row["what"]: row for row in results("speed")["rows"] if row["beams"] == beams}
        ours = (
            f"{rates[k]['rate']:,.0f} ({rates[k]['ratio']:.0f} x)" for k in ("one env", "batch")
        )
        rows.append((f"{beams:,}", f"{rates['IR-SIM']['rate']:.0f}", *ours))
    return table("speed", rows)


def measured() -> str:
    """The figures of README.md: success, speed and claims."""
    drives = []
    for name, (text, policy, pose) in WORDS["measured"].items():
        row = row_of(name, policy, pose)
        drives.append((text.format(f"{row['episodes']:,}"), success(row), contacts(row)))
    rates = {row["what"]: row["rate"] for row in results("speed")["rows"] if row["beams"] == 1081}
    speeds = [(text, f"{rates[what]:,.0f}") for what, text in WORDS["rates"].items()]
    counts = map(len, (PLANNERS, FOLLOWERS, DRIVERS, ASSISTANTS))
    end = claims() + WORDS["counts"].format(*counts)
    return "\n".join((table("drives", drives), table("rates", speeds), end))


def published_verdicts(study: str = "") -> list[dict[str, Any]]:
    """Return the verdicts of one study or of all."""
    return [row for row in results("verdicts")["rows"] if study in ("", row["study"])]


def claims() -> str:
    """Write the number of claims of the sources that hold."""
    hold, fail, undecided = count_verdicts([{"claims": published_verdicts()}]).values()
    return (
        f"Of the {hold + fail + undecided} claims in the five publications that the planners come "
        f"from, {hold} hold, {fail} do not, and {undecided} cannot be decided.\n"
    )


def verdicts_by_study() -> str:
    """The number of verdicts of each study, with a link to its claims."""
    rows = []
    for page, names in CHAPTERS.items():
        for name in names.split():
            found = count_verdicts([{"claims": published_verdicts(name)}])
            rows.append((f"[`{name}`]({page}.md)", STUDIES[name].title, *found.values()))
    return table("verdicts", rows)


def agreement() -> str:
    """Write how well each reading of the thesis's global variant predicts its printed lengths."""

    def with_bounds(row: Row, key: str) -> str:
        return f"{row[key]:.2f} ({row[f'{key}_low']:.2f} to {row[f'{key}_high']:.2f})"

    rows = [
        (row["reading"], with_bounds(row, "correlation"), with_bounds(row, "r2"),
         f"{row['rms']:.2f} m", with_bounds(row, "length") + " m",
         *(f"{row[part]:.2f}" for part in ("odd", "even", "without")))
        for row in results("agreement")["rows"]
    ]  # fmt: skip
    return table("agreement", rows)


def gain() -> str:
    """Return gain and cost of the whale variants beside RRT*, by swarm and map."""
    found = results("gain")

    def change(middle: float, low: float, high: float) -> str:
        return f"{middle:+.1f} ({low:+.1f} to {high:+.1f})" if low < high else f"{middle:+.1f}"

    rows = [
        (row["row"], f"{1e3 * row['time_s']:,.1f}", change(*gains.pop("all maps")),
         *(f"{of[0]:+.1f}" for of in gains.values()))
        for row in found["rows"] for gains in [dict(row["gain"])]
    ]  # fmt: skip
    return table("gain", rows)


def learned() -> str:
    """Success and contacts of the shipped policies, for each seed."""
    cards = {
        name: load_weights(WEIGHTS / f"{name}.npz").card
        for name in ("ppo_guided", "ppo_goal", "td3_guided")
    }
    headings = [""]
    for name, card in cards.items():
        seeds = [f"{s} (shipped)" if int(s) == card["seed"] else s for s in sorted(card["curves"])]
        headings.append(f"`{name}`: seeds {', '.join(seeds)}")
    rows = []
    for options, text in WORDS["learned"].items():
        cells = []
        for name, card in cards.items():
            command = f"wheelchair compare --policies {name} {options}"
            of = [row for row in card["results"] if row["command"] == command]
            of.sort(key=lambda row: int(row["seed"]))
            cell = ", ".join(f"{100 * r['success']:.1f} ({100 * r['collision']:.1f})" for r in of)
            if 0 < len(of) < len(card["curves"]):
                cell += f": seeds {', '.join(str(row['seed']) for row in of)}"
            cells.append(cell)
        rows.append((text, *cells))
    return markdown_table(headings, rows)


def leaderboard() -> str:
    """The entries of each track of the benchmark, the best first."""
    entries = [read_result(path) for path in sorted((DATA.parent / "entries").glob("*.json"))]
    tables = []
    for track in TRACKS:
        rows = [
            (f"`{of['policy']}`", percent(round(of["n"] * of["success"]), of["n"]),
             f"{of['contacts']}; {of['at_fault']}", number(of["time"], 1),
             number(of["clearance"], 2), number(of["act_ms"], 2), of["commit"])
            for of in sorted(entries, key=lambda of: -float(of["success"])) if of["track"] == track
        ]  # fmt: skip
        tables.append(f"`{track}`\n\n" + (table("leaderboard", rows) if rows else "None yet.\n"))
    return "\n".join(tables)


def sources() -> str:
    """Every result file with its command."""
    rows = [
        (f"[{path.stem}](data/{path.name})", f"`{found['command']}`", found["commit"],
         found["machine"]["cpu"])
        for path in sorted(DATA.glob("*.json")) for found in [results(path.stem)]
    ]  # fmt: skip
    return table("sources", rows)


def _times(rows: Sequence[Row], **which: str) -> list[float | None]:
    """The times of rows of persons, in their order; None: no success."""
    of = [row for row in rows if all(row[key] == value for key, value in which.items())]
    return [time for row in of for time in row["times"]]


def _succeed(times: Sequence[float | None]) -> str:
    hits = [time for time in times if time is not None]
    low, high = wilson(len(hits), len(times))
    share = f"{len(hits)} of {len(times)}"
    if len(times) >= 10:  # fewer have no interval
        share += f" ({100 * low:.0f} to {100 * high:.0f} %)"
    return f"{share}, {np.median(hits):.0f} s" if hits else share


def _names(rows: Sequence[Row], key: str) -> list[str]:
    return list(dict.fromkeys(row[key] for row in rows))


def _driven(name: str, down: str) -> str:
    """Each person, or each course of driving skills, with each assistant."""
    rows = results(name)["rows"]
    columns = _names(rows, "policy")
    lines = [
        (f"`{one}`", *(_succeed(_times(rows, **{down: one, "policy": other})) for other in columns))
        for one in _names(rows, down)
    ]
    return markdown_table((down, *(f"`{column}`" for column in columns)), lines)


def skills_pairs() -> str:
    """Assistants beside the shield alone, drive by drive."""
    rows, lines = results("skills")["rows"], []
    base = _times(rows, policy="shield")
    for policy in _names(rows, "policy"):
        of = [row for row in rows if row["policy"] == policy]
        times = _times(of)
        alone, other, p, (middle, low, high) = compared(times, base)
        hits = sum(time is not None for time in times)
        angle, share, effort = (_figure(np.mean, of, key) for key in ASSISTANCE)
        beside = ("", "", "1.00") if policy == "shield" else (
            f"{alone}; {other}", f"{p:.3f}", f"{middle:.2f} ({low:.2f} to {high:.2f})"
        )  # fmt: skip
        lines.append(
            (f"`{policy}`", percent(hits, len(times)), sum(row["at_fault"] for row in of), *beside,
             f"{np.degrees(angle):.1f}", f"{100 * share:.0f}", f"{effort:.1f}")
        )  # fmt: skip
    return table("skills", lines)


def claims_text(names: Sequence[str]) -> str:
    """The claims of studies with their published verdicts, in Markdown."""
    studies = [STUDIES[name] for name in names]
    of_all = [n for n in studies[0].notes if studies[1:] and all(n in s.notes for s in studies)]
    text = "".join(f"\n{note}\n" for note in of_all)
    for name, study in zip(names, studies, strict=True):
        rows = published_verdicts(name)
        lines = [
            (row["claim"], row["source"], row["reading"].replace(study.reading, ""),
             *("" if row[k] is None else f"{row[k]:.3g}" for k in ("printed", "margin")),
             effect_text(row), row["verdict"])
            for row in rows
        ]  # fmt: skip
        text += (
            f"\n## `{name}`: {study.title}\n\n{study.source}. {study.settings} Reading: "
            f"{study.reading}.\n\n`{rows[0]['command']}`\n\n{table('claims', lines)}"
        )
        text += "".join(f"\n{note}\n" for note in study.notes if note not in of_all)
    return text


FIGURES: dict[str, Callable[[], str]] = {
    function.__name__: function
    for function in (planned, barn_60, league, league_pairs, speed, measured, claims, agreement,
                     leaderboard, learned, skills_pairs, sources, verdicts_by_study, gain)
}  # fmt: skip
FIGURES |= {name: partial(claims_text, names.split()) for name, names in CHAPTERS.items()} | {
    "docking": partial(_driven, "skills_dock", "driver"),
    "skills_drivers": partial(_driven, "skills", "driver"),
    "skills_courses": partial(_driven, "skills", "scene"),
}


def filled(text: str, page: str) -> str:
    """A page's text with its figures.

    Raises:
        InputError: a name is unknown.
    """

    def figures(part: re.Match[str]) -> str:
        if part[2] not in FIGURES:
            raise InputError(
                f"{page}: figures {part[2]!r} are unknown; known: {', '.join(FIGURES)}"
            )
        return f"{part[1]}{FIGURES[part[2]]()}{part[3]}"

    return _PART.sub(figures, text)


def contents() -> dict[Path, str]:
    """The text of each page that shows figures."""
    paths = {name: ROOT / name for name in PAGES}
    return {path: filled(path.read_text(encoding="utf-8"), name) for name, path in paths.items()}


def main(words: Sequence[str]) -> int:
    """Take a result file if asked to, and fill the pages."""
    failed = []
    try:
        match words:
            case []:
                pass
            case ["take", name, file]:
                take(name, Path(file))
            case ["run" | "try" as what, *names]:
                failed = measure(names, kept=what == "run")
            case _:
                raise InputError("expected no argument, or: take NAME FILE, run or try [NAME ...]")
        for path, text in contents().items():
            write_text(path, text)
        if failed:
            raise InputError(f"commands failed, their results are as before: {', '.join(failed)}")
        if old := stale():
            raise InputError(f"measured with other code than the release: {', '.join(old)}")
    except InputError as error:
        print(f"tables: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
