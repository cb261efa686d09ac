"""Who may reach the bench: the same rule in a shell and in Python, and it fails closed."""

import os
import socket
import subprocess
from itertools import product
from pathlib import Path

import pytest

from flexslew_plant import network
from flexslew_plant.errors import BadInput, RunFault
from flexslew_plant.network import (
    LOOPBACK,
    NETWORK,
    OLD_PROFILE_VARIABLE,
    PROFILE_VARIABLE,
    RANGE,
    REMOTE_VARIABLES,
    SKIP,
    TRANSPORTS,
    of_jazzy,
)

ROOT = Path(__file__).parents[2]
READ = (PROFILE_VARIABLE, OLD_PROFILE_VARIABLE, RANGE, SKIP, *REMOTE_VARIABLES)
OUTER = [
    {},
    {RANGE: "LOCALHOST"},
    {RANGE: "SUBNET", "ROS_STATIC_PEERS": "192.0.2.1"},
    {PROFILE_VARIABLE: "/mine.xml", RANGE: "SUBNET"},
    {PROFILE_VARIABLE: "/does/not/exist.xml", OLD_PROFILE_VARIABLE: "/mine.xml"},
    {"ROS_LOCALHOST_ONLY": "1", TRANSPORTS: "UDPv6"},
    {PROFILE_VARIABLE: str(NETWORK), TRANSPORTS: ""},
    {PROFILE_VARIABLE: "/mine.xml", TRANSPORTS: "SHM"},
    {"ROS_DISCOVERY_SERVER": "192.0.2.1:11811", "ROS_SUPER_CLIENT": "TRUE"},
    {"ROS2_EASY_MODE": "192.0.2.1", "FASTDDS_ENVIRONMENT_FILE": "/mine.json"},
    {PROFILE_VARIABLE: str(LOOPBACK), RANGE: "SYSTEM_DEFAULT", SKIP: "1"},
    {OLD_PROFILE_VARIABLE: str(of_jazzy(LOOPBACK)), RANGE: "SYSTEM_DEFAULT", SKIP: "1"},
]


