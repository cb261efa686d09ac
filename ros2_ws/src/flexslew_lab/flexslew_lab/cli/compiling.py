"""Reports when the first use of a planner, a law or a testbed waits for the compiler."""

from time import monotonic

from flexslew_lab.cli.terminal import say
from flexslew_plant.machine_code.compile_news import tell_of_compiling

_OFTEN = 5.0  # between two lines [wall s]


class _Compiling:
    """Counts the compiled functions and prints progress, the first time at once."""

    def __init__(self) -> None:
        self._count = 0
        self._began = self._last = 0.0

    def __call__(self, name: str) -> None:
        now = monotonic()
        self._count += 1
        if self._count == 1:
            self._began = self._last = now
            say(
                f"compiling machine code for a first use, from {name} on: up to a minute, once; "
                "it is kept for later runs"
            )
        elif now - self._last >= _OFTEN:
            self._last = now
            say(f"compiling: {self._count} functions so far, {now - self._began:.0f} s, now {name}")


def say_when_compiling() -> None:
    """Print from now on, on standard error, that machine code is compiled, and the progress."""
    tell_of_compiling(_Compiling())
