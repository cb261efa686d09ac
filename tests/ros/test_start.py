"""What ROS makes of a command line, before any node is there."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy

from flexslew_plant.errors import BadInput
from flexslew_plant.network import LOOPBACK, NETWORK
from flexslew_plant.ros.start import start_ros

DOCS = Path(__file__).parents[2] / "docs"
COMMANDS = [
    line
    for page in ("ros2/start_nodes.md", "installation.md", "own_controller.md")
    for line in (DOCS / page).read_text().splitlines()
    if "--ros-args" in line and line.startswith(("ros2 run", "python -m"))
]


THREADS = """
import os, rclpy
from flexslew_plant.network import LOOPBACK, NETWORK
from flexslew_plant.ros.start import start_ros
start_ros()
node = rclpy.create_node("one")
for thread in os.listdir("/proc/self/task"):
    print(open(f"/proc/self/task/{thread}/comm").read().strip())
node.destroy_node()
rclpy.try_shutdown()
"""


@pytest.mark.slow
def test_no_process_looks_up_types_over_the_graph() -> None:
    command = [sys.executable, "-P", "-c", THREADS]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    threads = set(done.stdout.split())
    assert any(name.startswith("dds.udp") for name in threads)
    assert not [name for name in threads if name.startswith("dds.tls")]
    for profile in (LOOPBACK, NETWORK):  # which opens the network, and is only read here
        assert "<name>fastdds.type_propagation</name><value>disabled</value>" in profile.read_text()


@pytest.mark.parametrize("command", COMMANDS)
def test_ros_takes_every_command_line_of_the_docs(command: str) -> None:
    context = rclpy.Context()
    start_ros(context=context, args=shlex.split(command))
    context.shutdown()


def test_the_docs_tell_how_to_start_each_node() -> None:
    assert len(COMMANDS) >= 9
    assert {word for line in COMMANDS for word in line.split()} >= {"plant", "planner", "recorder"}


@pytest.mark.parametrize(
    ("given", "words"),
    [("plan:={goal: 1}", "in quotes of its own"), ("kp:=", "kp:="), ("kp", "'-p kp'")],
)
def test_a_parameter_that_ros_cannot_read_is_refused_in_words(given: str, words: str) -> None:
    with pytest.raises(BadInput, match="parameter override rule") as refused:
        start_ros(context=rclpy.Context(), args=["--ros-args", "-p", given])
    assert words in str(refused.value)


def test_a_process_whose_log_folder_cannot_be_written_has_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    settings = ({"HOME": "/proc"}, {"ROS_HOME": "/proc/ros"}, {"ROS_LOG_DIR": f"{tmp_path}/file"})
    for setting in settings:
        with monkeypatch.context() as patch:
            for name in ("ROS_HOME", "ROS_LOG_DIR"):
                patch.delenv(name, raising=False)
            for name, value in setting.items():
                patch.setenv(name, value)
            for args in ([], ["--ros-args", "-p", "kp:=1.0"]):
                context = rclpy.Context()
                start_ros(context=context, args=args)
                rclpy.create_node("one", context=context).destroy_node()
                context.shutdown()
