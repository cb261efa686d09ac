"""Access control: one port, the page's own origin, a token; and nothing leaves the machine.

viser serves its page and its WebSocket to anybody on every interface. Both pass through the gate
here, which stands between its HTTP server and its handlers.
"""

import http
import logging
import mimetypes
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from flexslew_plant.errors import BadInput

LOOPBACK = ("127.0.0.1", "localhost")
FILES = "/run/"  # before the names of the files that the gate serves itself
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' data: blob:; worker-src 'self' blob: data:; frame-src 'self'; "
    "frame-ancestors 'self'; base-uri 'none'; form-action 'self'"
)
_SCRIPT = b"</head>"

Inner = Callable[[Any, Request], Response | None]


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
    """Lets in who knows the token and comes from the page itself.

    Args:
        port: that is listened on.
        script: JavaScript that the page runs beside its own.
        token: in the address of the page; empty: a new one.
    """

    def __init__(self, port: int, script: str = "", token: str = "") -> None:
        self.token = token or secrets.token_urlsafe(24)
        self._script = f"<script>{script}</script></head>".encode()
        self._cookie = f"flexslew_{port}"
        self.files: dict[str, Path] = {}  # by name below FILES

    def admit(self, inner: Inner, connection: Any, request: Request) -> Response | None:
        """Answer a request, or pass it on.

        Args:
            inner: what viser would answer; None lets a WebSocket in.
            connection: of the request.
            request: the first of its connection.
        """
        try:
            url = urlsplit(request.path)
        except ValueError:
            return _sealed(_answer(http.HTTPStatus.BAD_REQUEST, "text/plain", b"no address"))
        by_address = address_knows(request.path, self.token)
        if request.headers.get("Upgrade", "").lower() == "websocket":
            if not _same_origin(request.headers):
                return refused("this page comes from another origin")
            return None if by_address or self._knows(request.headers) else refused(WORDS)
        if not (by_address or self._knows(request.headers)):
            return refused(WORDS)
        if url.path.startswith(FILES):
            answer = self._file(url.path.removeprefix(FILES))
        else:
            try:
                answer = self._page(inner(connection, _plainly(request)))
            except (OSError, ValueError):  # a name that no file can have
                answer = _answer(http.HTTPStatus.NOT_FOUND, "text/plain", b"there is no such file")
        if by_address:
            value = f"{self._cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            answer.headers["Set-Cookie"] = value
        return _sealed(answer)

    def _knows(self, headers: Headers) -> bool:
        cookies: SimpleCookie = SimpleCookie()
        try:
            cookies.load("; ".join(headers.get_all("Cookie")))
        except CookieError:
            return False
        found = cookies[self._cookie].value if self._cookie in cookies else ""
        return secrets.compare_digest(found.encode(), self.token.encode())

    def _page(self, answer: Response | None) -> Response:
        """Return the page of viser with the script of this one."""
        assert answer is not None
        if not answer.headers.get("Content-Type", "").startswith("text/html"):
            return answer
        body = bytes(answer.body or b"").replace(_SCRIPT, self._script, 1)
        return _answer(http.HTTPStatus.OK, "text/html; charset=utf-8", body)

    def _file(self, name: str) -> Response:
        try:
            body = self.files[name].read_bytes()
        except (KeyError, OSError):
            return _answer(http.HTTPStatus.NOT_FOUND, "text/plain", b"there is no such file")
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        return _answer(http.HTTPStatus.OK, f"{kind}; charset=utf-8", body)


WORDS = "use the address that was printed at the start: it contains a token"


@contextmanager
def guarded_by(gate: Gate, sock: socket.socket) -> Iterator[None]:
    """Let the server that is started meanwhile listen on this socket, behind the gate.

    viser offers no way to give it a socket or a check of its own: it is handed both where it asks
    for a server.
    """
    module = websockets.asyncio.server
    original = module.serve

    def serve(handler: Any, host: str, port: int, **options: Any) -> Any:
        inner = options.pop("process_request")
        check = partial(gate.admit, inner)
        return original(handler, sock=sock, process_request=check, **options)

    module.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        module.serve = original  # type: ignore[misc]
    # who is refused is told so; the server's own log would print a traceback for each
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)


def address_knows(path: str, token: str) -> bool:
    """Return whether the path of a request names the token."""
    try:
        asked = parse_qs(urlsplit(path).query).get("token", [""])[0]
        return secrets.compare_digest(asked.encode(), token.encode())
    except ValueError:  # no address, or more fields than anybody gives
        return False


def given(headers: Headers, name: str) -> str | None:
    """Return the value of a header, or None.

    Raises:
        LookupError: it is given twice.
    """
    return headers.get(name)


def _same_origin(headers: Headers) -> bool:
    """Return whether a browser says that the page of this very address asks."""
    try:
        origin, host = given(headers, "Origin"), given(headers, "Host")
        asked = urlsplit(origin or "").netloc
    except (LookupError, ValueError):  # given twice, or no address
        return False
    return origin is not None and host is not None and asked == host


def _plainly(request: Request) -> Request:
    """Return the request with a body that can be read: viser compresses where it is asked to."""
    headers = Headers(request.headers)
    if "Accept-Encoding" in headers:
        del headers["Accept-Encoding"]
    return Request(request.path, headers)


def refused(words: str) -> Response:
    """Return the answer to those who are not let in."""
    return _sealed(_answer(http.HTTPStatus.FORBIDDEN, "text/plain; charset=utf-8", words.encode()))


def _answer(status: http.HTTPStatus, kind: str, body: bytes) -> Response:
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body))})
    return Response(status.value, status.phrase, headers, body)


def _sealed(answer: Response) -> Response:
    """Return the answer with the rules of the browser: nothing is fetched from elsewhere."""
    answer.headers["Content-Security-Policy"] = _POLICY
    answer.headers["Referrer-Policy"] = "no-referrer"
    answer.headers["X-Content-Type-Options"] = "nosniff"
    answer.headers["Cache-Control"] = "no-store"
    return answer
