"""A bench on a machine, a stranger on another one that is wired to it: two network namespaces.

`python -m tests.ros.two_machines UNTIL WORDS`, in a network namespace of its own, runs a command
and prints as JSON to which addresses its sockets were bound (`udp 0100007F`), and what the stranger
saw and could do.
"""

import json
import os
import selectors
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import IO, Any

import rclpy
from flexslew_msgs.msg import PlantState
from std_srvs.srv import Trigger

from flexslew_plant.network import (
    OLD_PROFILE_VARIABLE,
    PROFILE_VARIABLE,
    RANGE,
    REMOTE_VARIABLES,
    SKIP,
)
from tests.present import present

HERE, THERE = "10.77.0.1", "10.77.0.2"
_PATIENCE = 60.0  # for a command to open its sockets [wall s]
_KINDS = ("udp", "udp6", "tcp", "tcp6")
_LISTENS = "0A"  # state of a TCP socket in /proc/net

# its own /dev/shm, as another machine has; it waits for the wire
_NEIGHBOUR = f"""
mount -t tmpfs tmpfs /dev/shm
echo wire
read -r _
ip link set lo up && ip address add {THERE}/24 dev there && ip link set there up
exec "$@"
"""


def bound() -> set[str]:
    """Return the local addresses of this network namespace's sockets that hear, as /proc/net."""
    found = set()
    for kind in _KINDS:
        for line in Path(f"/proc/net/{kind}").read_text().splitlines()[1:]:
            _, local, _, state, *_ = line.split()
            if kind.startswith("udp") or state == _LISTENS:
                found.add(f"{kind} {local.partition(':')[0]}")
    return found


@contextmanager
def wire(words: list[str]) -> Iterator["subprocess.Popen[str]"]:
    """Yield a command that runs on the other machine."""
    for command in (
        "ip link set lo up",
        "ip link add here type veth peer name there",
        f"ip address add {HERE}/24 dev here",
        "ip link set here up",
    ):
        subprocess.run(command.split(), check=True)
    with subprocess.Popen(
        ["unshare", "--net", "--mount", "sh", "-ec", _NEIGHBOUR, "sh", *words],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as other:  # fmt: skip
        assert present(other.stdout).readline() == "wire\n"
        subprocess.run(["ip", "link", "set", "there", "netns", str(other.pid)], check=True)
        yield other


def stranger() -> None:
    """Look for a bench by static peers until it is braked and read, or nobody waits any more."""
    print("looking", flush=True)
    seen: set[str] = set()
    truths: list[Any] = []
    selector = selectors.DefaultSelector()
    selector.register(sys.stdin, selectors.EVENT_READ)
    rclpy.init()
    node = rclpy.create_node("stranger")
    node.create_subscription(PlantState, "/truth", truths.append, 10)
    brake = node.create_client(Trigger, "/brake")
    asked = None
    in_hand = False
    while not in_hand and not selector.select(0.0):
        rclpy.spin_once(node, timeout_sec=0.1)
        seen |= {*node.get_node_names()} - {"stranger"}
        if asked is None and brake.service_is_ready():
            asked = brake.call_async(Trigger.Request())
        # a service may answer before the name of its node has come
        in_hand = asked is not None and asked.done() and bool(truths) and "plant" in seen
    braked = asked is not None and asked.done() and asked.result().success
    print(json.dumps({"seen": sorted(seen), "truths": len(truths), "braked": braked}), flush=True)
    os._exit(0)


def run(words: list[str], until: str) -> dict[str, Any]:
    """Run a command beside the stranger.

    Args:
        words: of the command.
        until: `stranger`, who has the bench in hand; `end` of the command; `udp` or `udp+tcp`, when
            it listens there.
    """
    look = [
        "env",
        *(
            f"--unset={name}"
            for name in (PROFILE_VARIABLE, OLD_PROFILE_VARIABLE, RANGE, SKIP, *REMOTE_VARIABLES)
        ),
    ]
    look += [f"ROS_STATIC_PEERS={HERE}", f"{RANGE}=SUBNET", sys.executable, "-m", __spec__.name]
    with wire([*look, "look"]) as other:
        asks = present(other.stdin)
        asks.write("\n")
        asks.flush()
        assert present(other.stdout).readline() == "looking\n"
        addresses: set[str] = set()
        with subprocess.Popen(words, start_new_session=True) as bench:
            end = monotonic() + _PATIENCE
            while bench.poll() is None and other.poll() is None:
                addresses |= bound()
                heard = {address.split()[0].rstrip("6") for address in addresses}
                if until not in ("stranger", "end") and (
                    heard >= {*until.split("+")} or monotonic() > end
                ):
                    break
                _rest(present(other.stdout))
            addresses |= bound()
            if bench.poll() is None:
                bench.send_signal(signal.SIGINT)
        told, _ = other.communicate("\n")
    return {"addresses": sorted(addresses), "code": bench.returncode, **json.loads(told)}


def _rest(stream: IO[str]) -> None:
    """Wait a moment, less when somebody speaks."""
    with selectors.DefaultSelector() as selector:
        selector.register(stream, selectors.EVENT_READ)
        selector.select(0.02)


if __name__ == "__main__":
    if sys.argv[1] == "look":
        stranger()
    else:
        print(json.dumps(run(sys.argv[2:], until=sys.argv[1])))
