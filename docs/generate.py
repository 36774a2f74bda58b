"""Pages and tables of the documentation that follow from the code.

`docs/conf.py` calls `write_pages` at each build. Nothing that is written here is committed:

- fragments, which the page of the environment includes: actions, observations, rewards, info;
- the reference of settings, from the function behind `wheelchair settings --markdown`;
- the names in every registry;
- the reference of the public modules, from their docstrings (Google style, Markdown inside).
"""

import ast
import dataclasses
import enum
import importlib
import inspect
import io
import re
import textwrap
import tokenize
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import yaml
from sphinx.util.inspect import stringify_signature

from agents.cli.lists import PARTS, all_settings, markdown, settings_rows
from agents.control import FOLLOWERS
from agents.evaluation.tables import markdown_table
from agents.people import ASSISTANTS
from agents.policies import POLICIES
from agents.policies.planned import TRANSITIONS
from planners import OPTIMIZERS, PLANNERS
from planners.registries import OBJECTIVES
from wheelchair_gym.base.settings import setting_docs
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.envs.results import INFO_KEYS
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.hardware.registry import CHAIRS
from wheelchair_gym.people.drivers import DRIVERS
from wheelchair_gym.scenes import SCENES
from wheelchair_gym.scenes.skill import COURSES
from wheelchair_gym.signals import READING, TRUTH, Signal
from wheelchair_gym.task.observations import OBSERVATION_KEYS
from wheelchair_gym.task.rewards import RewardWeights

# Public modules, by package.
MODULES = yaml.safe_load(Path(__file__).with_name("modules.yaml").read_text(encoding="utf-8"))
# Compiled functions are internal, except those of these modules.
KERNELS = ("wheelchair_gym.geometry.", "wheelchair_gym.compiled.random")

# Settings with which every key of the observation is present in one of two environments.
MORE_KEYS = {
    "last_action": True, "shield_state": True, "side_clearance": True, "trail": [1, 2, 4, 8],
    "tracks": 6, "privileged": True,
}  # fmt: skip


def write_pages(folder: Path) -> None:
    """Write all generated pages into a folder, in place of those that are there.

    Files whose text is the same stay as they are, so that a second build is fast.
    """
    pages = {
        **{f"fragments/{name}.md": text for name, text in fragments().items()},
        **dict(settings_pages()),
        **dict(module_pages()),
    }
    for path in folder.rglob("*.md"):
        if path.relative_to(folder).as_posix() not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


# ---- the environment


def fragments() -> dict[str, str]:
    """Return the tables and texts that pages include, by name."""
    limits, weights = Limits(), dataclasses.fields(RewardWeights)
    docs = setting_docs(RewardWeights)
    return {
        "actions": markdown_table(
            ("index", "meaning", "at -1", "at 0", "at 1"),
            [
                ("0", "forward speed", f"{-limits.backward:g} m/s", "0", f"{limits.forward:g} m/s"),
                ("1", "turn rate, counter-clockwise", f"{-limits.turn:g} rad/s", "0",
                 f"{limits.turn:g} rad/s"),
            ],
        ),
        "observations": _observations(),
        "rewards": markdown_table(
            ("term", "what is weighted", "weight", "unit", "source of the weight"),
            [
                (f"`{f.name}`", docs[f.name], f"{f.default:g}", f.metadata["unit"],
                 f.metadata["source"])
                for f in weights
            ],
        ),
        "info": markdown_table(
            ("key", "meaning"), [(f"`{key.name}`", key.meaning) for key in INFO_KEYS]
        ),
        "signals": markdown_table(
            Signal._fields, [(f"`{name}`", *map(str, rest)) for name, *rest in (*READING, *TRUTH)]
        ),
        "skills": markdown_table(
            ("course", "what is to be done", "dimensions", "goal reached within", "source"),
            [
                (f"`{name}`", course.title, course.dimensions, course.judged, course.source)
                for name, course in COURSES.items()
            ],
        ),
        "arguments": to_markdown(inspect.getdoc(NavigationEnv.__init__) or ""),
        "states": _states(),
        "names": names_page(),
    }  # fmt: skip


