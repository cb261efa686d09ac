"""Appendages from the output of a finite element program: YAML, CSV or NPZ.

Keys (docs/spacecraft.md has a worked example), n modes and k mass points:
    units             si (default) or slug_ft_lb
    frequencies_hz    n, with the hinge clamped [Hz]
    damping_ratios    n [-]; left out: none
    modal_mass        n numbers or n x n; left out: one for each
and either the shape itself
    points            k x 3, from the hinge
    masses            k
    shapes            n x k x 3
    tip               index of the point that is reported as the tip, from 0
or what it does to its hinge
    translation       3 x n, sum of m phi
    rotation          3 x n, sum of m r x phi
and, needed with the second and compared with the first,
    rigid             mass, first_moment (3), inertia (3 x 3, about the hinge)
A CSV has the numbers above as `# key: numbers` lines, then a row per point:
x,y,z,mass,mode_1_x,mode_1_y,mode_1_z,mode_2_x,...
"""

import zipfile
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import load_yaml
from flexslew_plant.testbeds.spacecraft.integrals import (
    Integrals,
    Points,
    integrals_of,
    second_of,
)
from flexslew_plant.testbeds.spacecraft.shape import FlexibleShape, Spot
from flexslew_plant.testbeds.spacecraft.units import UNITS, hint

_KEYS = {
    "units",
    "frequencies_hz",
    "damping_ratios",
    "modal_mass",
    "points",
    "masses",
    "shapes",
    "tip",
    "translation",
    "rotation",
    "rigid",
}
_SHIPPED = Path(str(resources.files("flexslew_plant.testbeds.spacecraft"))) / "data"
_MASS_TOLERANCE = 0.02  # of the rigid sums that are given
_ORTHOGONAL = 1e-3  # of the modal masses


def modal_shape(path: Path) -> FlexibleShape:
    """Return the appendage that a file describes, in SI.

    Raises:
        BadInput: the file cannot be read, a number is missing, of the wrong shape or out of
            range, or its rigid sums contradict its points.
    """
    if not path.exists() and (_SHIPPED / path).exists():
        path = _SHIPPED / path
    data = _read(path)
    unknown = sorted(set(data) - _KEYS)
    if unknown:
        raise BadInput(
            f"{path}: {unknown[0]}: unknown key; allowed here: {', '.join(sorted(_KEYS))}"
        )
    system = str(data.get("units", "si"))
    if system not in UNITS:
        raise BadInput(f"{path}: units: {system!r} is not allowed: {', '.join(UNITS)}")
    units = UNITS[system]
    frequencies = _array(data, "frequencies_hz", (None,), path)
    n = len(frequencies)
    if not (frequencies > 0.0).all():
        raise BadInput(f"{path}: frequencies_hz: {frequencies.min():g} is not positive")
    ratios = _array(data, "damping_ratios", (n,), path) if "damping_ratios" in data else None
    if ratios is not None and not ((ratios >= 0.0) & (ratios < 1.0)).all():
        raise BadInput(f"{path}: damping_ratios: {ratios} are not all in 0 to 1")
    mass = _modal_mass(data, n, path)
    rigid = _rigid(data, path)
    if "points" in data:
        integrals, mass, tip, line, line_shape = _from_points(data, n, mass, rigid, path)
    elif "translation" in data:
        integrals, mass = _from_participation(data, n, mass, rigid, path)
        tip = Spot(np.zeros(3), np.zeros((3, n)), np.zeros((3, n)), np.zeros((2, n)))
        line, line_shape = np.zeros((2, 3)), np.zeros((2, 3, n))
    else:
        raise BadInput(f"{path}: points or translation: missing; give mode shapes or participation")
    omega = 2.0 * np.pi * frequencies
    integrals = _converted(integrals, units.length, units.mass)
    damping = None if ratios is None else np.diag(2.0 * ratios * omega * mass * units.mass)
    return FlexibleShape(
        integrals,
        mass * units.mass,
        mass * units.mass * omega**2,
        Spot(
            tip.place * units.length,
            tip.displacement,
            tip.turn / units.length,
            tip.curvature,
        ),
        line * units.length,
        line_shape,
        None,
        damping,
    )


def _read(path: Path) -> dict[str, Any]:
    """Return what the file holds, by key."""
    try:
        if path.suffix == ".npz":
            with np.load(path) as archive:
                data = dict(archive)
            for key in [k for k in data if k.startswith("rigid_")]:
                data.setdefault("rigid", {})[key.removeprefix("rigid_")] = data.pop(key)
            return {k: v.item() if getattr(v, "shape", 1) == () else v for k, v in data.items()}
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise BadInput(f"{path}: cannot be read as modal data: {error}") from None
    if path.suffix == ".csv":
        return _read_csv(text, path)
    data = load_yaml(text, str(path))
    if not isinstance(data, dict):
        raise BadInput(f"{path}: modal data must be a mapping of keys")
    return data


