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
PIPED = 100  # columns of a text for people, without a terminal
for_people = Console(stderr=True)  # standard output is for results


def print_table(
    columns: Iterable[str], rows: Iterable[Iterable[object]], piped: int = _WHOLE
) -> None:
    """Print a table on standard output, long words folded.

    Args:
        columns: headings; the numbers of one named `value` end at one place.
        rows: cells; a row with a single cell is the heading of those that follow.
        piped: largest width without a terminal; a program gets a table as wide as it is.
    """
    table = Table(
        *(
            Column(
                Text(one_line(name)),
                overflow="fold",
                justify="right" if name == "value" else "left",
            )
            for name in columns
        ),
        box=None,
        header_style="bold",
    )
    for row in rows:
        cells = [one_line(str(cell)) for cell in row]  # as it is: [s] is a unit, not a style
        if len(cells) == 1 and len(table.columns) > 1:
            table.add_row()
        table.add_row(
            *(Text(cell, "bold" if len(cells) < len(table.columns) else "") for cell in cells)
        )
    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = piped
    console.print(table)


def print_verdict(words: str) -> None:
    """Print the main result on standard output in one line, before its numbers."""
    Console().print(Text(one_line(words), "bold"), highlight=False, soft_wrap=True)


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
