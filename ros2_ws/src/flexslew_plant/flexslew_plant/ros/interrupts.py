"""SIGINT and SIGTERM as a KeyboardInterrupt that nothing swallows for good."""

import os
import signal
from threading import Timer

from flexslew_plant.processes.atomic import atomic
from flexslew_plant.processes.interrupted import keep_exit_code

_REPEAT = 0.3  # until it is raised once more [wall s]
_NUMBERS = (signal.SIGINT, signal.SIGTERM)


class SignalHandler:
    """Both signals end the process, also where the exception is lost on its way.

    An exception raised within a compiler's callback or a destructor is printed there and dropped;
    so the signal is repeated until `taken` is called.
    """

    def __init__(self) -> None:
        self._repeat_timer: Timer | None = None

    def install(self) -> None:
        """Handle both signals from now on."""
        for number in _NUMBERS:
            signal.signal(number, self._raise)

    def ignore(self) -> None:
        """Ignore them from now on: the process ends anyway, with an exit code of its own."""
        for number in _NUMBERS:
            signal.signal(number, signal.SIG_IGN)
        self.mark_caught()
        keep_exit_code()

    def mark_caught(self) -> None:
        """Note that the exception was caught."""
        if self._repeat_timer is not None:
            self._repeat_timer.cancel()
            self._repeat_timer = None

    def _raise(self, number: int, frame: object) -> None:
        self.mark_caught()
        self._repeat_timer = Timer(_REPEAT, os.kill, (os.getpid(), number))
        self._repeat_timer.daemon = True
        self._repeat_timer.start()
        atomic.interrupt()