def _read_csv(text: str, path: Path) -> dict[str, Any]:
    """Return the keys of `# key: value` lines and the columns of the table."""
    lines = [line for line in text.splitlines() if line.strip()]
    head = "\n".join(line[1:].strip() for line in lines if line.startswith("#"))
    data: dict[str, Any] = load_yaml(head, str(path)) or {}
    rows = [line.split(",") for line in lines if not line.startswith("#")]
    try:
        table = np.array([[float(entry) for entry in row] for row in rows[1:]])
    except ValueError as error:
        raise BadInput(f"{path}: the table must be rows of numbers: {error}") from None
    if table.ndim != 2 or table.shape[1] < 7 or (table.shape[1] - 4) % 3:
        raise BadInput(
            f"{path}: the table has shape {table.shape}; allowed: x, y, z, mass and three columns "
            "per mode"
        )
    shapes = table[:, 4:].reshape(len(table), -1, 3).transpose(1, 0, 2)
    return {**data, "points": table[:, :3], "masses": table[:, 3], "shapes": shapes}


def _array(data: dict[str, Any], key: str, shape: tuple[int | None, ...], path: Path) -> Vector:
    """Return a key as numbers of the shape asked for; None: any length."""
    if key not in data:
        raise BadInput(f"{path}: {key}: missing")
    try:
        values = np.array(data[key], dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"{path}: {key}: is not an array of numbers") from None
    fits = values.ndim == len(shape) and all(
        b is None or a == b for a, b in zip(values.shape, shape, strict=True)
    )
    if not fits:
        asked = " x ".join("any" if b is None else str(b) for b in shape)
        raise BadInput(f"{path}: {key}: has shape {values.shape}; it must be {asked}")
    if not np.isfinite(values).all():
        raise BadInput(f"{path}: {key}: holds a number that is not finite")
    return values


def _modal_mass(data: dict[str, Any], n: int, path: Path) -> Vector | None:
    """Return the diagonal of the modal masses, checked; None where the file gives none."""
    if "modal_mass" not in data:
        return None
    values = np.array(data["modal_mass"], dtype=float)
    matrix = np.diag(values) if values.shape == (n,) else _array(data, "modal_mass", (n, n), path)
    worst = float(abs(matrix - matrix.T).max(initial=0.0))
    if worst > 1e-6 * float(abs(matrix).max()):
        raise BadInput(f"{path}: modal_mass: is not symmetric: entries differ by {worst:.3g}")
    lowest = float(np.linalg.eigvalsh(matrix).min())
    if lowest <= 0.0:
        raise BadInput(f"{path}: modal_mass: is not positive definite: eigenvalue {lowest:.3g}")
    _require_orthogonal(matrix, "modal_mass", path)
    return np.diag(matrix).copy()


def _require_orthogonal(matrix: Matrix, key: str, path: Path) -> None:
    size = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    off = abs(matrix / size - np.eye(len(matrix)))
    np.fill_diagonal(off, 0.0)
    worst = np.unravel_index(int(np.argmax(off)), off.shape)
    if off.max(initial=0.0) > _ORTHOGONAL:
        i, j = (int(k) + 1 for k in worst)
        raise BadInput(
            f"{path}: {key}: modes {i} and {j} are not orthogonal in mass: "
            f"{off.max():.3g} of their modal masses; allowed: {_ORTHOGONAL:g}"
        )


def _rigid(data: dict[str, Any], path: Path) -> tuple[float, Vector, Matrix] | None:
    """Return mass, first moment and inertia as the file gives them."""
    given = data.get("rigid")
    if given is None:
        return None
    if not isinstance(given, dict):
        raise BadInput(f"{path}: rigid: must give mass, first_moment and inertia")
    mass = float(_array(given, "mass", (), path))
    if not mass > 0.0:
        raise BadInput(f"{path}: rigid.mass: {mass:g} is not positive")
    first, inertia = (
        _array(given, "first_moment", (3,), path),
        _array(given, "inertia", (3, 3), path),
    )
    return mass, first, inertia


