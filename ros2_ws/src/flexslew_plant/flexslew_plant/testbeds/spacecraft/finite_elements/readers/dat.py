"""Participation factors and masses in a table file of CalculiX (.dat).

`*FREQUENCY` writes frequencies, participation factors (of modes of modal mass 1, about the origin)
and effective masses. `*EL PRINT, ELSET=EALL, TOTALS=YES` with EMAS writes the mass of each element,
the centre and the second moments, sum of m x x^T, which it calls moments of inertia.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_MODES = "EIGENVALUEOUTPUT"
_FACTORS = "PARTICIPATIONFACTORS"
_TOTAL = "TOTALEFFECTIVEMASS"
_ELEMENT = "mass(element,mass)"
_MASS = "totalmassforset"
_SECOND = "totalmassmomentofinertia(xx,yy,zz,xy,xz,yz)"
_CENTRE = "centerofgravityforset"
_WIDTHS = {_MODES: 5, _FACTORS: 7, _TOTAL: 6, _ELEMENT: 8, _MASS: 1, _SECOND: 6, _CENTRE: 3}
HUGE = 1e50  # of a number; sums and products of such are still finite
_MOST = 5_000_000  # rows of all tables
_SHORT_EXPONENT = re.compile(r"(?<=\d)([-+]\d{3})$")  # 0.1-102, as Fortran writes it
_MASSES = "add `*EL PRINT, ELSET=EALL, TOTALS=YES` and `EMAS` to the step, of a set of all elements"


class MassTables(NamedTuple):
    """What a .dat holds of a clamped structure, in its units and axes.

    Args:
        frequencies: shape (m,) [rad per time unit].
        participation: R^T M Phi of modes of modal mass 1, shape (6, m), about the origin.
        total: diagonal of R^T M R without the boundary, shape (6,).
        masses: by number of the element.
        mass: of all.
        centre: of mass, shape (3,).
        second: sum of m x x^T about the origin, shape (3, 3).
    """

    frequencies: Vector
    participation: Matrix
    total: Vector
    masses: dict[int, float]
    mass: float
    centre: Vector
    second: Matrix


def dat_tables(content: bytes, path: Path) -> MassTables:
    """Return the tables of a .dat file.

    Raises:
        BadInput: it is damaged, or a table is missing; with what makes CalculiX write it.
    """
    tables = _tables(content.decode("ascii", "replace"), path)
    for title in (_MODES, _FACTORS, _TOTAL):
        if title not in tables:
            raise BadInput("holds no participation factors: the step must be *FREQUENCY", path)
    for title in (_ELEMENT, _MASS, _SECOND, _CENTRE):
        if title not in tables:
            raise BadInput(f"holds no masses of the structure: {_MASSES}", path)
    modes, factors = tables[_MODES], tables[_FACTORS]
    if not np.array_equal(modes[:, 0], factors[:, 0]):
        raise BadInput("has not the same modes in its two tables", path)
    xx, yy, zz, xy, xz, yz = tables[_SECOND][0]
    elements = tables[_ELEMENT]
    return MassTables(
        modes[:, 2],
        factors[:, 1:].T,
        tables[_TOTAL][0],
        dict(zip(elements[:, 0].astype(int).tolist(), elements[:, 1].tolist(), strict=True)),
        float(tables[_MASS][0, 0]),
        tables[_CENTRE][0],
        np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
    )


def _tables(text: str, path: Path) -> dict[str, Matrix]:
    """Return the first table of each title, without spaces; those of later modes are the same."""
    rows: dict[str, list[list[float]]] = {}
    sets: set[str] = set()
    title, count = "", 0
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        row = _numbers(words)
        if row is None:
            squeezed = "".join(words)
            known = next((key for key in _WIDTHS if squeezed.startswith(key)), "")
            if known == _MASS:
                sets.add(squeezed.removeprefix(_MASS).partition("andtime")[0])
            if known or rows.get(title):  # else a heading of columns
                title = "" if known in rows else known
                rows.setdefault(title, [])
        elif title:
            if len(row) != _WIDTHS[title] or not np.abs(row).max() < HUGE:
                words_of = f"line {number}: {_WIDTHS[title]} finite numbers belong there"
                raise BadInput(words_of, path, value=line.strip()[:60])
            rows[title].append(row)
            count += 1
            if count > _MOST:
                raise BadInput(f"has more than {_MOST:,} rows", path)
    if len(sets) > 1:
        words_of = (
            f"has masses of the sets {', '.join(sorted(sets))}; print one set of all elements"
        )
        raise BadInput(words_of, path)
    return {key: np.array(table) for key, table in rows.items() if key and table}


def _numbers(words: list[str]) -> list[float] | None:
    """Return a row of numbers; None: it is a row of words."""
    try:
        return [float(_SHORT_EXPONENT.sub(r"E\1", word)) for word in words]
    except ValueError:
        return None
