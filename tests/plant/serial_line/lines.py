"""Lines for tests: devices on pseudo terminals, and lines that lose, damage and delay."""

import os
import pty
import subprocess
import termios
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from select import select
from shutil import which
from threading import Thread

import numpy as np
import pytest

from flexslew_plant.serial_line.port import Port

BOARD = Path(__file__).parents[3] / "docs/examples/board"
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic")


def built(folder: Path) -> Path:
    """Return the board's program of this machine; skip without a compiler."""
    compiler = which("gcc") or which("cc")
    if compiler is None:
        pytest.skip("no C compiler here")
    program = folder / "board"
    sources = [str(BOARD / name) for name in ("line.c", "board.c", "main_posix.c")]
    subprocess.run([compiler, *STRICT, *sources, "-o", str(program)], check=True)
    return program


class PtyPort:
    """The bench's end of a pseudo terminal."""

    name = "pty"

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor

    def write(self, data: bytes) -> None:
        while data:
            data = data[os.write(self.descriptor, data) :]

    def read(self, timeout: float) -> bytes:
        ready, _, _ = select([self.descriptor], [], [], timeout)
        return os.read(self.descriptor, 4096) if ready else b""

    def close(self) -> None:
        os.close(self.descriptor)


@contextmanager
def device(
    command: Sequence[str],
) -> Iterator[tuple[PtyPort, str, "subprocess.Popen[bytes]"]]:
    """Yield a line to a running program, the path of its other end, and its process.

    Args:
        command: serves the terminal that a further argument names.
    """
    near, far = pty.openpty()
    tty.setraw(far)
    tty.setraw(near, termios.TCSANOW)
    process = subprocess.Popen([*command, os.ttyname(far)])
    try:
        yield PtyPort(near), os.ttyname(far), process
    finally:
        process.kill()
        process.wait()
        os.close(far)
        with suppress(OSError):
            os.close(near)


@contextmanager
def board(folder: Path) -> Iterator[tuple[PtyPort, str, "subprocess.Popen[bytes]"]]:
    """Yield a line to a running board in C; see device."""
    with device([str(built(folder))]) as found:
        yield found


@contextmanager
def bridged(
    command: Sequence[str],
    watch: Callable[[bytes], object] = lambda data: None,
) -> Iterator[tuple[str, "subprocess.Popen[bytes]"]]:
    """Yield the path of a serial port with a program behind it, and its process.

    Args:
        command: see device.
        watch: receives what the program sends.
    """
    with device(command) as (port, _, process):
        near, far = pty.openpty()
        tty.setraw(far)
        tty.setraw(near, termios.TCSANOW)
        end, stop = os.pipe()

        def carry() -> None:
            ends = [near, port.descriptor]
            while True:
                ready, _, _ = select([*ends, end], [], [])
                if end in ready:
                    return
                for source in ready:
                    target = ends[1 - ends.index(source)]
                    data = os.read(source, 4096)
                    if source == port.descriptor:
                        watch(data)
                    os.write(target, data)

        thread = Thread(target=carry, daemon=True)
        thread.start()
        try:
            yield os.ttyname(far), process
        finally:
            os.close(stop)
            thread.join()
            for each in (near, far, end):
                os.close(each)


class BadLine:
    """A line that loses, damages, cuts, repeats and delays what it carries, and adds noise.

    Args:
        port: to the other end.
        rng: source of all faults.
        share: of writes and reads with a fault.
    """

    def __init__(self, port: Port, rng: np.random.Generator, share: float) -> None:
        self._port, self._rng, self._share = port, rng, share
        self._late = b""  # read, not given yet
        self.name = port.name

    def write(self, data: bytes) -> None:
        self._port.write(self._spoiled(data))

    def read(self, timeout: float) -> bytes:
        data, self._late = self._late + self._port.read(timeout), b""
        if self._rng.random() < self._share:
            self._late, data = data, b""  # comes with the next ones
        return self._spoiled(data)

    def close(self) -> None:
        self._port.close()

    def _spoiled(self, data: bytes) -> bytes:
        rng = self._rng
        if not data or rng.random() >= self._share:
            return data
        at, size = int(rng.integers(len(data))), int(rng.integers(1, 20))
        match rng.integers(6):
            case 0:
                return b""
            case 1:
                return data + data
            case 2:
                return data[:at] + data[at + size :]
            case 3:
                return data[:at] + rng.bytes(size) + data[at:]
            case 4:
                return data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :]
            case _:
                return data[:at]
