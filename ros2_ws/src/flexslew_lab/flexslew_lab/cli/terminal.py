"""Output for people: tables and lines; progress.py prints through it, too.

All of it goes through this file. Printed text may come from a file of another user: what does not
show, as the sequences that a terminal obeys (title, clipboard), is escaped.
"""

import os
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from flexslew_plant.refusal import one_line

_WHOLE = 10**6  # columns, without a terminal
for_people = Console(stderr=True)  # standard output is for results


def print_table(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table on standard output: as wide as it is for a program, long words folded else."""
    table = Table(
        *(Column(Text(one_line(name)), overflow="fold") for name in columns),
        box=None,
        header_style="bold",
    )
    for row in rows:  # as it is: [s] is a unit, not a style
        table.add_row(*(Text(one_line(str(cell))) for cell in row))
    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _WHOLE
    console.print(table)


def print_line(words: str) -> None:
    """Print a result on standard output, as it is and on one line."""
    print(one_line(words))


def print_message(words: str, style: str = "", head: str = "", head_style: str = "red") -> None:
    """Print a line for a user, as it is.

    Args:
        words: any text.
        style: of the words.
        head: before them.
        head_style: of the head.
    """
    line = Text.assemble((one_line(head), head_style), (one_line(words), style))
    for_people.print(line, highlight=False, soft_wrap=True)


def link(path: Path) -> str:
    """Return a file as an address that a terminal opens with a click."""
    return path.resolve().as_uri()
