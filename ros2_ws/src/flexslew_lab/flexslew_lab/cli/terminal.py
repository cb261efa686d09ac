"""What all subcommands say to people: progress, tables, short values."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

screen = Console(stderr=True)  # for people; standard output is for results


@contextmanager
def progress(name: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar for the time of a block, which gives it the tick and the last tick."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    hidden = not screen.is_terminal  # a file would get an empty line
    with Progress(*columns, console=screen, transient=True, disable=hidden) as bar:
        task = bar.add_task(f"{name} [dim]ticks[/dim]", total=None)
        yield lambda tick, last: bar.update(task, completed=tick, total=last)


def print_table(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table on standard output, long words folded."""
    table = Table(
        *(Column(name, overflow="fold") for name in columns), box=None, header_style="bold"
    )
    for row in rows:
        table.add_row(*map(str, row))
    Console().print(table)


def short(value: Any) -> str:
    """Return a value in few digits and few entries."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {short(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(short, value[:8])) + (", ..." if len(value) > 8 else "")
    if isinstance(value, float):
        return f"{value:.6g}"
    return "-" if value is None else str(value)