def _states() -> str:
    """The state machine of planned policies: a drawing, and the table of its transitions."""
    rows, arrows = [], dict[tuple[str, str], list[int]]()
    for number, (event, state, condition, action, after, stands) in enumerate(TRANSITIONS, 1):
        arrows.setdefault((state.value, after.value), []).append(number)
        texts = [first_line(method).rstrip(".") if method else "" for method in (condition, action)]
        texts = [text.removeprefix("Return True if ") for text in texts]
        ending = ", and stands until it has the plan" if stands else ""
        rows.append((number, state.value, event.value, *texts, f"{after.value}{ending}"))
    drawn = [f"{a:12} --({', '.join(map(str, on))})--> {b}" for (a, b), on in arrows.items()]
    head = ("", "state", "when", "if", "action", "next state")
    return "\n".join(["```", *drawn, "```", "", markdown_table(head, rows)])


def _observations() -> str:
    """The keys of the observation, with the shapes and bounds that the spaces have."""
    spaces: dict[str, tuple[str, Any]] = {}
    for when, guidance, driver, task in (
        ("always", None, None, {}),
        ("guided", "geodesic", None, {}),
        ("by setting", "poses", None, MORE_KEYS),
        ("by setting", "poses", None, {**MORE_KEYS, "hide_guidance": True}),
        ("with a driver", "poses", "expert", {}),
    ):
        env = NavigationEnv(config={"task": task}, guidance=guidance, driver=driver)
        for name, space in env.task.spaces.items():
            spaces.setdefault(name, (when, space))
        env.close()
    rows = []
    for key in OBSERVATION_KEYS:
        meaning = key.meaning.split("|")[-1].strip()
        when, space = spaces[key.name]
        low, high = (_bound(end) for end in (space.low, space.high))
        shape = str(tuple(map(int, space.shape)))
        rows.append((f"`{key.name}`", meaning, f"`{shape}`", low, high, when))
    return markdown_table(("key", "meaning", "shape", "low", "high", "present"), rows)


def _bound(values: Any) -> str:
    """A bound of a space in few words: one number, or the different ones in their order."""
    return ", ".join(dict.fromkeys(f"{value:.4g}" for value in np.ravel(values)))


# ---- settings, names


def settings_pages() -> Iterator[tuple[str, str]]:
    """A page of settings for each registry, and one for what is in none."""
    classes = all_settings()
    parts = {name: cls for name, cls in classes.items() if name in PARTS}
    people = [name for name, cls in parts.items() if cls.__module__ == "agents.people.protocol"]
    asked = {name: parts.pop(name) for name in ("protocol", *people) if name in parts}
    groups: dict[str, tuple[str, Mapping[str, type]]] = {
        "environment": ("Chair, sensors, task, training", parts),
        "planners": ("Planners", PLANNERS),
        "followers": ("Followers", FOLLOWERS),
        "policies": ("Policies", POLICIES),
        "scenes": ("Scenes", SCENES),
        "assistants": ("Assistants", ASSISTANTS),
        "chairs": ("Real chairs", CHAIRS),
        "participants": ("Experiments with participants", asked),
    }
    for name, (title, members) in groups.items():
        text = markdown({key: settings_rows(members[key]) for key in members})
        sections = text.partition("\n## ")[2]
        sections = re.sub(r"(?m)^## ?(\S+)$", r"## `\1`", f"## {sections}")
        command = f"`wheelchair settings {next(iter(members))}`"
        lead = f"{command} prints the settings of one class." if name != "chairs" else ""
        yield f"settings/{name}.md", f"# {title}\n\n{lead}\n\n{sections}"


def names_page() -> str:
    """Write the names of every registry, with the first sentence of each class."""
    text = "# Names\n\nEvery registry of the project, with the first sentence of each entry.\n"
    for title, registry in (
        ("Scenes", SCENES), ("Planners", PLANNERS), ("Optimizers of `swarm`", OPTIMIZERS),
        ("Objectives of `swarm`", OBJECTIVES), ("Followers", FOLLOWERS),
        ("Policies", POLICIES), ("Drivers", DRIVERS), ("Assistants", ASSISTANTS),
        ("Real chairs", CHAIRS),
    ):  # fmt: skip
        rows = [
            (f"`{name}`", f"`{cls.__name__}`", first_line(cls)) for name, cls in registry.items()
        ]
        text += f"\n## {title}\n\n{markdown_table(('name', 'class', 'what it is'), rows)}"
    return text


