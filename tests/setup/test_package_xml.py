"""What a package says that it needs is what it imports: rosdep installs that, and no more."""

import ast
from pathlib import Path
from xml.etree import ElementTree

import pytest

from flexslew_plant.graph.topics import TOPICS

SOURCES = Path(__file__).parents[2] / "ros2_ws" / "src"
PACKAGES = ["flexslew_plant", "flexslew_control", "flexslew_lab"]
# of ROS 2, with a key of rosdep of the same name; what else is imported is in the lock
OF_ROS = {
    "ament_index_python", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "launch",
    "launch_ros", "nav_msgs", "rcl_interfaces", "rclpy", "rosgraph_msgs", "sensor_msgs", "std_msgs",
    "std_srvs", "tf2_msgs", "trajectory_msgs", "visualization_msgs",
}  # fmt: skip
# called as commands or plugins, not imported
CALLED = {"ros2launch", "rosbag2_storage_mcap"}


def needed(package: str, kind: str = "exec_depend") -> set[str]:
    root = ElementTree.parse(SOURCES / package / "package.xml").getroot()
    return {str(element.text) for element in root.iter(kind)}


def imported(package: str) -> set[str]:
    found = set()
    for path in (SOURCES / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {name.name.split(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(str(node.module).split(".")[0])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_needs_what_it_imports_of_ros_and_of_the_bench(package: str) -> None:
    here = {"flexslew_msgs", *PACKAGES} - {package}
    assert needed(package) - CALLED == imported(package) & (OF_ROS | here)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_python_package_is_left_to_apt(package: str) -> None:
    """Ubuntu 24.04 has pydantic 1.10 and no plotly for rosdep: they come from the lock."""
    python = {name for name in needed(package) if name.startswith("python3-")}
    assert not python


def test_the_messages_of_all_topics_are_of_packages_that_are_needed() -> None:
    everything = set().union(*map(needed, PACKAGES))
    assert {topic.type.split("/")[0] for topic in TOPICS.values()} <= everything
