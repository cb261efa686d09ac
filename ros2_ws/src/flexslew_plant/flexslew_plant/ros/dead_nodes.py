"""Nodes whose process has died: they are taken off the graph, since they cannot do so themselves.

DDS goes on sending to a process that was killed until its lease is over (20 s). With Fast DDS 3.2
each of these messages creates a port in shared memory and removes it again, and two senders that do
so at the same moment hold each other up for 2 s (SharedMemGlobal::open_port_internal).
"""

import os
import struct
from functools import cache
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket

from rclpy.node import Node

from flexslew_plant import topics
from flexslew_plant.bench.operation.presence import Beat, Presence

_EVERY = 0.1  # between two looks [wall s]; Fast DDS gives up a port after 1 s
_FAST_DDS = b"\x01\x0f"  # its number as a vendor of RTPS; a GUID begins with it
_PARTICIPANTS = 120  # that one machine may have per domain
_LAST_NUMBER = 2**31  # greater than that of any announcement of the dead


class DeadNodes:
    """Takes the dead off the graph of all processes of this machine.

    Args:
        node: that looks.
        presence: who gave signs of life.
    """

    def __init__(self, node: Node, presence: Presence) -> None:
        self._node, self._presence = node, presence
        self._next = 0.0  # [wall s]
        self._gone: set[int] = set()  # instances

    def poll(self, now: float) -> None:
        """Look for the dead if it is time."""
        if now < self._next:
            return
        self._next = now + _EVERY
        for beat in self._presence.overdue(now):
            if beat.instance in self._gone or not died(beat.process):
                continue
            prefixes = self._prefixes(beat)
            for prefix in prefixes:
                _tell_all(dispose(prefix), self._node.context.get_domain_id())
            if not prefixes:  # done, or it took its leave itself
                self._gone.add(beat.instance)

    def _prefixes(self, beat: Beat) -> set[bytes]:
        """Return the GUID prefixes that a dead node still has on the graph.

        Fast DDS writes the last 16 bits of the process id into them (GuidUtils), which tells the
        dead one from another of its name.
        """
        topic = self._node.resolve_topic_name(topics.ALIVE)
        low = (int(beat.process.split("/")[1]) & 0xFFFF).to_bytes(2, "little")
        wanted = beat.node, self._node.get_namespace(), _FAST_DDS, low
        found = set()
        for info in self._node.get_publishers_info_by_topic(topic):
            gid = bytes(info.endpoint_gid)
            if (info.node_name, info.node_namespace, gid[:2], gid[4:6]) == wanted:
                found.add(gid[:12])
        return found


def process() -> str:
    """Return what this process is known by: boot and PID namespace/id; empty: by nothing."""
    return f"{_where()}/{os.getpid()}" if _where() else ""


def died(identity: str) -> bool:
    """Return whether a process of this machine and PID namespace has certainly ended."""
    where, _, number = identity.partition("/")
    if not number.isdecimal() or not where or where != _where():
        return False
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    except OSError:
        return False
    return state in "ZX"


def dispose(prefix: bytes) -> bytes:
    """Return the RTPS message by which a participant leaves (DDSI-RTPS 2.3, 8.5.3 and 9.6.3).

    Args:
        prefix: of its GUID, 12 bytes.
    """
    writer, reader = b"\x00\x01\x00\xc2", b"\x00\x01\x00\xc7"  # of announcements
    guid = prefix + b"\x00\x00\x01\xc1"
    key_hash = struct.pack("<HH", 0x70, 16) + guid
    status = struct.pack("<HH", 0x71, 4) + b"\x00\x00\x00\x03"  # disposed, unregistered
    end = struct.pack("<HH", 1, 0)
    number = struct.pack("<iI", 0, _LAST_NUMBER)
    body = struct.pack("<HH", 0, 16) + reader + writer + number + key_hash + status + end
    data = struct.pack("<BBH", 0x15, 0b11, len(body)) + body  # little-endian, with inline QoS
    return b"RTPS" + b"\x02\x03" + _FAST_DDS + prefix + data


def _tell_all(message: bytes, domain: int) -> None:
    """Send to every participant that may be on this machine (DDSI-RTPS 2.3, 9.6.1.1)."""
    with socket(AF_INET, SOCK_DGRAM) as sender:
        for number in range(_PARTICIPANTS):
            port = 7400 + 250 * domain + 10 + 2 * number
            if port < 1 << 16:
                sender.sendto(message, ("127.0.0.1", port))


@cache
def _where() -> str:
    """Return this boot of this machine, and the PID namespace; empty where /proc does not say."""
    try:  # the first namespace has the same number on every machine
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}:{os.readlink('/proc/self/ns/pid')}"
    except OSError:
        return ""
