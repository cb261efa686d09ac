"""A plant in a process of its own: frames over its standard input and output.

A frame is the length of a message (uint32, little-endian) and the message. Both streams are one
local socket, so that a read has a time limit without a further system call.
"""

import shlex
import socket
import struct
import subprocess
import weakref
from collections.abc import Sequence
from contextlib import suppress
from select import select
from time import monotonic

from flexslew_plant.external.messages import (
    HEADER,
    LARGEST,
    Message,
    MessageKind,
    PlantFault,
    decoded,
    encoded,
)

_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("@ll")
_EXIT_TIMEOUT = 2.0  # until a process that was asked to end is terminated, then killed [wall s]
_CHUNK = 1 << 16  # of a read [B]
_SHOWN = 40  # bytes of what is no frame, in an error


class PlantProcess:
    """Frames to and from the process of a plant.

    Args:
        command: program and arguments.
        timeout: longest wait for a frame, and for the process to take one [wall s].

    Raises:
        PlantFault: if the program cannot be started.
    """

    def __init__(self, command: Sequence[str], timeout: float) -> None:
        self.name = shlex.join(command)
        ours, theirs = socket.socketpair()
        end = theirs.fileno()
        try:
            # a session of its own: Ctrl-C is for the bench, which then ends the plant
            process = subprocess.Popen(list(command), stdin=end, stdout=end, start_new_session=True)
        except (OSError, ValueError) as error:
            ours.close()
            why = error.strerror if isinstance(error, OSError) else str(error)
            raise PlantFault(f"{self.name}: {why}") from None
        finally:
            theirs.close()
        self._socket, self._process = ours, process
        self._buffer = bytearray()
        self.set_timeout(timeout)
        self._end = weakref.finalize(self, _end, ours, process)

    @property
    def running(self) -> bool:
        """Whether its process runs."""
        return self._process.poll() is None

    @property
    def timeout(self) -> float:
        """Longest wait for a frame [wall s]."""
        return self._timeout

    def set_timeout(self, timeout: float) -> None:
        """Set the longest wait for a frame, and for the process to take one [wall s]."""
        self._timeout = timeout
        seconds, fraction = divmod(timeout, 1.0)
        limit = _TIME.pack(int(seconds), max(1, int(fraction * 1e6)))
        for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            self._socket.setsockopt(socket.SOL_SOCKET, option, limit)

    def ask(self, question: bytes, kind: MessageKind, epoch: int, tick: int) -> Message:
        """Send a question; return the next message, or to BRAKE the next one of this kind.

        Measurements may come before the answer to BRAKE from a plant with a clock of its own.

        Raises:
            PlantFault: if no answer comes within the time limit, the process has ended, or what it
                writes is no frame.
        """
        self.send(question)
        deadline = monotonic() + self._timeout
        while True:
            while (message := self._first()) is None:
                if not self._fill() or monotonic() > deadline:
                    raise PlantFault(f"{self.name}: no answer within {self._timeout:g} s")
            if message.kind == kind or kind is not MessageKind.BRAKE:
                return message

    def send(self, message: bytes) -> None:
        """Send a message.

        Raises:
            PlantFault: if the process has ended, or takes nothing for the time limit.
        """
        try:
            self._socket.sendall(_LENGTH.pack(len(message)) + message)
        except BlockingIOError:
            raise PlantFault(f"{self.name}: takes no data for {self._timeout:g} s") from None
        except OSError:
            raise PlantFault(f"{self.name}: {self._exit_words()}") from None

    def receive(self, timeout: float) -> Message | None:
        """Return the next message; None: none has come within a time [wall s].

        Raises:
            PlantFault: if the process has ended, or what it writes is no frame.
        """
        deadline = monotonic() + timeout
        while (message := self._first()) is None:
            left = max(0.0, deadline - monotonic())
            if not select([self._socket], [], [], left)[0]:
                return None
            self._fill()
        return message

    def _first(self) -> Message | None:
        """Take the first message out of the buffer; None: it is not whole yet."""
        buffer = self._buffer
        if len(buffer) < _LENGTH.size:
            return None
        size = _LENGTH.unpack_from(buffer)[0]
        if not HEADER.size <= size <= LARGEST:
            shown = bytes(buffer[:_SHOWN]).partition(b"\n")[0]
            words = f"{shown!r} on its standard output is no frame; print to stderr"
            raise PlantFault(f"{self.name}: {words}")
        end = _LENGTH.size + size
        if len(buffer) < end:
            return None
        message = decoded(bytes(buffer[_LENGTH.size : end]))
        del buffer[:end]
        return message

    def _fill(self) -> bool:
        """Read what has come; return False if nothing comes within the time limit."""
        try:
            data = self._socket.recv(_CHUNK)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        if not data:
            raise PlantFault(f"{self.name}: {self._exit_words()}")
        self._buffer += data
        return True

    def _exit_words(self) -> str:
        """Return how the process has ended."""
        with suppress(subprocess.TimeoutExpired):
            code = self._process.wait(_EXIT_TIMEOUT)
            return f"killed by signal {-code}" if code < 0 else f"its process exited with {code}"
        return "it has closed its output"

    def close(self) -> int | None:
        """End the process; return its exit status, None if it had to be killed."""
        self._end()
        code = self._process.returncode
        return None if code is None or code < 0 else code


def _end(line: socket.socket, process: "subprocess.Popen[bytes]") -> None:
    """Ask a process to end, and see that it does."""
    with suppress(OSError):
        message = encoded(MessageKind.SHUTDOWN)
        line.send(_LENGTH.pack(len(message)) + message, socket.MSG_DONTWAIT)
    with suppress(OSError):
        line.shutdown(socket.SHUT_WR)
    for end in (None, process.terminate, process.kill):
        if end is not None:
            end()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_EXIT_TIMEOUT)
            break
    line.close()
