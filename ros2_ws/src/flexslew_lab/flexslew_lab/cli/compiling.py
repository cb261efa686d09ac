"""Reports when the first use of a planner, a law or a testbed waits for the compiler."""

from time import monotonic

from flexslew_lab.cli.terminal import print_message
from flexslew_plant.machine_code.compile_news import add_compile_listener

_REPORT_PERIOD = 5.0  # between two lines [wall s]


class _CompileReport:
    """Counts the compiled functions and prints progress, the first time at once."""

    def __init__(self) -> None:
        self._count = 0
        self._started_at = self._last = 0.0

    def __call__(self, name: str) -> None:
        now = monotonic()
        self._count += 1
        if self._count == 1:
            self._started_at = self._last = now
            print_message(
                f"compiling machine code for a first use, from {name} on: up to a minute, once; "
                "it is kept for later runs"
            )
        elif now - self._last >= _REPORT_PERIOD:
            self._last = now
            print_message(
                f"compiling: {self._count} functions so far, {now - self._started_at:.0f} s, now "
                f"{name}"
            )


def print_compile_progress() -> None:
    """Print from now on, on standard error, that machine code is compiled, and the progress."""
    add_compile_listener(_CompileReport())
