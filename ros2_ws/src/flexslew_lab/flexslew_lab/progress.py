"""Progress of long work: what is done now, how much of it, how long so far and the time left.

A command, or a function of `import flexslew`, opens a display with `display_progress`; the parts of
the work have names by `phase`. Without a display, as in worker processes, phases print nothing. A
terminal has a bar, a notebook a line that is replaced, and any other output a line now and then.
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from datetime import timedelta
from functools import cache
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

from flexslew_lab.studies.execution.pace import RemainingTime
from flexslew_plant.machine_code.compile_news import add_compile_listener
from flexslew_plant.refusal import one_line

if TYPE_CHECKING:
    from rich.progress import Progress

_Group = TypeVar("_Group", bound=Sized)
Count = Callable[[int, int], None]  # how many are done, and of how many; 0: not known
NO_ESTIMATE = "estimating the time left"
_LINE_PERIOD = 30.0  # between two lines where nothing can be replaced [wall s]
_NOTEBOOK_PERIOD = 1.0  # between two lines of a notebook [wall s]
_STEP = 0.005  # of the time so far, between two numbers for the estimate of the time left [-]


class _Phase:
    """One part of the work: its name and how much of it is done."""

    def __init__(self, words: str, unit: str) -> None:
        self._words, self._unit = one_line(words), unit
        self.done, self.total = 0, 0
        self._pace, self._started = RemainingTime(), monotonic()
        self._last = -1.0

    def count(self, done: int, total: int) -> None:
        """Take how many are done, and of how many."""
        self.done, self.total = done, total
        elapsed = monotonic() - self._started
        if done >= total or elapsed - self._last >= _STEP * elapsed:
            self._last = elapsed
            self._pace.take(done, elapsed)

    @property
    def title(self) -> str:
        """Its name and its counts, in words."""
        counts = f"{self._unit} {self.done}" if self.done and self._unit else ""
        if self.total:
            counts = f"{self.done} of {self.total} {self._unit}"
        return ", ".join(filter(None, (self._words, counts)))

    @property
    def left(self) -> str:
        """The time left, in words; empty where nothing is counted."""
        left = self._pace.left(self.total) if self.total else None
        if left is not None:
            return f"{timedelta(seconds=round(left))} left"
        return NO_ESTIMATE if self.total else ""

    @property
    def so_far(self) -> str:
        """The time since it began, in words."""
        return f"{timedelta(seconds=round(monotonic() - self._started))} so far"


class _Display:
    """Phases that are open, the innermost last, and how they are shown."""

    def __init__(self, name: str) -> None:
        self.name, self.phases, self.notice = one_line(name), [_Phase("", "")], ""
        self._bar: Progress | None = None

    @property
    def line(self) -> str:
        """What is done now, on one line."""
        now = self.phases[-1]
        parts = (now.title, now.so_far, now.left, self.notice)
        return f"{self.name}: {', '.join(filter(None, parts))}"

    def refresh(self) -> None:
        """Show the innermost phase, where there is a bar."""
        if self._bar is not None:
            from rich.markup import escape

            now = self.phases[-1]
            title = escape(": ".join(filter(None, (self.name, now.title))))
            self._bar.update(
                self._bar.task_ids[0],
                description=title,
                completed=now.done,
                total=now.total or None,
                left=now.left,
            )

    @contextmanager
    def open(self) -> Iterator[None]:
        """Show the phases of a block."""
        from rich.progress import BarColumn, Progress, TimeElapsedColumn

        from flexslew_lab.cli.terminal import for_people, print_message

        if for_people.is_terminal and not for_people.is_jupyter:
            bar = Progress(
                "{task.description}",
                BarColumn(20),
                TimeElapsedColumn(),
                "{task.fields[left]}",
                console=for_people,
                transient=True,
                redirect_stdout=sys.stdout.isatty(),  # else what a user's code prints is a result
            )
            with bar as self._bar:
                bar.add_task("", total=None, left="")
                yield
            return
        notebook = for_people.is_jupyter
        stop = Event()
        show = _replaced_line() if notebook else print_message
        period = _NOTEBOOK_PERIOD if notebook else _LINE_PERIOD
        thread = Thread(target=self._repeat, args=(show, period, stop), daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
            if notebook:
                show("")

    def _repeat(self, show: Callable[[str], None], period: float, stop: Event) -> None:
        while not stop.wait(period):
            show(self.line)


_display: ContextVar[_Display | None] = ContextVar("display", default=None)


@contextmanager
def display_progress(name: str, unit: str = "", words: str = "") -> Iterator[Count]:
    """Show the progress of a block, and of the phases within it.

    Args:
        name: name of the work, such as that of a trial.
        unit: what is counted, such as ticks.
        words: what the block does, unless a phase within it has a name of its own.

    Returns:
        A function that takes how many are done, and of how many.
    """
    with ExitStack() as stack:
        if _display.get() is None:
            display = _Display(name)
            stack.callback(_display.reset, _display.set(display))
            stack.enter_context(display.open())
        yield stack.enter_context(phase(words, unit))


@contextmanager
def phase(words: str, unit: str = "") -> Iterator[Count]:
    """Name what a block does, for the display that is open; without one, nothing is shown.

    Args:
        words: what it does, such as `planning`.
        unit: what is counted in it.

    Returns:
        A function that takes how many are done, and of how many; 0: not known.
    """
    display = _display.get()
    if display is None:
        yield lambda done, total: None
        return
    now = _Phase(words, unit)

    def count(done: int, total: int) -> None:
        now.count(done, total)
        display.refresh()

    display.phases.append(now)
    display.refresh()
    try:
        yield count
    finally:
        display.phases.remove(now)
        display.refresh()


def count_results(groups: Iterable[_Group], total: int, words: str, unit: str) -> Iterator[_Group]:
    """Yield groups of results as they come, within a phase that counts the results.

    Args:
        groups: such as the chunks of trials that are flown.
        total: how many results there will be.
        words: what is done; see phase.
        unit: what is counted.
    """
    done = 0
    with phase(words, unit) as count:
        count(0, total)
        for group in groups:
            done += len(group)
            count(done, total)
            yield group


@contextmanager
def display_library_progress(name: str, unit: str = "", words: str = "") -> Iterator[Count]:
    """Do the same for a function of the library, with a notice when machine code is compiled."""
    _announce_compilations()
    with display_progress(name, unit, words) as count:
        yield count


class CompileReport:
    """Counts the compiled functions and prints progress, the first time at once."""

    PERIOD = 5.0  # between two lines [wall s]

    def __init__(self) -> None:
        self._count = 0
        self._started_at = self._last = 0.0

    def __call__(self, name: str) -> None:
        """Take the name of a function that is compiled now."""
        now = monotonic()
        self._count += 1
        if self._count == 1:
            self._started_at = self._last = now
            _announce(
                f"compiling machine code for a first use, from {name} on: up to a minute, once; "
                "it is kept for later runs"
            )
        elif now - self._last >= self.PERIOD:
            self._last = now
            _announce(
                f"compiling: {self._count} functions so far, {now - self._started_at:.0f} s, now "
                f"{name}"
            )


@cache
def _announce_compilations() -> None:
    add_compile_listener(CompileReport())


def _announce(words: str) -> None:
    """Print a notice; in a notebook it is part of the line that is replaced."""
    from flexslew_lab.cli.terminal import for_people, print_message

    display = _display.get()
    if for_people.is_jupyter and display is not None:
        display.notice = words
    else:
        print_message(words)


def _replaced_line() -> Callable[[str], None]:
    """Return what shows a line of a notebook in place of the one before."""
    from IPython.display import display as displayed

    untyped: Any = displayed
    handle = untyped({}, raw=True, display_id=True)  # nothing, until work takes long
    return lambda words: handle.update({"text/plain": words} if words else {}, raw=True)
