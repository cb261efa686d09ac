"""Access control: one port, the page's own origin, a token; and nothing leaves the machine."""

import mimetypes
import secrets
import socket
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from contextlib import suppress
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import LARGEST, MIB

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
FILES = "/run/"  # before the names of the files that the gate serves itself
WORDS = "use the address that was printed at the start: it contains a token"
_RULES = (
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
        b"style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        b"connect-src 'self' data: blob:; worker-src 'self' blob: data:; frame-src 'self'; "
        b"frame-ancestors 'self'; base-uri 'none'; form-action 'self'",
    ),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)
_HTTP_PORT = 80  # port of http and ws
_STORED = b"/_nicegui/"  # below it stand files of the page that never change: they may be kept

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
Inner = Callable[[Scope, Receive, Send], Awaitable[None]]


def listening(host: str, port: int, what: str = "console") -> socket.socket:
    """Return a socket that listens on this port and on no other one; 0 takes any.

    Args:
        host: address.
        port: of it.
        what: listens, for the error.

    Raises:
        BadInput: it cannot be had.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((host, port))
        found.listen(64)
    except (OSError, OverflowError) as error:
        found.close()
        why = getattr(error, "strerror", None) or str(error)
        raise BadInput(f"{what}: {host} port {port} cannot be opened: {why}") from None
    return found


class Gate:
    """ASGI gate: admits requests with the token, for this host, from the page itself.

    Args:
        inner: application that answers admitted requests.
        host: address on which the server listens.
        port: port on which the server listens.
        token: token in the address of the page; empty: a new one.
    """

    def __init__(self, inner: Inner, host: str, port: int, token: str = "") -> None:
        self.token = token or secrets.token_urlsafe(24)
        self._inner, self._cookie = inner, f"flexslew_{port}"
        local = host.startswith("127.") or host in ("localhost", "::1")
        names = {*LOOPBACK, f"[{host}]" if ":" in host else host}
        # elsewhere a machine has names that it does not know itself
        self._hosts = (
            {host for name in names for host in host_headers(name, port)} if local else None
        )
        self.files: dict[str, Path] = {}  # by name below FILES

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "lifespan":
            return
        by_address = _query_has_token(scope.get("query_string", b""), self.token)
        why = self._reject_reason(scope, by_address)
        if scope["type"] == "websocket":
            if why:
                await _close(scope, receive, send, why)
            else:
                await self._inner(scope, receive, send)
            return
        cookie = f"{self._cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        safe_send = _with_security_headers(scope, send, cookie if by_address and not why else "")
        if why:
            await answer(safe_send, 403, why.encode())
        elif scope.get("method") not in ("GET", "HEAD") and not _is_short(scope):
            await answer(safe_send, 413, f"at most {LARGEST // MIB} MiB are taken".encode())
        elif scope["path"].startswith(FILES):
            await self._file(scope["path"].removeprefix(FILES), safe_send)
        else:
            await self._inner(scope, receive, safe_send)

    def _reject_reason(self, scope: Scope, by_address: bool) -> str:
        """Return why a request is refused; empty lets it in."""
        try:
            host, origin = (header(scope, name) for name in ("host", "origin"))
            candidate = urlsplit(origin or "").netloc
        except (LookupError, ValueError):  # given twice, or no address
            return "a header is given twice or cannot be read"
        if host is None or (self._hosts is not None and host not in self._hosts):
            return "the request names another host"  # a name that a stranger's DNS led here
        is_write = scope["type"] == "websocket" or scope.get("method") not in ("GET", "HEAD")
        if candidate != host and (is_write or origin is not None):
            return "this page comes from another origin"
        return "" if by_address or self._has_token(scope) else WORDS

    def _has_token(self, scope: Scope) -> bool:
        cookies: SimpleCookie = SimpleCookie()
        with suppress(CookieError):
            cookies.load("; ".join(_headers(scope, "cookie")))
        found = cookies[self._cookie].value if self._cookie in cookies else ""
        return secrets.compare_digest(found.encode(), self.token.encode())

    async def _file(self, name: str, send: Send) -> None:
        try:
            body = self.files[name].read_bytes()
        except (KeyError, OSError):
            await answer(send, 404, b"there is no such file")
            return
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        await answer(send, 200, body, f"{kind}; charset=utf-8")


def host_headers(name: str, port: int) -> tuple[str, ...]:
    """Return the Host headers of clients for a name and a port; the usual port may be left out."""
    return (f"{name}:{port}", name) if port == _HTTP_PORT else (f"{name}:{port}",)


def address_has_token(path: str, token: str) -> bool:
    """Return whether the path of a request names the token."""
    try:
        return _query_has_token(urlsplit(path).query.encode(), token)
    except ValueError:  # no address
        return False


def _query_has_token(query: bytes, token: str) -> bool:
    try:
        candidate = parse_qs(query.decode("latin-1"), max_num_fields=100).get("token", [""])[0]
        return secrets.compare_digest(candidate.encode(), token.encode())
    except ValueError:  # more fields than anybody gives
        return False


def _is_short(scope: Scope) -> bool:
    """Return whether a request states its length, and is no longer than the largest file."""
    try:
        return 0 <= int(header(scope, "content-length") or "") <= LARGEST + MIB
    except (LookupError, ValueError):
        return False


def header(scope: Scope, name: str) -> str | None:
    """Return the value of a header, or None.

    Raises:
        LookupError: it is given twice.
    """
    found = list(_headers(scope, name))
    if len(found) > 1:
        raise LookupError(name)
    return found[0] if found else None


def _headers(scope: Scope, name: str) -> Iterable[str]:
    requested = name.encode()
    return (value.decode("latin-1") for key, value in scope["headers"] if key.lower() == requested)


async def answer(
    send: Send, status: int, body: bytes, kind: str = "text/plain; charset=utf-8"
) -> None:
    """Send a whole answer."""
    headers = [(b"content-type", kind.encode()), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def _with_security_headers(scope: Scope, send: Send, cookie: str) -> Send:
    """Return a send that adds the rules of the browser: nothing is fetched from elsewhere."""
    kept = scope["path"].encode(errors="replace").startswith(_STORED)

    async def send_with_headers(message: Any) -> None:
        if message["type"] == "http.response.start":
            headers = [
                (k, v) for k, v in message.get("headers", ()) if kept or k != b"cache-control"
            ]
            more = [] if kept else [(b"cache-control", b"no-store")]
            more += [(b"set-cookie", cookie.encode())] if cookie else []
            message = {**message, "headers": [*headers, *_RULES, *more]}
        await send(message)

    return send_with_headers


async def _close(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    """Refuse a WebSocket before its handshake, with the reason where the server can send one."""
    await receive()
    if "websocket.http.response" not in scope.get("extensions", {}):
        await send({"type": "websocket.close"})  # 403
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *_RULES]
    await send({"type": "websocket.http.response.start", "status": 403, "headers": headers})
    await send({"type": "websocket.http.response.body", "body": why.encode()})
