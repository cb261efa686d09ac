"""Nobody else reaches the bench, whatever the shell says of discovery, peers and transports."""

from pathlib import Path

import numpy as np
import pytest

from flexslew_plant.network import OLD_PROFILE_VARIABLE, PROFILE_VARIABLE, RANGE, SKIP
from tests.ros.test_network import HOSTILE, OPEN_TO_ALL, PYTHON, beside_a_stranger

pytestmark = pytest.mark.ros

SHELL: dict[str, tuple[str, ...]] = {  # what may stand in one; empty: nothing is there
    RANGE: ("", "OFF", "LOCALHOST", "SUBNET", "SYSTEM_DEFAULT", "everybody"),
    "ROS_LOCALHOST_ONLY": ("", "0", "1"),
    "ROS_STATIC_PEERS": ("", "10.77.0.2", "10.77.0.2;127.0.0.1", "nobody"),
    "ROS_DISCOVERY_SERVER": ("", "10.77.0.2:11811", ";10.77.0.1:11811"),
    "ROS_SUPER_CLIENT": ("", "TRUE"),
    "FASTDDS_BUILTIN_TRANSPORTS": ("", "UDPv4", "UDPv6", "LARGE_DATA", "P2P", "SHM"),
    "FASTDDS_ENVIRONMENT_FILE": ("", "/does/not/exist.json"),
    "ROS2_EASY_MODE": ("", "10.77.0.2"),
    SKIP: ("", "0", "1"),
    PROFILE_VARIABLE: ("", "/does/not/exist.xml", "open.xml"),
    OLD_PROFILE_VARIABLE: ("", "open.xml"),
}
STARTS = (
    "flexslew_plant.ros.plant_node", "flexslew_control.ros.controller_node",
    "flexslew_control.ros.planner_node",
)  # fmt: skip


@pytest.mark.share(0.2)
def test_no_shell_opens_the_bench_to_a_stranger(tmp_path: Path, case: np.random.Generator) -> None:
    (tmp_path / "open.xml").write_text(OPEN_TO_ALL)
    shell = {name: values[case.integers(len(values))] for name, values in SHELL.items()}
    assert HOSTILE.keys() <= shell.keys()
    node = STARTS[case.integers(len(STARTS))]
    told = beside_a_stranger(tmp_path, [*PYTHON, node], "udp", **shell)
    assert (told["addresses"], told["seen"]) == (["udp 0100007F"], [])
