"""Who may talk to the Foxglove server: every combination of Host, Origin and token."""

import socket
from collections.abc import Iterator
from itertools import product

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

from flexslew_lab.console.live_gate import ORIGINS, LiveGate
from flexslew_plant.errors import BadInput

MINE = "https://plots.example"
PROTOCOL = Subprotocol("foxglove.sdk.v1")


@pytest.fixture(scope="module")
def gate() -> Iterator[tuple[LiveGate, int]]:
    """A gate before a server that sends everything back, and the port of that server."""
    from threading import Thread

    found = LiveGate(0, [MINE])
    assert found.server_host.startswith("127.")

    def echo(connection: ServerConnection) -> None:
        for message in connection:
            connection.send(message)

    with serve(echo, found.server_host, 0, subprotocols=[PROTOCOL]) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        port = server.socket.getsockname()[1]
        found.open(port)
        yield found, port
        found.close()
        server.shutdown()
        thread.join()


def port_of(gate: LiveGate) -> int:
    return int(gate.address.rpartition(":")[2].partition("/")[0])


def answer(gate: LiveGate, path: str, *headers: str) -> int:
    """Return the status of a handshake with these headers, as they stand."""
    lines = [
        f"GET {path} HTTP/1.1", *headers, "Upgrade: websocket", "Connection: Upgrade",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Protocol: {PROTOCOL}",
    ]  # fmt: skip
    with socket.create_connection(("127.0.0.1", port_of(gate)), timeout=20.0) as raw:
        raw.sendall("\r\n".join([*lines, "", ""]).encode("latin-1"))
        return int(raw.recv(12).split()[1])


HOSTS = {
    "Host: 127.0.0.1:{port}": True,
    "Host: localhost:{port}": True,
    "Host: 127.0.0.1": False,
    "Host: evil.example:{port}": False,
    "Host: 127.0.0.1:{port}\r\nHost: evil.example": False,
    "Host: 127.0.0.1:{port}.evil.example": False,
    "X: no host at all": False,
}
CALLERS = {
    "X: no page": True,
    f"Origin: {ORIGINS[0]}": True,
    f"Origin: {MINE}": True,
    "Origin: https://evil.example": False,
    f"Origin: {ORIGINS[0]}.evil.example": False,
    "Origin: http://127.0.0.1:{port}": False,
    "Origin: null": False,
    f"Origin: {ORIGINS[0]}\r\nOrigin: https://evil.example": False,
}
PATHS = {
    "/?token={token}": True,
    "/": False,
    "/?token=": False,
    "/?token={token}x": False,
    "/?token={half}": False,
    "/?token=wrong&token={token}": False,
    "/{token}": False,
}


def test_only_the_right_host_origin_and_token_together_are_let_in(
    gate: tuple[LiveGate, int],
) -> None:
    found, _ = gate
    token = found.address.partition("token=")[2]
    known = {"port": port_of(found), "token": token, "half": token[:16]}
    for (host, a), (caller, b), (path, c) in product(HOSTS.items(), CALLERS.items(), PATHS.items()):
        status = answer(found, path.format(**known), host.format(**known), caller.format(**known))
        assert (status == 101) == (a and b and c), (host, caller, path, status)
        assert status in (101, 403, 400)


def test_what_a_client_says_and_hears_passes_unchanged(gate: tuple[LiveGate, int]) -> None:
    found, _ = gate
    with connect(found.address, subprotocols=[PROTOCOL], proxy=None, max_size=None) as client:
        assert client.subprotocol == PROTOCOL
        for message in ("text", b"", bytes(range(256)), "ä" * 70_000, b"x" * 900_000):
            client.send(message)
            assert client.recv(20.0) == message


def test_nobody_finds_the_server_behind_the_gate(gate: tuple[LiveGate, int]) -> None:
    _, port = gate
    for host in ("127.0.0.1", "localhost", "::1"):
        with pytest.raises(OSError, match=r"Errno \d+"):
            socket.create_connection((host, port), timeout=5.0)
    assert len({LiveGate(0).server_host for _ in range(20)}) == 20


def test_a_client_that_knows_no_protocol_of_the_server_is_refused(
    gate: tuple[LiveGate, int],
) -> None:
    found, _ = gate
    with pytest.raises(InvalidStatus), connect(found.address, proxy=None):
        pass


def test_foreign_origins_are_named_once_and_not_without_end() -> None:
    gate = LiveGate(0)
    gate.open(9)
    host = f"Host: 127.0.0.1:{port_of(gate)}"
    try:
        for number in (1, 1, 2):
            answer(gate, "/", host, f"Origin: https://{number}.example")
        assert gate.rejected_origins() == ["https://1.example", "https://2.example"]
        for number in range(100):
            answer(gate, "/", host, f"Origin: https://{number}.evil.example")
        assert len(gate.rejected_origins()) == 14
    finally:
        gate.close()


@pytest.mark.parametrize("origin", ["*", "evil.example", "https://", "https://a.example/path", ""])
def test_an_origin_that_is_none_is_refused(origin: str) -> None:
    with pytest.raises(BadInput, match="--origin"):
        LiveGate(0, [origin])


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = holder.getsockname()[1]
        with pytest.raises(BadInput, match=f"live: 127.0.0.1 port {port} cannot be opened"):
            LiveGate(port)
