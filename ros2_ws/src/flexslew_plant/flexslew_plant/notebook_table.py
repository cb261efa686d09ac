"""The view of a result in a notebook: its line, then a table; or the table as text."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import islice

_MOST = 40  # rows that are shown


def in_notebook(
    line: str, columns: Sequence[str], rows: Iterable[Sequence[object]], folded: str = ""
) -> str:
    """Return HTML of a notebook's cell; all text is escaped.

    Args:
        line: text of repr, or another sentence.
        columns: headings; none: there is no row of them.
        rows: cells; those beyond 40 are counted.
        folded: heading under which the table opens on a click; empty: it is open.
    """
    given = iter(rows)
    table_rows = [_row(row, "td") for row in islice(given, _MOST)]
    left = sum(1 for _ in given)
    head = _row(columns, "th") if columns else ""
    table = f"<table>{head}{''.join(table_rows)}</table>" + (f"and {left} more" if left else "")
    if folded:
        table = f"<details><summary>{escape(folded)}</summary>{table}</details>"
    return f"{escape(line)}{table}"


def as_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of plain text, its columns as wide as their longest cell."""
    lines = [[str(cell) for cell in row] for row in (columns, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = (zip(line, widths, strict=True) for line in lines)
    return "\n".join("  ".join(cell.ljust(w) for cell, w in line).rstrip() for line in padded)


def _row(cells: Sequence[object], kind: str) -> str:
    return "<tr>" + "".join(f"<{kind}>{escape(str(cell))}</{kind}>" for cell in cells) + "</tr>"
