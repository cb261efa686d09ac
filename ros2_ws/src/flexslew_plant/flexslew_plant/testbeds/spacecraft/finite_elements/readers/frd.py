"""Mode shapes in a result file of CalculiX (.frd): nodes, elements and displacements of modes.

The file has fixed columns: a block of nodes (2C), a block of elements (3C), and for each mode a
header 100C with its frequency and a table DISP (CalculiX CrunchiX user's manual, output format).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.checks import LARGEST
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.dat import HUGE

_LONG = 10  # digits of a node's number; 5 in the short format
_VALUE = 12  # characters of a number


class ModeShapes(NamedTuple):
    """What an .frd holds of the modes of a structure.

    Args:
        numbers: of the nodes, shape (k,), ascending.
        nodes: their places, shape (k, 3).
        elements: node numbers by number of the element.
        frequencies: one per time unit, shape (m,).
        shapes: displacements, shape (k, 3, m).
    """

    numbers: Indices
    nodes: Matrix
    elements: dict[int, list[int]]
    frequencies: Vector
    shapes: Matrix


def frd_modes(content: bytes, path: Path) -> ModeShapes:
    """Return the modes of an .frd file.

    Raises:
        BadInput: it is binary or damaged, or holds no modes.
    """
    text = content.decode("ascii", "replace").splitlines()
    lines = iter(text)
    places: dict[int, list[float]] = {}
    elements: dict[int, list[int]] = {}
    frequencies: list[float] = []
    tables: list[dict[int, list[float]]] = []
    line, digits = "", _LONG
    try:
        for line in lines:
            if line.startswith("    2C"):
                digits = _digits(line, path)
                places = _rows(lines, digits)
            elif line.startswith("    3C"):
                elements = _elements(lines, digits)
            elif line.startswith("  100C"):
                frequency = float(line[12:24])
            elif line.startswith(" -4  DISP"):
                frequencies.append(frequency)
                tables.append(_rows(lines, digits))
    except (ValueError, IndexError, UnboundLocalError):
        rest = sum(1 for _ in lines)
        raise BadInput(f"damaged at line {len(text) - rest}, in the block of this head", path,
                       value=line.strip()[:60]) from None  # fmt: skip
    if not 1 < len(places) <= LARGEST // 3:
        raise BadInput(f"has {len(places)} nodes; allowed: 2 to {LARGEST // 3:,}", path)
    if not tables:
        words = "holds no modes: *FREQUENCY needs *NODE FILE with U in the deck"
        raise BadInput(words, path)
    numbers = np.array(sorted(places), dtype=np.int64)
    shapes = np.zeros((len(tables), len(numbers), 3))
    for k, table in enumerate(tables):
        if table.keys() - places.keys():
            raise BadInput(f"mode {k + 1} moves a node without a place", path)
        given = np.array(sorted(table), dtype=np.int64)
        shapes[k, np.searchsorted(numbers, given)] = np.array(
            [table[n] for n in given.tolist()]
        ).reshape(-1, 3)
    nodes = np.array([places[n] for n in numbers.tolist()])
    if not (np.abs(nodes).max() < HUGE and np.abs(shapes).max() < HUGE):
        raise BadInput("holds a number that is not finite, or huge", path)
    return ModeShapes(numbers, nodes, elements, np.array(frequencies), shapes.transpose(1, 2, 0))


def _digits(header: str, path: Path) -> int:
    """Return the digits of a node's number in this file."""
    kind = header.split()[-1]
    if kind not in ("0", "1"):
        raise BadInput("is binary: write it as text, *NODE FILE without OUTPUT=binary", path)
    return _LONG if kind == "1" else _LONG // 2


def _rows(lines: Iterator[str], digits: int) -> dict[int, list[float]]:
    """Return three numbers by node, up to the end of a block."""
    found: dict[int, list[float]] = {}
    start = 3 + digits
    for line in lines:
        if line.startswith(" -3"):
            return found
        if line.startswith(" -1"):
            found[int(line[3:start])] = [
                float(line[at : at + _VALUE]) for at in range(start, start + 3 * _VALUE, _VALUE)
            ]
    raise ValueError


def _elements(lines: Iterator[str], digits: int) -> dict[int, list[int]]:
    """Return node numbers by element, up to the end of a block."""
    found: dict[int, list[int]] = {}
    nodes: list[int] = []
    for line in lines:
        if line.startswith(" -3"):
            return found
        if line.startswith(" -1"):
            nodes = found[int(line[3 : 3 + digits])] = []
        elif line.startswith(" -2"):
            nodes += [int(line[k : k + digits]) for k in range(3, len(line.rstrip()), digits)]
    raise ValueError
