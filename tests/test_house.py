"""The house: who may import whom, settings and their files, kernels and their cache."""

import ast
import importlib.metadata
import platform
import re
import subprocess
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from tests.conftest import PACKAGES, ROOT, modules, python

# What each package may import of ours, beside itself.
ARROW = {
    "wheelchair_gym": set(),
    "planners": {"wheelchair_gym"},
    "agents": {"wheelchair_gym", "planners"},
}
# What planners may know of the chair.
FOR_PLANNERS = {"base", "compiled", "geometry", "maps", "types"}
# Third-party packages that live in one room each.
ROOMS = {
    "pymunk": ("wheelchair_gym/sim/", "wheelchair_gym/engine.py"),
    "cv2": ("wheelchair_gym/maps/", "wheelchair_gym/rendering/", "wheelchair_gym/recording/"),
    "serial": ("wheelchair_gym/hardware/",),
    "evdev": ("wheelchair_gym/hardware/",),
    "websockets": ("wheelchair_gym/hardware/",),
    "foxglove": ("wheelchair_gym/recording/",),
    "mcap": ("wheelchair_gym/recording/",),
    "rosbags": ("wheelchair_gym/recording/", "wheelchair_gym/hardware/ros/"),
    "cyclonedds": ("wheelchair_gym/hardware/ros/",),
    "torch": ("agents/",),
    "stable_baselines3": ("agents/",),
}


def imports_of(path: Path, checked: bool = True):
    """Dotted names that a file imports, anywhere in it, with or without those for type checkers."""
    tree = ast.parse(path.read_text())
    if not checked:
        tree.body = [n for n in tree.body if "TYPE_CHECKING:" not in ast.unparse(n).split("\n")[0]]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_imports_point_right_only():
    for _, path in modules():
        package = path.relative_to(ROOT).parts[0]
        for name in imports_of(path):
            top = name.split(".")[0]
            if top in PACKAGES and top != package:
                assert top in ARROW[package], f"{path} imports {name}"
            if package == "planners" and name.startswith("wheelchair_gym."):
                assert name.split(".")[1] in FOR_PLANNERS, f"{path} imports {name}"


def test_rooms_import_those_above_them_only():
    """In the order of the page."""
    page = (ROOT / "docs/concepts/architecture.md").read_text()
    order = list(dict.fromkeys(re.findall(r"^\| `wheelchair_gym/(\w+)", page, re.M)))
    for _, path in modules():
        package, room = [*path.relative_to(ROOT).with_suffix("").parts, ""][:2]
        if package == "wheelchair_gym" and not room.startswith("__"):
            above = order[: order.index(room) + 1]
            for name in imports_of(path, checked=False):
                package, other = [*name.split("."), ""][:2]
                known = package != "wheelchair_gym" or other in above or other not in order
                assert known, f"{path} imports {name}"


def test_each_engine_lives_in_its_room():
    for _, path in modules():
        where = path.relative_to(ROOT).as_posix()
        for name in imports_of(path):
            rooms = ROOMS.get(name.split(".")[0])
            assert rooms is None or where.startswith(rooms), f"{where} imports {name}"


def test_importing_env_and_pictures_loads_neither_torch_nor_planners_nor_pygame():
    code = (
        "import sys, gymnasium, wheelchair_gym.rendering; "
        "gymnasium.make('wheelchair_gym/Navigation-v1'); "
        "print({'torch', 'stable_baselines3', 'planners', 'agents', 'matplotlib', 'pygame'} "
        "& set(sys.modules))"
    )
    out = python(code)
    assert out.stdout.strip() == "set()", out.stderr


AWAY = """
import contextlib, io, sys
def loaded(*argv):
    from agents.cli import main
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            code = main(argv)
        except SystemExit as end:
            code = end.code
    assert code in (0, None), (argv, code)
    return {name for name in ("torch", "stable_baselines3", "sb3_contrib") if name in sys.modules}
import planners, wheelchair_gym, wheelchair_gym.envs, wheelchair_gym.rendering
from agents.cli import COMMANDS
for command in ((), *(tuple(part.name.split()) for part in COMMANDS)):
    assert not loaded(*command, "--help"), command
ways = "--start", "2,2", "--goal", "13,8"
assert not loaded("plan", "--map", sys.argv[1], "--planner", "visibility", *ways), "plan"
assert not loaded("simulate", "--scene", "empty", "--policy", "ppo_goal"), "simulate"
assert not loaded("settings", "lattice"), "settings"
"""


def test_commands_that_neither_train_nor_export_load_no_torch():
    from wheelchair_gym.scenes.map_file import example_map

    out = python(AWAY, example_map())
    assert out.returncode == 0, out.stderr


def test_what_is_used_beyond_its_interface_has_an_upper_bound():
    """Private modules, structs and code generation may change with any minor version."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    bounds = {r.name: r.specifier for r in map(Requirement, project["dependencies"])}
    bounds["python"] = SpecifierSet(project["requires-python"])
    here = {name: importlib.metadata.version(name) for name in bounds if name != "python"}
    here["python"] = platform.python_version()
    for name, allowed in bounds.items():
        assert here[name] in allowed, name
    for name in ("numba", "pymunk", "torch", "gymnasium", "python"):
        assert "99" not in bounds[name], f"{name} has no upper bound"


def test_nothing_speaks_of_where_it_was_made():
    """No absolute path of a machine in anything that is committed."""
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.split()
    assert not listed or "README.md" in listed
    kinds = {".py", ".md", ".toml", ".json", ".yaml", ".c", ".h", ""}
    for path in map(ROOT.joinpath, listed):
        if path.suffix in kinds and path.is_file():
            found = re.search(r"(?<![\w.])/(?:work|home|root|Users)/\w+", path.read_text())
            assert found is None, f"{path}: {found.group()}"


def test_shipped_configs_are_the_defaults():
    """configs/*.json are the values that the dataclasses have, for people to copy and change."""
    from tests.configs import DEFAULTS
    from wheelchair_gym.base.settings import dump, read_json

    shipped = {path.stem: read_json(path) for path in (ROOT / "configs").glob("*.json")}
    assert shipped == {name: dump(value) for name, value in DEFAULTS.items()}
