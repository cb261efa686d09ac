"""The reach of the bench over DDS: this machine alone, unless FLEXSLEW_NETWORK=1."""

import os
import sys
from collections.abc import Mapping, MutableMapping
from functools import cache
from pathlib import Path

from flexslew_plant.errors import BadInput, RunFault

SETTING = "FLEXSLEW_NETWORK"
PROFILES = Path(__file__).with_name("profiles")
LOOPBACK, NETWORK = PROFILES / "loopback.xml", PROFILES / "network.xml"
# where Fast DDS searches for the file; on Jazzy it supports the older name alone
PROFILE_VARIABLE, OLD_PROFILE_VARIABLE = (
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
)
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
# each leads a node to other machines, or adds a transport that is bound to 0.0.0.0
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
REMOTE_VARIABLES = (
    TRANSPORTS, "FASTDDS_ENVIRONMENT_FILE", "ROS2_EASY_MODE",
    "ROS_DISCOVERY_SERVER", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_SUPER_CLIENT",
)  # fmt: skip
SKIP = "SKIP_DEFAULT_XML_FILE"  # else a file of the working directory would be read, too
_ADDRESS = {"udp": "0100007F", "udp6": "00000000000000000000000001000000"}  # as in /proc/net


def on_network(environment: Mapping[str, str]) -> bool:
    """Return whether other machines may reach the bench.

    Raises:
        BadInput: FLEXSLEW_NETWORK is neither 0 nor 1.
    """
    value = environment.get(SETTING, "") or "0"
    if value not in ("0", "1"):
        raise BadInput("0 (this machine alone) or 1", key=SETTING, value=value)
    return value == "1"


def prepare(environment: MutableMapping[str, str]) -> None:
    """Set what Fast DDS reads at the first node of a process; setup/environment.sh does the same.

    Raises:
        BadInput: FLEXSLEW_NETWORK has a wrong value, or the profile is missing: Fast DDS would use
            every network without a warning.
    """
    jazzy = environment.get("ROS_DISTRO") == "jazzy"
    name, other = (
        (OLD_PROFILE_VARIABLE, PROFILE_VARIABLE)
        if jazzy
        else (PROFILE_VARIABLE, OLD_PROFILE_VARIABLE)
    )
    loopback, network = (of_jazzy(p) if jazzy else p for p in (LOOPBACK, NETWORK))
    if on_network(environment):
        # of a shell that stayed on the loopback, by whichever link
        if os.path.realpath(environment.get(name, "")) == os.path.realpath(loopback):
            for local in (name, RANGE, SKIP):
                environment.pop(local, None)
        environment.setdefault(name, str(network))
        if os.path.realpath(environment[name]) == os.path.realpath(network):
            environment[TRANSPORTS] = environment.get(TRANSPORTS) or "UDPv4"  # see loopback.xml
        return
    if not loopback.is_file():
        raise BadInput(f"{loopback}: is missing; without it DDS would use every network")
    for leading in (*REMOTE_VARIABLES, other):
        environment.pop(leading, None)
    environment.update({name: str(loopback), RANGE: "SYSTEM_DEFAULT", SKIP: "1"})


def of_jazzy(profile: Path) -> Path:
    """Return the same profile in the words of Fast DDS 2, which Jazzy has."""
    return profile.with_suffix(".jazzy.xml")


def require_loopback() -> None:
    """Refuse a process that other machines could send to; call it when its first node is there.

    Raises:
        RunFault: a UDP socket of this process is bound to more than the loopback, for example
            since Fast DDS could not read the profile.
    """
    if not on_network(os.environ):
        open_to_all = reachable_sockets(os.getpid())
        if open_to_all:
            raise RunFault(
                f"DDS accepts connections from other machines, on {', '.join(open_to_all)}, "
                f"despite {LOOPBACK}; {SETTING}=1 allows it"
            )


def reachable_sockets(pid: int) -> list[str]:
    """Return the UDP sockets of a process that are not bound to the loopback, as in /proc/net."""
    local = set()
    for handle in Path(f"/proc/{pid}/fd").iterdir():
        try:
            local.add(os.readlink(handle))
        except OSError:  # closed since
            continue
    found = []
    for kind, loopback in _ADDRESS.items():
        try:
            lines = Path(f"/proc/{pid}/net/{kind}").read_text().splitlines()[1:]
        except FileNotFoundError:  # a machine without IPv6
            continue
        for fields in map(str.split, lines):
            address, _, port = fields[1].partition(":")
            # port 0: a socket that only sends; it is bound to no address either
            if f"socket:[{fields[9]}]" in local and address != loopback:
                found.append(f"{kind} {address}:{int(port, 16)}")
    return found


@cache  # once per process
def report_network() -> None:
    """Print in one line what the network may do here, if it may do anything."""
    if on_network(os.environ):
        print(
            f"{SETTING}=1: everyone on this network can watch and command this bench",
            file=sys.stderr,
            flush=True,
        )
