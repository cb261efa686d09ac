"""Checks of modal data: positive masses, orthogonal modes, sums that agree."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Integrals
from flexslew_plant.testbeds.spacecraft.units import hint

MASS_TOLERANCE = 0.02  # of the rigid sums that are given
_ORTHOGONAL = 1e-3  # of the modal masses


def require_known(given: Iterable[str], known: Sequence[str], path: Path, key: str = "") -> None:
    """Refuse the first name that is not a known key of a mapping of a file."""
    for name in map(str, given):
        if name not in known:
            words = f"unknown key; {spelling_hint(name, known)}allowed here: {', '.join(known)}"
            raise BadInput(words, path, ".".join(filter(None, (key, name))))


def array_of(data: dict[str, Any], key: str, shape: tuple[int | None, ...], path: Path) -> Vector:
    """Return a key as numbers of the required shape; None: any length."""
    if key not in data:
        raise BadInput(f"{key}: missing", path)
    try:
        values = np.array(data[key], dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"{key}: is not an array of numbers", path) from None
    fits = values.ndim == len(shape) and all(
        b is None or a == b for a, b in zip(values.shape, shape, strict=True)
    )
    if not fits:
        required = " x ".join("any" if b is None else str(b) for b in shape)
        raise BadInput(f"{key}: has shape {values.shape}; it must be {required}", path)
    if not np.isfinite(values).all():
        raise BadInput(f"{key}: holds a number that is not finite", path)
    return values


def modal_masses(data: dict[str, Any], n: int, path: Path) -> Vector | None:
    """Return the diagonal of the modal masses, checked; None where the file gives none."""
    if "modal_mass" not in data:
        return None
    full = np.ndim(np.array(data["modal_mass"], dtype=object)) == 2
    values = array_of(data, "modal_mass", (n, n) if full else (n,), path)
    matrix = values if full else np.diag(values)
    largest = float(abs(matrix - matrix.T).max(initial=0.0))
    if largest > 1e-6 * float(abs(matrix).max()):
        raise BadInput(f"modal_mass: is not symmetric: entries differ by {largest:.3g}", path)
    lowest = float(np.linalg.eigvalsh(matrix).min())
    if lowest <= 0.0:
        raise BadInput(f"modal_mass: is not positive definite: eigenvalue {lowest:.3g}", path)
    require_orthogonal(matrix, "modal_mass", path)
    return np.diag(matrix).copy()


def require_orthogonal(matrix: Matrix, key: str, path: Path) -> None:
    """Refuse a matrix of modal masses, shape (n, n), if its modes share mass."""
    size = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    off = abs(matrix / size - np.eye(len(matrix)))
    np.fill_diagonal(off, 0.0)
    largest = np.unravel_index(int(np.argmax(off)), off.shape)
    if off.max(initial=0.0) > _ORTHOGONAL:
        i, j = (int(k) + 1 for k in largest)
        raise BadInput(
            f"{key}: modes {i} and {j} are not orthogonal in mass: {off.max():.3g} of "
            f"their modal masses; allowed: {_ORTHOGONAL:g}",
            path,
        )


def require_mass(integrals: Integrals, mass: float, path: Path) -> None:
    """Refuse points that do not weigh what the same file gives as the mass."""
    if abs(integrals.mass / mass - 1.0) > MASS_TOLERANCE:
        raise BadInput(
            f"rigid.mass: {mass:.6g} is given, the points weigh "
            f"{integrals.mass:.6g}{hint(mass / integrals.mass, 'mass')}",
            path,
        )


def compare_rigid(integrals: Integrals, rigid: tuple[float, Vector, Matrix], path: Path) -> None:
    """Refuse points with sums that are not the rigid ones of the same file."""
    mass, first, inertia = rigid
    require_mass(integrals, mass, path)
    size = np.sqrt(np.trace(inertia) / mass)
    found = np.sqrt(np.trace(integrals.inertia) / integrals.mass)
    if abs(found / size - 1.0) > MASS_TOLERANCE:
        raise BadInput(
            f"rigid.inertia: radius of gyration {size:.6g} is given, that of the points "
            f"is {found:.6g}{hint(size / found, 'length')}",
            path,
        )
    largest = float(np.linalg.norm(integrals.first - first))
    if largest > MASS_TOLERANCE * mass * size:
        raise BadInput(
            f"rigid.first_moment: {first} is given, that of the points is {integrals.first}", path
        )
    off = float(abs(integrals.inertia - inertia).max())
    if off > 2.0 * MASS_TOLERANCE * float(np.trace(inertia)):
        raise BadInput(f"rigid.inertia: differs by {off:.6g} from that of the points", path)
