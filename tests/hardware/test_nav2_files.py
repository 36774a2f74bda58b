"""The files for nav2, RViz and Foxglove are whole, and say of the chair what its settings say."""

import json
import runpy
import sys
import types

import numpy as np
import pytest
import yaml

from tests.conftest import ROOT
from wheelchair_gym.hardware.ros.make_messages import TOPICS
from wheelchair_gym.recording import write_bags
from wheelchair_gym.recording.topics import FIELDS
from wheelchair_gym.sim.settings import ChairSettings

FOLDER = ROOT / "examples" / "ros2"
# Topics that nav2 and RViz have of their own.
THEIRS = {"/plan", "/local_costmap/costmap", "/initialpose"}
PARAMETERS = yaml.safe_load((FOLDER / "nav2.yaml").read_text())


def of(node):
    return PARAMETERS[node]["ros__parameters"]


def known(topic):
    return topic in TOPICS or topic in THEIRS or topic.rpartition("_")[0] == "/ultrasonic"


def launched(monkeypatch):
    """Return the launch file's output, with ROS packages that only note their arguments."""

    def note(name):
        return lambda *items, **more: (name, items, more)

    modules = {
        "ament_index_python.packages": {
            "get_package_share_directory": lambda name: f"/share/{name}"
        },
        "launch": {"LaunchDescription": lambda items: items},
        "launch.actions": {"DeclareLaunchArgument": note("argument")},
        "launch.conditions": {"IfCondition": note("if")},
        "launch.substitutions": {"LaunchConfiguration": note("value")},
        "launch_ros.actions": {"Node": note("node")},
    }
    for name, content in modules.items():
        monkeypatch.setitem(sys.modules, name, types.SimpleNamespace(**content))
    return runpy.run_path(str(FOLDER / "nav2.launch.py"))["generate_launch_description"]()


def test_the_launch_file_starts_every_node_with_its_parameters(monkeypatch):
    items = launched(monkeypatch)
    nodes = [more for kind, _, more in items if kind == "node"]
    arguments = {names[0] for kind, names, _ in items if kind == "argument"}
    used = {more["condition"][1][0][1][0] for more in nodes if "condition" in more}
    assert used | {"use_sim_time"} == arguments
    (manager,) = (more for more in nodes if more["package"] == "nav2_lifecycle_manager")
    servers = manager["parameters"][0]["node_names"]
    assert {f"{name}_costmap" for name in ("local", "global")} | set(servers) == set(PARAMETERS)
    for more in nodes:
        if more.get("name") in servers:
            file, lattice, sim_time = more["parameters"]
            assert file == str(FOLDER / "nav2.yaml")
            assert lattice["GridBased.lattice_filepath"].startswith("/share/nav2_smac_planner/")
            assert sim_time == {"use_sim_time": ("value", ("use_sim_time",), {})}


def test_the_parameters_are_the_chairs():
    chair = ChairSettings()
    for name in ("local_costmap", "global_costmap"):
        costmap = PARAMETERS[name][name]["ros__parameters"]
        np.testing.assert_allclose(json.loads(costmap["footprint"]), chair.footprint.corners)
        for layer in costmap["plugins"]:
            assert costmap[layer]["plugin"].startswith("nav2_costmap_2d::")
            for source in costmap[layer].get("observation_sources", "").split():
                assert costmap[layer][source]["topic"] in TOPICS
    mppi = of("controller_server")["FollowPath"]
    limits = chair.limits
    assert [mppi[key] for key in ("vx_max", "vx_min", "wz_max", "ax_max", "ax_min", "az_max")] == [
        limits.forward, -limits.backward, limits.turn, limits.acceleration, -limits.deceleration,
        limits.turn_acceleration,
    ]  # fmt: skip
    assert mppi["model_dt"] == 1.0 / of("controller_server")["controller_frequency"]
    assert set(mppi["critics"]) == {key for key in mppi if key.endswith("Critic")}
    pursuit = of("controller_server")["PurePursuit"]
    assert pursuit["desired_linear_vel"] <= limits.forward
    assert of("bt_navigator")["odom_topic"] in TOPICS


@pytest.mark.parametrize("list_", ["planner", "controller", "goal_checker", "progress_checker"])
def test_each_plugin_that_is_named_is_described(list_):
    server = of("planner_server" if list_ == "planner" else "controller_server")
    for name in server[f"{list_}_plugins"]:
        assert "::" in server[name]["plugin"]


def test_rviz_and_foxglove_show_what_is_published():
    rviz = yaml.safe_load((FOLDER / "chair.rviz").read_text())["Visualization Manager"]
    shown = [one["Topic"] for one in rviz["Displays"] if "Topic" in one]
    recorded = {*write_bags._TOPICS, *write_bags._NAMES, *FIELDS}
    assert len(shown) > 10
    for topic in shown:
        assert known(topic["Value"]) or topic["Value"] in recorded, topic
        late = topic["Durability Policy"] == "Transient Local"
        assert late <= (topic["Value"] not in TOPICS or TOPICS[topic["Value"]].latched)
    layout = json.loads((FOLDER / "foxglove.json").read_text())
    panels = layout["configById"]
    topics = set(panels["3D!world"]["topics"])
    for name in ("Plot!speed", "Plot!battery"):
        topics |= {path["value"].partition(".")[0] for path in panels[name]["paths"]}
    assert all(known(topic) or topic in recorded for topic in topics)
    text = json.dumps(layout["layout"])
    assert all(f'"{panel}"' in text for panel in panels)
