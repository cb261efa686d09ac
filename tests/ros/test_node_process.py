"""The command line of a node."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy
from ament_index_python.packages import get_package_prefix

from flexslew_plant.ros.node_process import namespace_arguments

DOCS = sorted((Path(__file__).parents[2] / "docs").rglob("*.md"))
STARTS = [line for page in DOCS for line in page.read_text().splitlines() if "--ros-args" in line]


def test_a_namespace_becomes_a_command_line() -> None:
    assert namespace_arguments("") == []
    assert (
        namespace_arguments("bench1")
        == namespace_arguments("/bench1/")
        == ["--ros-args", "-r", "__ns:=/bench1"]
    )


@pytest.mark.parametrize("line", sorted({one for one in STARTS if one.startswith("ros2 run ")}))
def test_every_node_that_a_page_starts_is_there_and_ros_reads_its_arguments(line: str) -> None:
    _, _, package, program, *arguments = shlex.split(line)
    assert (Path(get_package_prefix(package)) / "lib" / package / program).exists()
    context = rclpy.Context()
    context.init([program, *arguments])
    context.shutdown()


@pytest.mark.slow
def test_arguments_that_ros_cannot_read_are_refused_in_one_line() -> None:
    node = [sys.executable, "-P", "-m", "flexslew_control.ros.planner_node", "--ros-args"]
    done = subprocess.run(
        [*node, "-p", "plan:={goal: {mass: 1.0}}"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("error: ")
    assert "in quotes of its own" in last