def _from_points(
    data: dict[str, Any],
    n: int,
    mass: Vector | None,
    rigid: tuple[float, Vector, Matrix] | None,
    path: Path,
) -> tuple[Integrals, Vector, Spot, Matrix, Matrix]:
    """Return sums, modal masses, tip and a line to draw, from mass points and mode shapes."""
    points = _array(data, "points", (None, 3), path)
    k = len(points)
    masses = _array(data, "masses", (k,), path)
    if not (masses > 0.0).all():
        raise BadInput(f"{path}: masses: {masses.min():g} is not positive")
    shapes = _array(data, "shapes", (n, k, 3), path).transpose(1, 2, 0)
    integrals = integrals_of(Points(points, masses, shapes))
    own = np.einsum("ijaa->ij", integrals.second_2) / 2.0
    lowest = float(np.linalg.eigvalsh(own).min())
    if lowest <= 1e-12 * float(abs(own).max()):
        raise BadInput(
            f"{path}: shapes: are not independent: their mass matrix has eigenvalue {lowest:.3g}"
        )
    if mass is None:
        _require_orthogonal(own, "shapes", path)
        mass = np.diag(own).copy()
    elif not np.allclose(np.diag(own), mass, rtol=_MASS_TOLERANCE):
        worst = int(np.argmax(abs(np.diag(own) / mass - 1.0)))
        ratio = float(mass[worst] / own[worst, worst])
        raise BadInput(
            f"{path}: modal_mass: mode {worst + 1} has {mass[worst]:.6g}, its points sum to "
            f"{own[worst, worst]:.6g}{hint(ratio, 'mass')}"
        )
    if rigid is not None:
        _compare(integrals, rigid, path)
    at = int(data.get("tip", int(np.argmax(np.linalg.norm(points, axis=1)))))
    if not 0 <= at < k:
        raise BadInput(f"{path}: tip: {at} is not allowed: 0 to {k - 1}")
    tip = Spot(points[at], shapes[at], np.zeros((3, n)), np.zeros((2, n)))
    order = np.argsort(np.linalg.norm(points, axis=1), kind="stable")
    return integrals, mass, tip, points[order], shapes[order]


def _compare(integrals: Integrals, rigid: tuple[float, Vector, Matrix], path: Path) -> None:
    """Refuse points whose sums are not the rigid ones of the same file."""
    mass, first, inertia = rigid
    if abs(integrals.mass / mass - 1.0) > _MASS_TOLERANCE:
        raise BadInput(
            f"{path}: rigid.mass: {mass:.6g} is given, the points weigh {integrals.mass:.6g}"
            f"{hint(mass / integrals.mass, 'mass')}"
        )
    size = np.sqrt(np.trace(inertia) / mass)
    found = np.sqrt(np.trace(integrals.inertia) / integrals.mass)
    if abs(found / size - 1.0) > _MASS_TOLERANCE:
        raise BadInput(
            f"{path}: rigid.inertia: radius of gyration {size:.6g} is given, that of the points is "
            f"{found:.6g}{hint(size / found, 'length')}"
        )
    worst = float(np.linalg.norm(integrals.first - first))
    if worst > _MASS_TOLERANCE * mass * size:
        raise BadInput(
            f"{path}: rigid.first_moment: {first} is given, that of the points is {integrals.first}"
        )
    off = float(abs(integrals.inertia - inertia).max())
    if off > 2.0 * _MASS_TOLERANCE * float(np.trace(inertia)):
        raise BadInput(f"{path}: rigid.inertia: differs by {off:.6g} from that of the points")


def _from_participation(
    data: dict[str, Any],
    n: int,
    mass: Vector | None,
    rigid: tuple[float, Vector, Matrix] | None,
    path: Path,
) -> tuple[Integrals, Vector]:
    """Return sums from participation factors; what needs shapes is left out."""
    if rigid is None:
        raise BadInput(f"{path}: rigid: missing; participation factors need the rigid sums")
    weight, first, inertia = rigid
    mass = np.ones(n) if mass is None else mass
    translation, rotation = (_array(data, key, (3, n), path) for key in ("translation", "rotation"))
    return Integrals(
        weight,
        first,
        second_of(inertia),
        translation,
        rotation,
        np.zeros((n, 3, 3)),
        np.zeros((n, n, 3, 3)),
        np.zeros((n, n, 3)),
    ), mass


def _converted(i: Integrals, length: float, mass: float) -> Integrals:
    """Return the sums in SI; displacements per modal coordinate have no unit."""
    return Integrals(
        i.mass * mass,
        i.first * mass * length,
        i.second * mass * length**2,
        i.translation * mass,
        i.rotation * mass * length,
        i.second_1 * mass * length,
        i.second_2 * mass,
        i.gyroscopic * mass,
    )
