"""A table of the page of an analysis."""

from typing import NamedTuple


class Table(NamedTuple):
    """A table of the page."""

    title: str
    words: str
    columns: tuple[str, ...]
    rows: list[list[str]]
