"""Columns of CSV files as laboratories and spreadsheets write them."""

import csv
from array import array
from collections.abc import Iterator
from io import TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from flexslew_lab.identification.files.columns import Choose
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import open_given

LARGEST = 4 << 30  # of a file [B]; it is read line by line
_DELIMITERS = (",", ";", "\t", " ", "|")
_COMMENTS = ("#", "%")
_SAMPLE = 60  # lines that show how columns are separated
_SAMPLE_BYTES = 1 << 16  # that show the encoding
_LONGEST = 1 << 20  # of a line [characters]
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}


class _Layout(NamedTuple):
    delimiter: str
    header: tuple[str, ...]
    first: int  # of the lines that are neither empty nor comments: the first with numbers


def column_names(text: str) -> tuple[str, ...]:
    """Return the names in a list with commas; one that holds a comma stands in double quotes."""
    return tuple(
        n for row in csv.reader([text], skipinitialspace=True) for n in map(str.strip, row) if n
    )


def read_csv(path: Path, choose: Choose) -> dict[str, Vector]:
    """Return columns of a text file with a header; without one they are called 1, 2 and so on.

    Commas, semicolons, tabs, bars or spaces separate the columns, whichever gives the most rows as
    long as the header, and then the most numbers. The decimal point may be a comma, in quotes where
    commas separate. Lines that begin with # or % are comments; the last one above the numbers is
    the header where there is no other. A byte-order mark, also of UTF-16, is skipped.

    Raises:
        BadInput: if it cannot be read, a column is missing, or an entry is no number.
    """
    try:
        with open_given(path, LARGEST) as raw:
            encoding = _encoding(raw)
            with TextIOWrapper(raw, encoding=encoding, newline=None) as file:
                return _columns(path, file, choose)
    except (OSError, UnicodeError, csv.Error) as error:
        raise BadInput(f"cannot be read: {error}", path) from None


def _encoding(file: BinaryIO) -> str:
    """Return the encoding of a text file: by its mark, else UTF-8, else Latin 1."""
    sample = file.read(_SAMPLE_BYTES)
    file.seek(0)
    for mark, name in _MARKS.items():
        if sample.startswith(mark):
            return name
    try:
        sample[: sample.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _columns(path: Path, file: TextIOWrapper, choose: Choose) -> dict[str, Vector]:
    comments: list[str] = []
    lines = _lines(path, file, comments)
    sample = list(islice(lines, _SAMPLE))
    if not sample:
        raise BadInput("holds no rows; a header and numbers are needed", path)
    layout = _layout([line for _, line in sample], comments)
    places = {name: layout.header.index(name) for name in choose(layout.header)}
    values = {name: array("d") for name in places}
    width = len(layout.header)
    for number, line in chain(sample[layout.first :], lines):
        row = _cells(line, layout.delimiter)
        fits = not any(row[width:])  # decimal commas between commas
        for name, place in places.items():
            text = row[place] if place < len(row) else ""
            value = _number(text) if fits else None
            if value is None:
                raise BadInput(
                    f"line {number}: {text!r:.60} is no number; the row has {len(row)} of {width} "
                    f"columns, the header is: {'; '.join(layout.header):.400}",
                    f"{path}: {name}",
                )
            values[name].append(value)
    if not all(values.values()):
        raise BadInput("holds no rows; a header and numbers are needed", path)
    return {name: np.array(column, dtype=np.float64) for name, column in values.items()}


def _lines(path: Path, file: TextIOWrapper, comments: list[str]) -> Iterator[tuple[int, str]]:
    """Yield the lines with numbers from 1 on, without those that are empty or comments."""
    number = 0
    while line := file.readline(_LONGEST):
        number += 1
        if len(line) == _LONGEST:
            raise BadInput(f"cannot be read: line {number} is longer than {_LONGEST:,}", path)
        if not line.strip():
            continue
        if line.lstrip().startswith(_COMMENTS):
            comments[:] = [line.strip().lstrip("#% \t")]
            continue
        yield number, line.rstrip("\n")


def _layout(lines: list[str], comments: list[str]) -> _Layout:
    def score(delimiter: str) -> tuple[bool, float, float, int]:
        rows = [_cells(line, delimiter) for line in lines]
        width = len(rows[0])
        full = [row for row in rows if len(row) == width]
        data = full[1:] or full
        numbers = sum(_number(cell) is not None for row in data for cell in row)
        return width > 1, len(full) / len(rows), numbers / max(width * len(data), 1), width

    delimiter = max(_DELIMITERS, key=score)
    header = [cell.strip() for cell in _cells(lines[0], delimiter)]
    if any(_number(cell) is None for cell in header):
        return _Layout(delimiter, tuple(header), 1)
    named = [cell.strip() for cell in _cells(comments[0], delimiter)] if comments else []
    numbered = [str(k) for k in range(1, len(header) + 1)]
    return _Layout(delimiter, tuple(named if len(named) == len(header) else numbered), 0)


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " " and '"' not in line:
        return line.split()
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def _number(text: str) -> float | None:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return None
