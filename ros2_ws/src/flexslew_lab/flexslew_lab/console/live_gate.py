"""The gate before the Foxglove server: which clients may connect to it at all.

The server's library has no check of its own: any page that a browser of this machine shows could
open it. It therefore listens where no page finds it, at one of 2^24 addresses of the loopback, and
the gate, where clients expect it, passes on those that it has let in.
"""

import asyncio
import http
import logging
import secrets
from collections.abc import Collection
from contextlib import suppress
from threading import Thread
from typing import Any

from websockets.asyncio.client import connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from flexslew_lab.console.gate import WORDS, address_has_token, host_headers, listening
from flexslew_plant.errors import BadInput

HOST = "127.0.0.1"  # never another one
ORIGINS = ("https://app.foxglove.dev",)  # pages of Foxglove's own
_PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
_MAX_ORIGINS = 16  # foreign origins that are named, of a page that may invent as many as it likes


def hidden_address() -> str:
    """Return a loopback address that cannot be guessed."""
    return ".".join(map(str, (127, *secrets.token_bytes(2), 1 + secrets.randbelow(254))))


class LiveGate:
    """Passes clients on that know the token and come from no foreign page.

    Args:
        port: on 127.0.0.1 to listen on; 0: any free one.
        origins: of pages that are let in besides Foxglove's own.

    Attributes:
        address: what a person gives to Foxglove.
        server_host: where the server is to listen.

    Raises:
        BadInput: the port cannot be opened, or an origin is none.
    """

    def __init__(self, port: int, origins: Collection[str] = ()) -> None:
        for origin in origins:
            scheme, mark, rest = origin.partition("://")
            if not (scheme and mark and rest) or "/" in rest:
                raise BadInput(f"--origin: {origin!r} is not allowed: for example https://HOST")
        self._origins = {*ORIGINS, *origins}
        self._sock = listening(HOST, port, "live")
        self._port = int(self._sock.getsockname()[1])
        self._token = secrets.token_urlsafe(24)
        self.address = f"ws://{HOST}:{self._port}/?token={self._token}"
        self.server_host = hidden_address()
        self._rejected_origins: list[str] = []
        self._report_count = 0
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever, daemon=True)

    def open(self, server_port: int) -> None:
        """Let clients in, to the server at this port of its host."""
        self._server_address = f"ws://{self.server_host}:{server_port}"
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._serve(), self._loop).result()

    def rejected_origins(self) -> list[str]:
        """Return the origins of pages that were refused since the last call, each once."""
        found, self._report_count = (
            self._rejected_origins[self._report_count :],
            len(self._rejected_origins),
        )
        return found

    def close(self) -> None:
        """End all connections."""
        if self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        self._loop.close()
        self._sock.close()

    async def _serve(self) -> None:
        # a refused client receives the reason; the log would hold a traceback for each
        quiet = logging.getLogger("websockets.server")
        quiet.setLevel(logging.CRITICAL)
        self._server = await serve(
            self._pass_on, sock=self._sock, process_request=self._check_request,
            subprotocols=_PROTOCOLS, compression=None, max_size=None, logger=quiet,  # type: ignore[arg-type]
        )  # fmt: skip

    async def _end(self) -> None:
        self._server.close()
        await self._server.wait_closed()

    def _check_request(self, connection: Any, request: Request) -> Response | None:
        """Return why a client is refused; None lets it in."""
        try:
            host, origin = request.headers.get("Host"), request.headers.get("Origin")
        except LookupError:
            return _reject_response("a header is given twice")
        if host not in (*host_headers(HOST, self._port), *host_headers("localhost", self._port)):
            return _reject_response(
                "the request names another host"
            )  # led here by another DNS server
        if origin is not None and origin not in self._origins:
            if origin not in self._rejected_origins and len(self._rejected_origins) < _MAX_ORIGINS:
                self._rejected_origins.append(origin)
            return _reject_response("this page comes from another origin")
        return None if address_has_token(request.path, self._token) else _reject_response(WORDS)

    async def _pass_on(self, client: ServerConnection) -> None:
        protocols: Any = [client.subprotocol] if client.subprotocol else None
        with suppress(ConnectionClosed, OSError):
            async with connect(
                self._server_address, subprotocols=protocols, compression=None, max_size=None,
                proxy=None,
            ) as server:  # fmt: skip
                tasks = {
                    asyncio.ensure_future(_copy(client, server)),
                    asyncio.ensure_future(_copy(server, client)),
                }
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                for way in tasks:
                    way.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)


async def _copy(source: Any, target: Any) -> None:
    with suppress(ConnectionClosed):
        async for message in source:
            await target.send(message)


def _reject_response(words: str) -> Response:
    """Return the answer to refused clients."""
    status, body = http.HTTPStatus.FORBIDDEN, words.encode()
    headers = {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))}
    return Response(status.value, status.phrase, Headers(headers), body)
