"""Columns of CSV files as laboratories and spreadsheets write them."""

import csv
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from flexslew_lab.identification.columns import Columns
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import open_given
from flexslew_plant.near_names import spelling_hint

_TIME = ("time", "t", "stamp")  # names of a column of times [s]
_DELIMITERS = ",;\t"


def column_names(text: str) -> tuple[str, ...]:
    """Return the names in a list with commas; one that holds a comma stands in double quotes."""
    return tuple(
        n for row in csv.reader([text], skipinitialspace=True) for n in map(str.strip, row) if n
    )


def read_csv(path: Path, names: list[str]) -> Columns:
    """Return columns of a CSV file with a header; the column of times is `time`, `t` or `stamp`.

    Commas, semicolons or tabs separate the columns, whichever splits the header most often. Where
    commas do not, they may stand for the decimal point. A byte-order mark is left out.

    Raises:
        BadInput: if it cannot be read, has no times, a column is missing, or an entry is no number.
    """
    try:
        with TextIOWrapper(open_given(path), encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            delimiter = max(
                _DELIMITERS, key=lambda one: len(next(csv.reader([first], delimiter=one), []))
            )
            rows = list(csv.reader(_lines(first, file), delimiter=delimiter, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"cannot be read: {error}", path) from None
    while rows and not any(rows[-1]):  # blank lines at the end
        rows.pop()
    if len(rows) < 2:
        raise BadInput("holds no rows; a header and numbers are needed", path)
    header = [name.strip() for name in rows[0]]
    found = "; ".join(header)
    clock = next((name for name in _TIME if name in header), None)
    if clock is None:
        raise BadInput(
            f"no column of times; call it {', '.join(_TIME)}; the header is: {found}", path
        )
    columns: dict[str, Vector] = {}
    for name in (clock, *names):
        if name not in header:
            hint = spelling_hint(name, header)
            raise BadInput(f"no column {name}; {hint}the header is: {found}", path)
        columns[name] = _numbers(rows, header.index(name), delimiter, f"{path}: {name}")
    return Columns({name: (columns[clock], columns[name]) for name in names}, str(path))


def _lines(first: str, file: TextIOWrapper) -> Iterator[str]:
    yield first
    yield from file


def _numbers(rows: list[list[str]], place: int, delimiter: str, source: str) -> Vector:
    """Return the numbers of a column below the header.

    Raises:
        BadInput: if an entry is none; with its line.
    """
    values = np.empty(len(rows) - 1)
    for k, row in enumerate(rows[1:]):
        text = row[place] if place < len(row) else ""
        try:
            if any(row[len(rows[0]) :]):  # decimal commas between commas
                raise ValueError
            values[k] = float(text if delimiter == "," else text.replace(",", "."))
        except ValueError:
            words = f"line {k + 2}: {text!r:.60} is no number; the row has {len(row)} of "
            raise BadInput(f"{words}{len(rows[0])} columns", source) from None
    return values
