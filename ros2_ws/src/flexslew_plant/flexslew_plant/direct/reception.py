"""Where processes of one machine and user call."""

import socket
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from flexslew_plant.direct.line import DirectLine, facts

_WAITING = 16  # that call at the same moment


class ListenerSocket:
    """Takes calls; as long as another process listens there, it has none.

    Args:
        address: of the socket, see names.
    """

    def __init__(self, address: bytes) -> None:
        self._address = address
        self._socket: socket.socket | None = None
        self._pending: list[DirectLine] = []  # that have not sent their facts
        self._listen()

    @property
    def handshake_pending(self) -> bool:
        """Whether a caller has called and has not sent anything yet."""
        return bool(self._pending)

    def callers(self) -> Iterator[tuple[DirectLine, dict[str, Any]]]:
        """Yield a line to each process of this user that has called, and the facts it has sent."""
        self._pending += self._calls()
        for line in list(self._pending):
            data = line.receive()
            if data is not None or line.closed:
                self._pending.remove(line)
            if data is not None:
                yield line, facts(data)

    def _calls(self) -> Iterator[DirectLine]:
        if self._socket is None:
            self._listen()
        with suppress(OSError):
            while self._socket is not None:
                line = DirectLine(self._socket.accept()[0])
                if line.same_user:
                    yield line
                else:
                    line.close()

    def _listen(self) -> None:
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            listener.bind(self._address)
            listener.listen(_WAITING)
            listener.setblocking(False)
            self._socket = listener
        except OSError:  # another one that has not left yet
            listener.close()
