"""Nobody but this machine reaches the bench, however it was started, unless the user says so."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import rclpy

from flexslew_lab.run.domain import locked_domain

from .flight import LONG, Flight, slew
from .namespace import prefix

ROOT = Path(__file__).parents[2]
TRIAL = "name: short\nduration: 6\nrate_factor: 1\ncontrollers: {pd_feedforward: {}}\n"
PYTHON = [sys.executable, "-P", "-m"]
# what may stand in a shell, each of which opens a node to others by itself
HOSTILE = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_STATIC_PEERS": "10.77.0.2",
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    "FASTDDS_DEFAULT_PROFILES_FILE": "/does/not/exist.xml",
}
OPEN_TO_ALL = """<?xml version="1.0"?><dds xmlns="http://www.eprosima.com"><profiles>
<participant profile_name="open" is_default_profile="true"><rtps/></participant></profiles></dds>"""


def beside_a_stranger(
    folder: Path, words: list[str], until: str = "stranger", **environment: str
) -> dict[str, Any]:
    """Return what tests/ros/two_machines.py tells of a command, which runs in the folder."""
    (folder / "DEFAULT_FASTDDS_PROFILES.xml").write_text(OPEN_TO_ALL)  # Fast DDS looks there
    with locked_domain() as domain:
        machines = [*prefix("--net"), *PYTHON, "tests.ros.two_machines"]
        done = subprocess.run(
            [*machines, until, "env", "-C", str(folder), *words],
            env=os.environ | HOSTILE | {"ROS_DOMAIN_ID": str(domain)} | environment
            | {"PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"},
            stdout=subprocess.PIPE, text=True, check=True,
        )  # fmt: skip
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return told


def fly(folder: Path) -> list[str]:
    (folder / "short.yaml").write_text(TRIAL)
    return [*PYTHON, "flexslew_lab.cli.main", "trial", "short.yaml", "--out", "run", "--no-report"]


@pytest.mark.slow
def test_a_stranger_sees_no_node_reads_no_topic_and_commands_nothing(tmp_path: Path) -> None:
    told = beside_a_stranger(tmp_path, fly(tmp_path), "end")
    assert told["addresses"] == ["udp 0100007F"]
    assert (told["seen"], told["truths"], told["braked"], told["code"]) == ([], 0, False, 0)


@pytest.mark.ros
def test_with_one_setting_the_network_watches_and_commands(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    told = beside_a_stranger(tmp_path, fly(tmp_path), FLEXSLEW_NETWORK="1", **dict.fromkeys(
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY"), ""))  # fmt: skip
    assert "plant" in told["seen"]
    assert told["truths"]
    assert told["braked"]
    assert "udp 00000000" in told["addresses"]
    words = "FLEXSLEW_NETWORK=1: everyone on this network can watch and command this bench"
    assert capfd.readouterr().err.count(words) == 1


@pytest.mark.ros
@pytest.mark.parametrize(
    "words",
    [  # the other nodes start as the plant does
        ["flexslew_plant.ros.plant_node"],
        ["flexslew_lab.cli.main", "live", "--port", "0"],
        ["flexslew_lab.cli.main", "console", "--attach", "--port", "0"],
        ["flexslew_lab.cli.main", "console", "--port", "0"],
        ["flexslew_lab.cli.main", "brake"],
    ],
    ids=" ".join,
)
def test_the_sockets_of_every_way_to_start_are_bound_to_the_loopback(
    words: list[str], tmp_path: Path
) -> None:
    page = "live" in words or "console" in words
    told = beside_a_stranger(tmp_path, [*PYTHON, *words], "udp+tcp" if page else "udp")
    if (
        "live" in words
    ):  # the server behind the gate has an address of the loopback that nobody guesses
        assert all(address.endswith("7F") for address in told["addresses"])
    else:
        assert told["addresses"] == ["tcp 0100007F"] * page + ["udp 0100007F"]
    assert told["seen"] == []


@pytest.mark.ros
def test_the_sockets_of_a_shell_with_the_environment_of_the_bench_are_bound_to_the_loopback(
    tmp_path: Path,
) -> None:
    program = "import rclpy; rclpy.init(); n = rclpy.create_node('mine'); rclpy.spin(n)"
    shell = f'. "{ROOT}/setup/environment.sh"; exec "$@"'
    words = ["bash", "-c", shell, "bash", sys.executable, "-c", program]
    told = beside_a_stranger(tmp_path, words, "udp")
    assert (told["addresses"], told["seen"]) == (["udp 0100007F"], [])


@pytest.mark.ros
def test_a_profile_that_says_nothing_ends_the_node_before_it_serves_anybody(tmp_path: Path) -> None:
    profile = tmp_path / "loopback.xml"
    profile.write_text(OPEN_TO_ALL)
    program = (
        "from pathlib import Path; from flexslew_plant import network\n"
        f"network.LOOPBACK = Path({str(profile)!r})\n"
        "from flexslew_plant.ros.plant_node import main; main()"
    )
    done = subprocess.run(
        [*prefix("--net"), sys.executable, "-c", program],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 3
    assert "error: DDS accepts connections from other machines, on udp 00000000:" in done.stderr


@pytest.mark.ros
def test_forty_nodes_and_a_latecomer_know_each_other() -> None:
    names = [f"node_{number}" for number in range(40)] + ["latecomer"]
    contexts, nodes = [rclpy.Context() for _ in names], []
    with locked_domain() as domain:
        try:
            for context, name in zip(contexts, names, strict=True):
                rclpy.init(context=context, domain_id=domain)
                nodes.append(rclpy.create_node(name, context=context, enable_rosout=False))
            unknown = [
                (node.get_name(), name)
                for node in nodes
                for name in names
                if name not in node.get_node_names() and not node.wait_for_node(f"/{name}", 30.0)
            ]
        finally:
            for node in nodes:
                node.destroy_node()
                node.context.try_shutdown()
    assert not unknown


@pytest.mark.ros
def test_a_participant_of_the_shell_hears_the_bench(tmp_path: Path) -> None:
    program = (
        "import rclpy, sys\n"
        "rclpy.init(); node = rclpy.create_node('mine')\n"
        "while 'plant' not in node.get_node_names(): rclpy.spin_once(node, timeout_sec=0.1)\n"
        "print('heard')"
    )
    heard: list[str] = []

    def listen(pids: Any, domain: int) -> None:
        shell = f'. "{ROOT}/setup/environment.sh"; exec "$@"'
        done = subprocess.run(
            ["bash", "-c", shell, "bash", sys.executable, "-c", program],
            env=os.environ | {"ROS_DOMAIN_ID": str(domain)}, stdout=subprocess.PIPE, text=True,
            check=True,
        )  # fmt: skip
        heard.append(done.stdout)
        raise KeyboardInterrupt

    flight = Flight(slew(LONG, 1.0, extra="max_missed: 100000"), tmp_path, 1, listen)
    assert heard == ["heard\n"]
    assert flight.outcome.exit_code == 130
