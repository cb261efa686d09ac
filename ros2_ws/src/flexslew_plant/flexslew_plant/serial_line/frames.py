"""Frames on a serial line: a message and its CRC-32, without zero bytes, ended by one.

COBS (Cheshire and Baker 1999, IEEE/ACM Trans. Networking 7, 159) removes the zeros: each block of
up to 254 bytes without a zero follows a byte with its length plus one. A receiver that starts in
the middle of a frame is in step again after the next zero. The CRC is that of
Ethernet and zip files.
"""

from struct import Struct
from zlib import crc32

_CRC = Struct("<I")
_BLOCK = 0xFF  # length byte of a full block, behind which no zero stands


def cobs_encoded(data: bytes) -> bytes:
    """Return bytes without a zero that stand for these, at most 1/254 longer, plus one."""
    out = bytearray()
    parts = data.split(b"\0")
    for k, part in enumerate(parts):
        while len(part) >= _BLOCK - 1:
            out.append(_BLOCK)
            out += part[: _BLOCK - 1]
            part = part[_BLOCK - 1 :]
            if not part and k == len(parts) - 1:
                return bytes(out)
        out.append(len(part) + 1)
        out += part
    return bytes(out)


def cobs_decoded(data: bytes) -> bytes | None:
    """Return the bytes that these stand for; None: they are no COBS code."""
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        block = data[at + 1 : at + code]
        if code == 0 or len(block) != code - 1 or 0 in block:
            return None
        out += block
        at += code
        if code != _BLOCK and at < len(data):
            out.append(0)
    return bytes(out)


def framed(message: bytes) -> bytes:
    """Return the frame of a message, with a zero before and after it.

    The zero before it ends what noise has left in the receiver.
    """
    return b"\0" + cobs_encoded(message + _CRC.pack(crc32(message))) + b"\0"


class Deframer:
    """Takes the bytes of a line as they come, and gives the messages of whole frames.

    Args:
        largest: of a frame [B]; a longer one is noise.

    Attributes:
        damaged: frames with a wrong checksum or code, so far.
    """

    def __init__(self, largest: int) -> None:
        self._largest, self._buffer, self.damaged = largest, bytearray(), 0
        self._skips = False  # the frame that has begun is too long

    def take(self, data: bytes) -> list[bytes]:
        """Return the messages that these bytes complete."""
        messages = []
        *ended, rest = data.split(b"\0")
        for part in ended:
            self._add(part)
            frame, skips = bytes(self._buffer), self._skips
            self._buffer.clear()
            self._skips = False
            if skips:
                self.damaged += 1
            elif frame:
                message = _checked(frame)
                if message is None:
                    self.damaged += 1
                else:
                    messages.append(message)
        self._add(rest)
        return messages

    def _add(self, part: bytes) -> None:
        if len(self._buffer) + len(part) > self._largest:
            self._skips = True
            self._buffer.clear()
        if not self._skips:
            self._buffer += part


def _checked(frame: bytes) -> bytes | None:
    """Return the message of a frame; None: it is damaged."""
    data = cobs_decoded(frame)
    if data is None or len(data) < _CRC.size:
        return None
    message, (crc,) = data[: -_CRC.size], _CRC.unpack(data[-_CRC.size :])
    return message if crc32(message) == crc else None