def first_line(thing: Any) -> str:
    """The first paragraph of a docstring in one line."""
    return " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split())


# ---- modules


def module_pages() -> Iterator[tuple[str, str]]:
    """A page for each public module, and one for each package that lists them."""
    for package, names in MODULES.items():
        modules = [importlib.import_module(f"{package}.{name}") for name in names]
        rows = [(f"[{m.__name__}]({m.__name__}.md)", first_line(m)) for m in modules]
        tree = "\n".join(f"{m.__name__.partition('.')[2]} <{m.__name__}>" for m in modules)
        yield (
            f"api/{package}.md",
            f"# {package}\n\n{to_markdown(inspect.getdoc(importlib.import_module(package)) or '')}"
            f"\n\n{markdown_table(('module', 'what it holds'), rows)}"
            f"\n:::{{toctree}}\n:hidden:\n\n{tree}\n:::\n",
        )
        for module in modules:
            yield f"api/{module.__name__}.md", module_page(module)


def module_page(module: ModuleType) -> str:
    """The page of a module: its docstring, its classes and its functions."""
    name = module.__name__
    title = name.partition(".")[2]  # a narrow screen breaks the whole name in the middle of a word
    head = f":::{{py:module}} {name}\n:::"
    parts = [f"# {title}", head, f"`{name}`", to_markdown(module.__doc__ or "")]
    for key, thing in public_members(module):
        parts.append(
            class_text(key, thing) if inspect.isclass(thing) else function_text(key, thing)
        )
    return "\n\n".join(parts) + "\n"


