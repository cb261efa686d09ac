"""The one message of RTPS that Fast DDS offers no call for: another participant leaves."""

import struct
from contextlib import suppress
from socket import AF_INET, SOCK_DGRAM, socket

FAST_DDS = b"\x01\x0f"  # its number as a vendor of RTPS; a GUID begins with it
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


def tell_all(message: bytes, domain: int) -> None:
    """Send to every participant that may be on this machine (DDSI-RTPS 2.3, 9.6.1.1)."""
    with socket(AF_INET, SOCK_DGRAM) as sender, suppress(OSError):  # no loopback: nobody is there
        for number in range(_PARTICIPANTS):
            port = 7400 + 250 * domain + 10 + 2 * number
            if port < 1 << 16:
                sender.sendto(message, ("127.0.0.1", port))
