import socket
import struct

import pytest

from flexslew_plant.graph import rtps
from flexslew_plant.graph.rtps import dispose


def test_the_message_of_a_leave_is_read_back_as_rtps_has_it() -> None:
    prefix = bytes(range(12))
    message = dispose(prefix)
    assert message[:8] == b"RTPS\x02\x03\x01\x0f"
    assert message[8:20] == prefix
    kind, flags, length = struct.unpack_from("<BBH", message, 20)
    assert (kind, flags, length) == (0x15, 0b11, len(message) - 24)
    to_qos, reader, writer = struct.unpack_from("<2xH4s4s", message, 24)
    assert (reader, writer) == (b"\x00\x01\x00\xc7", b"\x00\x01\x00\xc2")
    at, qos = 28 + to_qos, {}
    while (parameter := struct.unpack_from("<HH", message, at))[0] != 1:
        qos[parameter[0]] = message[at + 4 : at + 4 + parameter[1]]
        at += 4 + parameter[1]
    assert at + 4 == len(message)
    assert qos == {0x70: prefix + b"\x00\x00\x01\xc1", 0x71: b"\x00\x00\x00\x03"}


def test_who_tells_all_listens_to_this_machine_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[int, str]] = []

    class Watched(socket.socket):
        def sendto(self, *words: object) -> int:
            sent = super().sendto(*words)  # type: ignore[call-overload]
            told.append((words[-1][1], self.getsockname()[0]))  # type: ignore[index]
            return int(sent)

    monkeypatch.setattr(rtps, "socket", Watched)
    rtps.send_to_all(b"", 101)
    assert told == [(port, "127.0.0.1") for port in rtps.ports(101)]
