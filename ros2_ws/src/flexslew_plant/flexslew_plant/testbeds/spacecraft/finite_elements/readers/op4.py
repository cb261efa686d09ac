"""Matrices of Nastran's OUTPUT4 files (.op4): text, or binary of either byte order.

Mass and stiffness are M and K, or as the sets are called: MAA, KAA, MGG, KGG, MXX, KXX. Other
matrices (NODES, DOF, NUMBERS, BOUNDARY, C or BAA) are named as in `arrays`; rows count from 1.

A matrix is a header (columns, rows, form, type, name), then per column (column, first row, words)
and its numbers; in a sparse column, whose first row is 0, strings of numbers with their own heads
(MSC Nastran, DMAP programmer's guide, OUTPUT4).
"""

import re
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.sparse import coo_array

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.checks import LARGEST
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.arrays import (
    ALIASES,
    MATRICES,
    model_of_arrays,
)

_BIG = 65536  # rows from which strings have their row and length in two words
_FORMAT = re.compile(r"(?:1P,)?(\d+)[ED](\d+)\.\d+", re.IGNORECASE)
_Ints: TypeAlias = Callable[[int], list[int]]  # reads so many whole numbers
_Reals: TypeAlias = Callable[[int], Vector]  # reads so many numbers


def op4_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of an .op4 file.

    Raises:
        BadInput: it is damaged, or see model_of_arrays.
    """
    return model_of_arrays(op4_matrices(path, contents[path.suffix]), 1, path)


def op4_matrices(path: Path, content: bytes) -> dict[str, Any]:
    """Return the matrices of an .op4 file, by the names of `arrays`.

    Raises:
        BadInput: it is damaged.
    """
    data: dict[str, Any] = {}
    try:
        text = content[:8].strip().isdigit()
        for name, matrix in _text(content) if text else _binary(content):
            key = name if name in (*MATRICES, *ALIASES) else name.lower()
            if key in data:
                raise BadInput("is there twice", path, name)
            data[key] = matrix
    except (ValueError, IndexError, EOFError, OverflowError) as error:
        why = str(error) or "it is cut off"
        raise BadInput(f"is not an OUTPUT4 file, or damaged: {why:.120}", path) from None
    return data


def _text(content: bytes) -> Iterator[tuple[str, coo_array]]:
    """Yield name and matrix of each of a text."""
    lines = iter(content.decode("ascii").splitlines())

    def ints(count: int) -> list[int]:
        line = next(lines, "")
        if count == 1:  # row and length in one number, which is longer
            return [int(line)]
        return [int(line[at : at + 8]) for at in range(0, 8 * count, 8)]

    for line in lines:
        head = [int(line[at : at + 8]) for at in range(0, 32, 8)]
        found = _FORMAT.fullmatch(line[40:].strip() or "5E16.9")
        if found is None:
            raise ValueError(f"format {line[40:].strip()}")
        per_line, width = int(found[1]), int(found[2])

        def reals(count: int, per_line: int = per_line, width: int = width) -> Vector:
            values: list[float] = []
            while len(values) < count:
                row = next(lines, "")
                many = min(per_line, count - len(values))
                cells = [row[k * width : (k + 1) * width] for k in range(many)]
                values += [float(cell.upper().replace("D", "E")) for cell in cells]
            return np.array(values)

        per_number = 1 if head[3] % 2 else 2
        yield line[32:40].strip().upper(), _matrix(head, ints, reals, (1, per_number))


def _binary(content: bytes) -> Iterator[tuple[str, coo_array]]:
    """Yield name and matrix of each of a binary file with words of four bytes."""
    order = next((o for o in "<>" if content[:4] == np.array(24, f"{o}i4").tobytes()), "")
    if not order:
        raise ValueError("no text, and no record of 24 bytes; words of 64 bits are not read")
    file = BytesIO(_without_marks(content, f"{order}i4"))

    def words(count: int, kind: str) -> Any:
        size = np.dtype(kind).itemsize * count
        part = file.read(size) if 0 <= size <= len(content) else b""
        if len(part) < size or size < 0:
            raise EOFError
        return np.frombuffer(part, order + kind)

    def ints(count: int) -> list[int]:
        return [int(value) for value in words(count, "i4")]

    while file.tell() < file.getbuffer().nbytes:
        head = ints(4)
        name = file.read(8).decode("ascii").strip().upper()
        single = head[3] % 2 == 1

        def reals(count: int, single: bool = single) -> Vector:
            return np.asarray(words(count, "f4" if single else "f8"), dtype=float)

        per_number = 1 if single else 2
        yield name, _matrix(head, ints, reals, (per_number, per_number))


def _without_marks(content: bytes, kind: str) -> bytes:
    """Return what the records of Fortran hold, each of which has its length before and after."""
    parts, at = [], 0
    while at < len(content):
        (size,) = np.frombuffer(content[at : at + 4], kind)
        end = at + 4 + int(size)
        if size < 0 or content[end : end + 4] != content[at : at + 4]:
            raise ValueError(f"a record of {size} bytes does not end there")
        parts.append(content[at + 4 : end])
        at = end + 4
    return b"".join(parts)


def _matrix(head: list[int], ints: _Ints, reals: _Reals, words: tuple[int, int]) -> coo_array:
    """Return the matrix that follows a header.

    Args:
        head: columns, rows (negative: sparse with long strings), form, type.
        ints: reads a line of whole numbers, or so many of a record.
        reals: reads numbers.
        words: of a number, in a dense and in a sparse column.
    """
    columns, rows, _, kind = head
    if not 0 < columns <= LARGEST or not 0 < abs(rows) <= LARGEST or kind not in (1, 2):
        raise ValueError(f"{abs(rows)} x {columns} numbers of type {kind}; 1 and 2 are real")
    big, parts = rows < 0 or rows >= _BIG, [np.zeros((3, 0))]

    def keep(column: int, first: int, count: int) -> None:
        values = reals(count)
        row = first - 1.0 + np.arange(len(values))
        parts.append(np.stack((row, np.full(len(values), column - 1.0), values)))

    while True:
        column, first, count = ints(3)
        if column > columns:
            reals(1)
            break
        if column < 1 or count < 0:
            raise ValueError(f"column {column} with {count} words")
        if first > 0:
            keep(column, first, count // words[0])
            continue
        while count > 0:
            length, first = ints(2) if big else divmod(ints(1)[0], _BIG)
            if length < 1:
                raise ValueError(f"a string of {length} words")
            count -= length + big
            keep(column, first, (length - 1) // words[1])
    row, at, values = np.concatenate(parts, axis=1)
    return coo_array((values, (row.astype(int), at.astype(int))), shape=(abs(rows), columns))
