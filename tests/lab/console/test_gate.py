"""The gate before the page: one port, a token, the page's own origin, nothing from elsewhere."""

import asyncio
import re
import socket
from collections.abc import Iterator
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from flexslew_lab.console.gate import Gate, Receive, Scope, Send
from flexslew_lab.console.gate import answer as answered
from flexslew_lab.console.server import ConsoleServer
from flexslew_plant.errors import BadInput

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


@pytest.fixture(scope="module")
def server() -> Iterator[ConsoleServer]:
    found = ConsoleServer("127.0.0.1", 0, print)
    yield found
    found.close()


def asked(server: ConsoleServer, path: str, **headers: str) -> tuple[HTTPResponse, bytes]:
    connection = HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer, answer.read()


def opened(server: ConsoleServer, origin: str | None, cookie: str) -> int:
    """Return the status of a WebSocket's handshake; 101 lets it in."""
    try:
        with connect(
            f"ws://127.0.0.1:{server.port}{SOCKET}",
            origin=Origin(origin) if origin else None,
            additional_headers={"Cookie": cookie},
        ):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


def test_the_page_opens_with_its_token_alone_and_hands_out_a_cookie(server: ConsoleServer) -> None:
    for path in ("/", "/?token=", "/?token=wrong", "/index.html", "/run/report.html"):
        answer, _ = asked(server, path)
        assert answer.status == 403, path
        assert answer.headers["Set-Cookie"] is None
    assert server.gate.token in server.address
    answer, body = asked(server, server.address.partition(str(server.port))[2])
    assert answer.status == 200
    assert b"keydown" in body
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    again, _ = asked(server, "/", Cookie=cookie.partition(";")[0])
    assert again.status == 200


def test_a_foreign_origin_or_no_token_gets_403(server: ConsoleServer) -> None:
    own, cookie = f"http://127.0.0.1:{server.port}", f"flexslew_{server.port}={server.gate.token}"
    assert opened(server, own, cookie) == 101
    for origin in ("http://evil.example", "http://127.0.0.1:1", "null", None):
        assert opened(server, origin, cookie) == 403, origin
    for wrong in ("", f"flexslew_{server.port}=wrong", f"flexslew_1={server.gate.token}", ";=;;"):
        assert opened(server, own, wrong) == 403, wrong


def test_the_browser_is_told_to_fetch_nothing_from_elsewhere(server: ConsoleServer) -> None:
    answer, _ = asked(server, f"/?token={server.gate.token}")
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert answer.headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil:80"])
def test_a_request_for_another_host_gets_403(server: ConsoleServer, host: str) -> None:
    """A name that a stranger's DNS leads here."""
    assert asked(server, f"/?token={server.gate.token}", Host=host)[0].status == 403
    assert (
        asked(server, f"/?token={server.gate.token}", Host=f"localhost:{server.port}")[0].status
        == 200
    )


@pytest.mark.parametrize(("port", "let_in"), [(80, True), (8080, False)])
def test_at_the_usual_port_a_browser_names_the_host_alone(port: int, let_in: bool) -> None:
    async def inner(scope: Scope, receive: Receive, send: Send) -> None:
        await answered(send, 200, b"the page")

    async def send(message: Any) -> None:
        statuses.append(message.get("status"))

    async def receive() -> Any:
        return {}

    statuses: list[Any] = []
    gate = Gate(inner, "127.0.0.1", port, "secret")
    own = [(b"host", b"127.0.0.1"), (b"origin", b"http://127.0.0.1")]
    scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"token=secret"}
    asyncio.run(gate({**scope, "headers": own}, receive, send))
    assert statuses[0] == (200 if let_in else 403)


def test_a_foreign_page_reads_and_posts_nothing(server: ConsoleServer) -> None:
    cookie = f"flexslew_{server.port}={server.gate.token}"
    own = f"http://127.0.0.1:{server.port}"
    poll = SOCKET.replace("websocket", "polling")
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1"):
        for path in ("/", poll):
            assert asked(server, path, Cookie=cookie, Origin=origin)[0].status == 403
    assert asked(server, poll, Cookie=cookie, Origin=own)[0].status == 200
    connection = HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("POST", poll, "40", {"Cookie": cookie})
    assert connection.getresponse().status == 403  # no browser posts without an origin


def test_everything_that_the_page_names_is_on_this_server(server: ConsoleServer) -> None:
    _, body = asked(server, f"/?token={server.gate.token}")
    named = re.findall(r'(?:src|href|url|from)\s*[=(]?\s*["\'(]+([^"\')]+)', body.decode())
    assert any(one.startswith("/_nicegui/") for one in named)
    assert not [one for one in named if "//" in one]


def test_files_are_served_by_name_and_no_other(server: ConsoleServer, tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text("<p>it flew</p>")
    server.gate.files["report.html"] = report
    key = f"?token={server.gate.token}"
    answer, body = asked(server, f"/run/report.html{key}")
    assert (answer.status, body) == (200, b"<p>it flew</p>")
    for name in ("other.html", "../report.html", "%2e%2e/report.html", ""):
        assert asked(server, f"/run/{name}{key}")[0].status == 404, name


def test_a_port_that_is_taken_is_refused_and_no_other_one_is_opened() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = holder.getsockname()[1]
        with pytest.raises(BadInput, match=f"127.0.0.1 port {port} cannot be opened"):
            ConsoleServer("127.0.0.1", port, print)


def test_only_the_loopback_is_listened_on(server: ConsoleServer) -> None:
    listening = []
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        _, local, _, state, *_ = line.split()
        address, port = local.split(":")
        if state == "0A" and int(port, 16) == server.port:
            listening.append(address)
    assert listening == ["0100007F"]


@pytest.mark.parametrize(
    "path",
    ["//[", "//[/?token={t}", "/%00?token={t}", "/" + "x" * 5000 + "?token={t}",
     "/" + "a/" * 2000 + "?token={t}", "/%ff%fe?token={t}", "/?token=%ff", "/..%2f..%2f?token={t}",
     "/?" + "&".join("x" * 2000), "/run/%00?token={t}"],
)  # fmt: skip
def test_no_address_is_answered_with_an_error_of_the_server(
    server: ConsoleServer, path: str
) -> None:
    answer, _ = asked(server, path.replace("{t}", server.gate.token))
    assert answer.status in (200, 400, 403, 404)


@pytest.mark.parametrize("origin", ["http://[", "//[::1", "http://[x]:1"])
def test_an_origin_that_is_no_address_is_refused(server: ConsoleServer, origin: str) -> None:
    assert opened(server, origin, f"flexslew_{server.port}={server.gate.token}") == 403
