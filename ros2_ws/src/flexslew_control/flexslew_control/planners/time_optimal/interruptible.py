"""Ctrl-C while a solver holds the process.

CasADi takes an interrupt for a point that it cannot evaluate, and goes on from another one. So the
signal is kept away from it, the solver is made to stop at its next iteration, and the interrupt is
raised where Python can handle it.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """Whether an interrupt has arrived."""

    def __init__(self) -> None:
        """Start without one."""
        self.received = False

    def note(self, number: int, frame: FrameType | None) -> None:
        """Note that it arrived; what signal.signal calls."""
        self.received = True

    def check(self, iteration: int = 0) -> None:
        """Raise KeyboardInterrupt if it arrived; what a solver calls at every iteration."""
        if self.received:
            raise KeyboardInterrupt


@contextmanager
def interruptible(interrupt: Interrupt) -> Iterator[None]:
    """Note SIGINT while the block runs, and raise it at the block's end, however it ends.

    Other threads than the main one never see the signal, so nothing changes there.

    Args:
        interrupt: what the solver in the block checks.

    Raises:
        KeyboardInterrupt: it arrived.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, interrupt.note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if interrupt.received:
            if callable(before) and before is not signal.default_int_handler:
                signal.raise_signal(signal.SIGINT)  # for the handler before
            interrupt.check()