def by_shell(environment: dict[str, str]) -> dict[str, str]:
    """Return what setup/environment.sh makes of an environment, of what DDS reads."""
    done = subprocess.run(
        ["bash", "-c", 'set -eu; . "$1"; env -0', "bash", ROOT / "setup" / "environment.sh"],
        env={"PATH": os.environ["PATH"], "FLEXSLEW_INSTALLED_ROS": "yes"} | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    pairs = (line.split("=", 1) for line in done.stdout.split("\0") if line)
    return {name: value for name, value in pairs if name in READ}


@pytest.mark.first(6)
@pytest.mark.parametrize("setting", [None, "0", "1"])
@pytest.mark.parametrize("outer", OUTER)
def test_a_shell_and_python_read_the_setting_alike(
    outer: dict[str, str], setting: str | None
) -> None:
    for distribution in ("kilted", "jazzy"):
        given = outer | {"ROS_DISTRO": distribution}
        if setting is not None:
            given[network.SETTING] = setting
        ours = dict(given)
        network.prepare(ours)
        requested = {name: ours[name] for name in READ if name in ours}
        assert _resolved(by_shell(given)) == _resolved(requested)


def _resolved(values: dict[str, str]) -> dict[str, str]:
    """Return paths without links: an installed module may be a link into the source."""
    return {
        name: os.path.realpath(value) if value.startswith("/") else value
        for name, value in values.items()
    }


@pytest.mark.parametrize(("outer", "distribution"), list(product(OUTER, ("kilted", "jazzy"))))
def test_nothing_in_the_environment_leads_elsewhere_unless_the_setting_says_so(
    outer: dict[str, str], distribution: str
) -> None:
    environment = outer | {"ROS_DISTRO": distribution}
    network.prepare(environment)
    name, other = (
        (PROFILE_VARIABLE, OLD_PROFILE_VARIABLE)
        if distribution == "kilted"
        else (OLD_PROFILE_VARIABLE, PROFILE_VARIABLE)
    )
    assert {key: environment.get(key) for key in (*READ,)} == dict.fromkeys(REMOTE_VARIABLES) | {
        name: str(LOOPBACK if distribution == "kilted" else of_jazzy(LOOPBACK)),
        other: None,
        RANGE: "SYSTEM_DEFAULT",
        SKIP: "1",
    }


@pytest.mark.parametrize("profile", [LOOPBACK, NETWORK])
def test_the_profiles_of_jazzy_say_the_same_in_the_words_of_its_fast_dds(profile: Path) -> None:
    """Fast DDS 2 throws a file away that has a word of Fast DDS 3; .ci/jazzy flies with it."""
    text = profile.read_text()
    assert text.count("heartbeat_period") == 2
    assert of_jazzy(profile).read_text() == text.replace("heartbeat_period", "heartbeatPeriod")


def test_the_network_is_what_the_user_has_set_up_or_the_profile_of_the_bench() -> None:
    mine = {network.SETTING: "1", PROFILE_VARIABLE: "/mine.xml", "ROS_STATIC_PEERS": "192.0.2.1"}
    environment = dict(mine)
    network.prepare(environment)
    assert environment == mine
    environment = {network.SETTING: "1"}
    network.prepare(environment)
    ours = {network.SETTING: "1", PROFILE_VARIABLE: str(NETWORK)}
    assert environment == ours | {TRANSPORTS: "UDPv4"}
    for named, taken in (("LARGE_DATA", "LARGE_DATA"), ("", "UDPv4")):
        environment = {network.SETTING: "1", TRANSPORTS: named}
        network.prepare(environment)
        assert environment == ours | {TRANSPORTS: taken}


@pytest.mark.parametrize("value", ["yes", "true", "2", " 1", "no"])
def test_another_value_of_the_setting_is_refused(value: str) -> None:
    with pytest.raises(BadInput, match="FLEXSLEW_NETWORK") as refusal:
        network.prepare({network.SETTING: value})
    assert repr(value) in str(refusal.value)
    with pytest.raises(subprocess.CalledProcessError):
        by_shell({network.SETTING: value})


def test_a_missing_profile_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "LOOPBACK", tmp_path / "loopback.xml")
    before = {RANGE: "LOCALHOST"}
    environment = dict(before)
    with pytest.raises(BadInput, match="is missing; without it DDS would use every network"):
        network.prepare(environment)
    assert environment == before


def test_a_missing_profile_is_refused_by_the_shell(tmp_path: Path) -> None:
    script = tmp_path / "setup" / "environment.sh"
    script.parent.mkdir()
    script.write_bytes((ROOT / "setup" / "environment.sh").read_bytes())
    done = subprocess.run(
        ["bash", "-c", 'set -e; . "$1"; echo goes on', "bash", script],
        env={"PATH": os.environ["PATH"]}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert "loopback.xml is missing" in done.stderr


@pytest.mark.parametrize(
    ("kind", "address", "open_to_all"),
    [
        (socket.AF_INET, "127.0.0.1", False),
        (socket.AF_INET, "0.0.0.0", True),
        (socket.AF_INET6, "::1", False),
        (socket.AF_INET6, "::", True),
    ],
)
def test_a_socket_that_others_could_send_to_is_found_and_refused(
    kind: int, address: str, open_to_all: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(network.SETTING, raising=False)
    with socket.socket(kind, socket.SOCK_DGRAM) as own:
        own.bind((address, 0))
        port = own.getsockname()[1]
        found = network.reachable_sockets(os.getpid())
        assert any(word.endswith(f":{port}") for word in found) == open_to_all
        if open_to_all:
            with pytest.raises(RunFault, match=f":{port}, "):
                network.require_loopback()
            monkeypatch.setenv(network.SETTING, "1")
        network.require_loopback()
