"""RTPS beyond the calls of Fast DDS: count local participants, and announce that another leaves."""

import struct
from contextlib import suppress
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket

FAST_DDS = b"\x01\x0f"  # its number as a vendor of RTPS; a GUID begins with it
_LOOPBACK = "127.0.0.1"
_PARTICIPANTS = 120  # that one machine may have per domain
_LAST_NUMBER = 2**31  # greater than that of any announcement of the dead


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
    return b"RTPS" + b"\x02\x03" + FAST_DDS + prefix + data


def ports(domain: int) -> range:
    """Return the ports of announcements to participants of a domain (DDSI-RTPS 2.3, 9.6.1.1)."""
    first = 7400 + 250 * domain + 10
    return range(first, min(first + 2 * _PARTICIPANTS, 1 << 16), 2)


def count_participants(domain: int) -> int:
    """Return how many participants of a domain have sockets on this machine; 0 if unknown.

    The sockets are closed with a process that is killed, and exist before its first message. Each
    participant has two, for announcements and for data on the next port: a socket that any process
    sends from, with a port that is not its choice, is no participant.
    """
    try:
        rows = Path("/proc/net/udp").read_text().splitlines()[1:]
    except OSError:
        return 0
    bound = {int(row.split()[1].partition(":")[2], 16) for row in rows}
    return sum(port in bound and port + 1 in bound for port in ports(domain))


def send_to_all(message: bytes, domain: int) -> None:
    """Send to every participant that may be on this machine."""
    with socket(AF_INET, SOCK_DGRAM) as sender, suppress(OSError):  # no loopback: no receiver
        sender.bind((_LOOPBACK, 0))  # else others could send to it while it sends
        for port in ports(domain):
            sender.sendto(message, (_LOOPBACK, port))
