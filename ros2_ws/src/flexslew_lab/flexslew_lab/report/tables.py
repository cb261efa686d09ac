"""The page of tables and figures that comparisons, analyses and searches end in: one HTML file."""

from collections.abc import Sequence
from typing import NamedTuple

from flexslew_lab.report.page import render
from flexslew_lab.report.panels import Group


class Table(NamedTuple):
    """A table of the page; one without rows is left out."""

    title: str
    words: str  # how it is read
    columns: Sequence[str]  # none: the cells are words
    rows: Sequence[Sequence[str]]
    note: str = ""
    colours: Sequence[str] = ()  # of the rows in the figures, if they have one


def tables_page(
    kind: str,
    title: str,
    description: str,
    tables: Sequence[Table],
    groups: Sequence[Group] = (),
    other_figures: Sequence[tuple[str, str]] = (),
) -> str:
    """Return a page that needs nothing else.

    Args:
        kind: of page.
        title: at its top.
        description: what it shows.
        tables: in their order.
        groups: of panels, below the tables.
        other_figures: other figures, at the end: titles and HTML.
    """
    return render(
        "tables.html.j2",
        kind=kind,
        title=title,
        about=description,
        tables=[table for table in tables if table.rows],
        groups=[group for group in groups if group.panels],
        drawn=other_figures,
    )
