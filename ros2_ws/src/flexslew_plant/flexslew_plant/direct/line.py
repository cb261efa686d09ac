"""One end of a line: whole messages in their order, without waiting for the other end."""

import json
import os
import select
import socket
import struct
from collections import deque
from contextlib import suppress
from time import monotonic
from typing import Any

from flexslew_plant.graph.topics import LOOP_DEPTH

SLICE = 0.002  # for which a process waits for a message before it reads the graph [wall s]
# for which it polls again and again before it sleeps [wall s]: to be woken on another core takes
# longer than a tick does, and most laws answer sooner
_POLL_TIME = 0.0002
_ATTEMPTS = 4  # of a microsecond each, before it reads the clock and yields the processor
LARGEST = 1 << 15  # of a message [B]
_TIME = struct.Struct("@ll")
_PEER = struct.Struct("@3i")  # pid, uid, gid (unix(7), SO_PEERCRED)
_PEERCRED = getattr(socket, "SO_PEERCRED", 17)
_NOW = socket.MSG_DONTWAIT


class DirectLine:
    """A connected socket of whole messages (SOCK_SEQPACKET).

    Args:
        connected: the connected socket.
        kept: most messages stored for an end that takes none; the oldest are lost, as in DDS.

    Attributes:
        eager: wait awake: a process waits for the response of this end to the next message, and no
            receiver of copies of it needs the processor.
        closed: the other end is gone, or was not understood.
    """

    def __init__(self, connected: socket.socket, kept: int = LOOP_DEPTH) -> None:
        connected.setblocking(True)
        wait = _TIME.pack(0, round(SLICE * 1e6))
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
        self._socket = connected
        self._queue: deque[bytes] = deque(maxlen=kept)
        self._soon = False  # the last message that was waited for came within _AWAKE
        self.eager, self.closed = True, False

    @property
    def same_user(self) -> bool:
        """Whether the other end is a process of the user of this one."""
        size = _PEER.size
        _, user, _ = _PEER.unpack(self._socket.getsockopt(socket.SOL_SOCKET, _PEERCRED, size))
        return bool(user == os.getuid())

    @property
    def queue_size(self) -> int:
        """How many messages the other end has still to take."""
        return len(self._queue)

    def send(self, data: bytes) -> None:
        """Send a message, or keep it until the other end takes more."""
        if self._queue:
            self._queue.append(data)
            self.flush()
            return
        try:
            self._socket.send(data, _NOW)
        except BlockingIOError:
            self._queue.append(data)
        except OSError:
            self.close()

    def flush(self) -> None:
        """Send what was kept, as far as the other end takes it."""
        try:
            while self._queue:
                self._socket.send(self._queue[0], _NOW)
                self._queue.popleft()
        except BlockingIOError:
            return
        except OSError:
            self.close()

    def receive(self, wait: float = 0.0) -> bytes | None:
        """Return the next message; None: there is none yet, or there will be none any more.

        Args:
            wait: for it, no longer than SLICE [wall s].
        """
        if self.closed:
            return None
        try:
            if wait >= SLICE:
                data = self._wait_for_message()
            else:
                if wait > 0.0:
                    select.select([self._socket], [], [], wait)
                data = self._socket.recv(LARGEST, _NOW)
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        if not data:
            self.close()
        return data or None

    def _wait_for_message(self) -> bytes:
        """Return the next message; an eager end waits awake for it if the last one came soon.

        Raises:
            BlockingIOError: none came within SLICE.
        """
        start = monotonic()
        take = self._socket.recv
        while self._soon and self.eager:
            for _ in range(_ATTEMPTS):
                try:
                    return take(LARGEST, _NOW)
                except BlockingIOError:
                    continue
            self._soon = monotonic() < start + _POLL_TIME
            os.sched_yield()  # other processes go first
        try:
            return take(LARGEST, 0)
        finally:
            self._soon = monotonic() < start + _POLL_TIME

    def notify(self, words: dict[str, Any]) -> None:
        """Send a few facts."""
        self.send(json.dumps(words).encode())

    def close(self) -> None:
        """Hang up."""
        self.closed = True
        self._queue.clear()
        with suppress(OSError):
            self._socket.close()


def facts(data: bytes) -> dict[str, Any]:
    """Return the facts that `say` has sent; {} for any other data."""
    with suppress(ValueError, RecursionError):
        found = json.loads(data)
        if isinstance(found, dict):
            return found
    return {}


def call(address: bytes, kept: int = LOOP_DEPTH) -> DirectLine | None:
    """Return a line to the listener at an address, of this very user; None without one."""
    connected = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        connected.setblocking(False)
        connected.connect(address)
        line = DirectLine(connected, kept)
        if line.same_user:
            return line
    except OSError:
        pass
    connected.close()
    return None
