"""Ctrl-C: one line and exit code 130, in the first seconds of imports and in the last of a run."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from flexslew_plant.processes.atomic import atomic

SIGNAL_EXIT_CODE = 130  # exit code
EXIT_TIMEOUT = 1.5  # until the process ends, for any cause of delay [wall s]
NODES_EXIT_TIMEOUT = 30.0  # the same where files have to be closed [wall s]
_patience = EXIT_TIMEOUT
_received = False


def set_import_handler() -> None:
    """End at once when interrupted, without the traceback of an import cut short."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _end_at_once)


@contextmanager
def while_running() -> Iterator[None]:
    """Raise KeyboardInterrupt when interrupted, and end by force if it is not handled in time.

    Code below a callback of compiled code may swallow it. The handler of the signal before the
    block is restored after it: a program that calls the command line keeps its own way of ending.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    global _received
    _received = False
    before = signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def interrupts_only() -> Iterator[None]:
    """Raise KeyboardInterrupt in place of the error that compiled code makes of it.

    An interrupt within a call of compiled code leaves a Python object unset, and what is reported
    is the TypeError or SystemError of its first use.
    """
    try:
        yield
    except Exception as error:
        if _received:
            raise KeyboardInterrupt from error
        raise


@contextmanager
def exit_timeout(seconds: float) -> Iterator[None]:
    """Give a block more time to end in order: nodes that have to close their files [wall s]."""
    global _patience
    before, _patience = _patience, seconds
    try:
        yield
    finally:
        _patience = before


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _received
    _received = True
    signal.signal(signal.SIGINT, _end_at_once)  # a second one does not wait
    timer = threading.Timer(_patience, _end_at_once, (number, None))
    timer.daemon = True
    timer.start()
    atomic.interrupt()


def _end_at_once(number: int, frame: FrameType | None) -> None:
    sys.stdout.flush()
    os.write(2, b"interrupted\n")
    os._exit(SIGNAL_EXIT_CODE)