def public_members(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Public classes and functions of a module: those it defines, or its `__all__`."""
    listed = getattr(module, "__all__", None)
    for name, thing in vars(module).items():
        function = getattr(thing, "py_func", thing)  # Numba keeps the Python function
        if name.startswith("_") or not (inspect.isclass(function) or inspect.isfunction(function)):
            continue
        if function is not thing and not module.__name__.startswith(KERNELS):
            continue
        if name in listed if listed is not None else function.__module__ == module.__name__:
            yield name, thing


def function_text(name: str, thing: Any) -> str:
    """A function as a directive."""
    function = getattr(thing, "py_func", thing)
    return directive("function", f"{name}{call(function)}", inspect.getdoc(function))


def class_text(name: str, cls: type) -> str:
    """A class with its attributes, properties and methods."""
    is_data = dataclasses.is_dataclass(cls)
    is_settings = is_data and hasattr(getattr(cls, "__post_init__", None), "rule")
    doc = inspect.getdoc(cls) if "__doc__" in vars(cls) else ""
    if is_data and (doc or "").startswith(f"{cls.__name__}("):
        doc = ""  # made by the decorator
    body = [to_markdown(doc or "")]
    body += [directive("attribute", *row) for row in attributes(cls, is_settings)]
    init = vars(cls).get("__init__")
    if inspect.isfunction(init) and init.__doc__ and not is_data:
        body.append(to_markdown(inspect.getdoc(init) or ""))
    for key, member in vars(cls).items():
        if not key.startswith("_"):
            body.append(member_text(cls, key, member))
    inner = "\n\n".join(part for part in body if part)
    # Settings take their attributes, which are many; enumerations and protocols are not made.
    plain = is_settings or cls.__init__ is object.__init__ or issubclass(cls, enum.Enum)
    plain = plain or getattr(cls, "_is_protocol", False)
    return f":::::{{py:class}} {name}{'' if plain else call(cls)}\n\n{inner}\n:::::"


def member_text(cls: type, key: str, member: Any) -> str:
    """A property or a method as a directive; empty for anything else."""
    if isinstance(member, property):
        return directive(
            "property", key, member.__doc__, type_option(written(member.fget), "return")
        )
    if isinstance(member, classmethod | staticmethod):
        bound, kind = getattr(cls, key), type(member).__name__
        return directive("method", f"{key}{call(bound)}", inspect.getdoc(bound), f":{kind}:")
    if inspect.isfunction(member):
        head = f"{key}{call(member, bound=True)}"
        return directive("method", head, inspect.getdoc(member))
    return ""


def attributes(cls: type, is_settings: bool) -> Iterator[tuple[str, str, str]]:
    """Name, meaning and type of the fields of a NamedTuple, a dataclass or an enumeration."""
    docs, hints = setting_docs(cls) if is_settings else comments(cls), written(cls)
    fields = getattr(cls, "__dataclass_fields__", None)
    for name in fields or getattr(cls, "_fields", getattr(cls, "__members__", ())):
        unit = fields[name].metadata.get("unit") if fields else ""
        yield name, docs.get(name, "") + (f" [{unit}]" if unit else ""), type_option(hints, name)


def comments(cls: type) -> dict[str, str]:
    """The comments that stand behind the fields of a class, in its source."""
    try:
        source = inspect.getsource(cls)
    except (OSError, TypeError):
        return {}
    behind = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    found = {}
    for node in ast.parse(source).body[0].body:  # type: ignore[attr-defined]
        match node:
            case ast.AnnAssign(target=ast.Name(name)) | ast.Assign(targets=[ast.Name(name)]):
                if node.end_lineno in behind:
                    found[name] = behind[node.end_lineno]
    return found


def written(thing: Any) -> dict[str, str]:
    """The annotations of a function, or of a class and its `__init__`, as the source has them."""
    found: dict[str, str] = {}
    for one in reversed(inspect.getmro(thing)) if inspect.isclass(thing) else (thing,):
        try:
            (node,) = ast.parse(textwrap.dedent(inspect.getsource(one))).body
        except (OSError, TypeError):
            continue  # made at run time
        for part in node.body if isinstance(node, ast.ClassDef) else (node,):
            match part:
                case ast.AnnAssign(target=ast.Name(name)):
                    found[name] = ast.unparse(part.annotation)
                case ast.FunctionDef(name=name) if part is node or name == "__init__":
                    args = [k for k in ast.walk(part.args) if isinstance(k, ast.arg)]
                    found |= {k.arg: ast.unparse(k.annotation) for k in args if k.annotation}
                    found["return"] = ast.unparse(part.returns) if part.returns else ""
    return {key: text.strip("'") for key, text in found.items() if text}


def call(function: Any, bound: bool = False) -> str:
    """The arguments of a function or a class, with annotations as they are written."""
    try:
        found = inspect.signature(function)
    except (TypeError, ValueError):
        return "()"
    hints = written(function)
    each = [one.replace(annotation=hints.get(k, one.empty)) for k, one in found.parameters.items()]
    end = found.empty if inspect.isclass(function) else hints.get("return", found.empty)
    found = found.replace(parameters=each[bound:], return_annotation=end)  # without `self`
    return re.sub(r"<[^<>]*>", "...", stringify_signature(found))  # defaults that are no code


def type_option(hints: dict[str, str], name: str) -> str:
    """The option of a directive that shows an annotation as it is written; empty without one."""
    return f":type: {hints[name]}" if name in hints else ""


def directive(kind: str, head: str, doc: str | None, option: str = "") -> str:
    """A directive of Sphinx's Python domain with a docstring as its content."""
    lines = [f"::::{{py:{kind}}} {head}", *([option] if option else []), "", to_markdown(doc or "")]
    return "\n".join([*lines, "::::"])


SECTIONS = {
    "Args": "param {}", "Attributes": "ivar {}", "Raises": "raises {}", "Returns": "returns",
}  # fmt: skip


def to_markdown(doc: str) -> str:
    """A docstring in Google style as Markdown with field lists."""
    out: list[str] = []
    section = ""
    for line in inspect.cleandoc(doc).splitlines():
        if re.fullmatch(r"(Args|Attributes|Raises|Returns):", line):
            section = line[:-1]
            continue
        if section and line and not line.startswith(" "):
            section = ""
            out.append("")
        if not section:
            out.append(re.sub(r"^#+ (.*)", r"**\1**\n", line))
        elif section == "Returns":
            first = out and out[-1].startswith((":returns", "    "))
            out.append(f"    {line.strip()}" if first else f":returns: {line.strip()}")
        elif match := re.match(r" {4}([\w.*, ]+): ?(.*)", line):
            out.append(f":{SECTIONS[section].format(match[1])}: {match[2]}")
        else:
            out.append(line[4:])
    return "\n".join(out).strip()
