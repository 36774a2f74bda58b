"""nav2 drives the chair: planner, controller, recoveries and behaviour tree, with nav2.yaml.

ros2 launch nav2.launch.py [use_sim_time:=true] [rosbridge:=true] [rviz:=true]
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = Path(__file__).parent
PRIMITIVES = "sample_primitives/5cm_resolution/0.5m_turning_radius/diff/output.json"
SERVERS = {
    "planner_server": "nav2_planner",
    "controller_server": "nav2_controller",
    "behavior_server": "nav2_behaviors",
    "bt_navigator": "nav2_bt_navigator",
}


def generate_launch_description():
    """The nodes; nav2's lifecycle manager starts them in this order."""
    sim_time = {"use_sim_time": LaunchConfiguration("use_sim_time")}
    lattice = Path(get_package_share_directory("nav2_smac_planner")) / PRIMITIVES
    parameters = [str(HERE / "nav2.yaml"), {"GridBased.lattice_filepath": str(lattice)}, sim_time]
    nodes = [
        Node(package=package, executable=name, name=name, output="screen", parameters=parameters)
        for name, package in SERVERS.items()
    ]
    manager = {"autostart": True, "node_names": list(SERVERS), **sim_time}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value="false")
                for name in ("use_sim_time", "rosbridge", "rviz")
            ),
            *nodes,
            Node(
                package="nav2_lifecycle_manager", executable="lifecycle_manager",
                name="lifecycle_manager_navigation", output="screen", parameters=[manager],
            ),
            Node(
                package="rosbridge_server", executable="rosbridge_websocket",
                condition=IfCondition(LaunchConfiguration("rosbridge")),
            ),
            Node(
                package="rviz2", executable="rviz2", arguments=["-d", str(HERE / "chair.rviz")],
                parameters=[sim_time], condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )  # fmt: skip
