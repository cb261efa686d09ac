"""Appendages from the output of a finite element program: YAML, CSV or NPZ.

Keys (docs/spacecraft/modal_data.md has an example), n modes and k mass points:
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
or both: these and `rigid` then count in first order, and the points in second
optionally what a base that spins or accelerates adds to the modal stiffness
    geometric_stiffness.uniform   3 x n x n, per acceleration of all points along x, y, z
    geometric_stiffness.linear    3 x 3 x n x n, per acceleration along x, y, z (first index) that
                                  grows by one per length along x, y, z (second index)
and, needed with the second and compared with the first,
    rigid             mass, first_moment (3), inertia (3 x 3, about the hinge)
A CSV has the numbers above as `# key: numbers` lines, then a row per point:
x,y,z,mass,mode_1_x,mode_1_y,mode_1_z,mode_2_x,...
"""

import os
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_bytes
from flexslew_plant.npz_file import read_npz
from flexslew_plant.own_code import Trust, require_file
from flexslew_plant.testbeds.spacecraft.shapes.integrals import (
    Integrals,
    Points,
    Shortening,
    first_order_integrals,
    integrals_of,
    second_of,
)
from flexslew_plant.testbeds.spacecraft.shapes.modal_checks import (
    MASS_TOLERANCE,
    array_of,
    compare_rigid,
    modal_masses,
    require_known,
    require_mass,
    require_orthogonal,
)
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint, FlexibleShape
from flexslew_plant.testbeds.spacecraft.units import UNITS, hint
from flexslew_plant.yaml_data import load_yaml

_KEYS = (
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
    "geometric_stiffness",
)
_RIGID = ("mass", "first_moment", "inertia")
_GEOMETRIC = ("uniform", "linear")
_DATA_FOLDER = Path(str(resources.files("flexslew_plant.testbeds.spacecraft"))) / "data"


def modal_shape(path: Path) -> FlexibleShape:
    """Return the appendage that a file describes, in SI.

    Raises:
        BadInput: the file cannot be read, a number is missing, of the wrong shape or out of
            range, or its rigid sums contradict its points.
    """
    if not os.path.exists(path) and os.path.exists(_DATA_FOLDER / path):
        path = _DATA_FOLDER / path
    return _shape_of(path, given_bytes(path))


def allowed_file(path: Path, trust: Trust) -> Path:
    """Return a file of modal data that may be read; of those that a log names, a shipped one.

    Raises:
        Untrusted: if it may not.
    """
    if trust.is_file_allowed(str(path)):
        return path
    data_file = (_DATA_FOLDER / path).resolve()
    if data_file.is_relative_to(_DATA_FOLDER.resolve()) and data_file.is_file():
        return data_file
    require_file(trust, str(path), "modal data")
    return path


@lru_cache(maxsize=16)
def _shape_of(path: Path, content: bytes) -> FlexibleShape:
    """Return the shape of a file with this content: it is the same in every trial of a study."""
    return shape_of_data(_read(path, content), path)


def shape_of_data(data: dict[str, Any], path: Path) -> FlexibleShape:
    """Return the shape that modal data describe, in SI.

    Raises:
        BadInput: see modal_shape.
    """
    require_known(data, _KEYS, path)
    system = str(data.get("units", "si"))
    if system not in UNITS:
        raise BadInput(", ".join(UNITS), path, "units", system)
    units = UNITS[system]
    frequencies = array_of(data, "frequencies_hz", (None,), path)
    n = len(frequencies)
    if not (frequencies > 0.0).all():
        raise BadInput(f"frequencies_hz: {frequencies.min():g} is not positive", path)
    ratios = array_of(data, "damping_ratios", (n,), path) if "damping_ratios" in data else None
    if ratios is not None and not ((ratios >= 0.0) & (ratios < 1.0)).all():
        raise BadInput(f"damping_ratios: {ratios} are not all in 0 to 1", path)
    mass = modal_masses(data, n, path)
    rigid = _rigid(data, path)
    if "points" in data:
        integrals, mass, tip, line, line_shape = _from_points(data, n, mass, rigid, path)
    elif "translation" in data:
        integrals, mass = _from_participation(data, n, mass, rigid, path)
        tip = AppendagePoint(np.zeros(3), np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n)))
        line, line_shape = np.zeros((2, 3)), np.zeros((2, 3, n))
    else:
        raise BadInput("points or translation: missing; give mode shapes or participation", path)
    omega = 2.0 * np.pi * frequencies
    integrals = replace(integrals, shortening=_geometric(data, n, path))
    integrals = _converted(integrals, units.length, units.mass)
    damping = None if ratios is None else np.diag(2.0 * ratios * omega * mass * units.mass)
    return FlexibleShape(
        integrals,
        mass * units.mass,
        mass * units.mass * omega**2,
        AppendagePoint(
            tip.place * units.length,
            tip.displacement,
            tip.turn / units.length,
            tip.curvature / units.length**2,
        ),
        line * units.length,
        line_shape,
        None,
        damping,
    )


def _read(path: Path, content: bytes) -> dict[str, Any]:
    """Return what the file holds, by key."""
    try:
        if path.suffix == ".npz":
            data: dict[str, Any] = dict(read_npz(BytesIO(content)))
            for key in [k for k in data if k.startswith("rigid_")]:
                data.setdefault("rigid", {})[key.removeprefix("rigid_")] = data.pop(key)
            return {k: v.item() if getattr(v, "shape", 1) == () else v for k, v in data.items()}
        text = TextIOWrapper(BytesIO(content), encoding="utf-8").read()
    except ValueError as error:
        raise BadInput(f"cannot be read as modal data: {error}", path) from None
    if path.suffix == ".csv":
        return _read_csv(text, path)
    data = load_yaml(text, str(path))
    if not isinstance(data, dict):
        raise BadInput("modal data must be a mapping of keys", path)
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
        raise BadInput(f"the table must be rows of numbers: {error}", path) from None
    if table.ndim != 2 or table.shape[1] < 7 or (table.shape[1] - 4) % 3:
        raise BadInput(
            f"the table has shape {table.shape}; allowed: x, y, z, mass and three columns per mode",
            path,
        )
    shapes = table[:, 4:].reshape(len(table), -1, 3).transpose(1, 0, 2)
    return {**data, "points": table[:, :3], "masses": table[:, 3], "shapes": shapes}


def _rigid(data: dict[str, Any], path: Path) -> tuple[float, Vector, Matrix] | None:
    """Return mass, first moment and inertia as the file gives them."""
    given = data.get("rigid")
    if given is None:
        return None
    if not isinstance(given, dict):
        raise BadInput("rigid: must give mass, first_moment and inertia", path)
    require_known(given, _RIGID, path, "rigid")
    mass = float(array_of(given, "mass", (), path))
    if not mass > 0.0:
        raise BadInput(f"rigid.mass: {mass:g} is not positive", path)
    first, inertia = (
        array_of(given, "first_moment", (3,), path),
        array_of(given, "inertia", (3, 3), path),
    )
    return mass, first, inertia


def _from_points(
    data: dict[str, Any],
    n: int,
    mass: Vector | None,
    rigid: tuple[float, Vector, Matrix] | None,
    path: Path,
) -> tuple[Integrals, Vector, AppendagePoint, Matrix, Matrix]:
    """Return sums, modal masses, tip and a line to draw, from mass points and mode shapes."""
    points = array_of(data, "points", (None, 3), path)
    k = len(points)
    masses = array_of(data, "masses", (k,), path)
    if not (masses > 0.0).all():
        raise BadInput(f"masses: {masses.min():g} is not positive", path)
    shapes = array_of(data, "shapes", (n, k, 3), path).transpose(1, 2, 0)
    zeros = np.zeros((k, 3, n, n))
    integrals = integrals_of(Points(points, masses, shapes, zeros))
    if "translation" in data or "rotation" in data:
        first_order, mass = _from_participation(data, n, mass, rigid, path)
        require_mass(integrals, first_order.mass, path)
        integrals = replace(
            first_order,
            second_1=integrals.second_1,
            second_2=integrals.second_2,
            gyroscopic=integrals.gyroscopic,
        )
        rigid = None
    else:
        mass = _mass_of_points(integrals, mass, path)
    if rigid is not None:
        compare_rigid(integrals, rigid, path)
    at = data.get("tip", int(np.argmax(np.linalg.norm(points, axis=1))))
    number = isinstance(at, int | float) and not isinstance(at, bool)
    if not (number and 0 <= at < k and float(at).is_integer()):
        raise BadInput(f"a whole number from 0 to {k - 1}", path, "tip", at)
    at = int(at)
    tip = AppendagePoint(points[at], shapes[at], np.zeros((3, n)), np.zeros((3, n)))
    line, line_shape = _centre_line(points, masses, shapes)
    return integrals, mass, tip, line, line_shape


def _mass_of_points(integrals: Integrals, mass: Vector | None, path: Path) -> Vector:
    """Return the modal masses, shape (n,), which must be those of the points."""
    mass_matrix = np.einsum("ijaa->ij", integrals.second_2) / 2.0
    lowest = float(np.linalg.eigvalsh(mass_matrix).min())
    if lowest <= 1e-12 * float(abs(mass_matrix).max()):
        raise BadInput(
            f"shapes: are not independent: their mass matrix has eigenvalue {lowest:.3g}", path
        )
    if mass is None:
        require_orthogonal(mass_matrix, "shapes", path)
        mass = np.diag(mass_matrix).copy()
    elif not np.allclose(np.diag(mass_matrix), mass, rtol=MASS_TOLERANCE):
        largest = int(np.argmax(abs(np.diag(mass_matrix) / mass - 1.0)))
        ratio = float(mass[largest] / mass_matrix[largest, largest])
        raise BadInput(
            f"modal_mass: mode {largest + 1} has {mass[largest]:.6g}, its points sum to "
            f"{mass_matrix[largest, largest]:.6g}{hint(ratio, 'mass')}",
            path,
        )
    return mass


def _centre_line(points: Matrix, masses: Vector, shapes: Matrix) -> tuple[Matrix, Matrix]:
    """Return places to draw it through from the hinge on, and what the modes do there.

    Points at one distance along its longest direction are drawn as their mean.
    """
    along = np.linalg.svd(points * np.sqrt(masses)[:, None], full_matrices=False)[2][0]
    distance = points @ along
    distance = distance * np.sign(distance.sum() or 1.0)
    size = max(float(np.ptp(distance)), 1e-9)
    _, group = np.unique(np.round(distance / size, 3), return_inverse=True)
    count = np.bincount(group).astype(float)
    line, line_shape = np.zeros((len(count), 3)), np.zeros((len(count), *shapes.shape[1:]))
    np.add.at(line, group, points)
    np.add.at(line_shape, group, shapes)
    line = np.vstack((np.zeros(3), line / count[:, None]))
    zero_row = np.zeros((1, *shapes.shape[1:]))
    return line, np.concatenate((zero_row, line_shape / count[:, None, None]))


def _from_participation(
    data: dict[str, Any],
    n: int,
    mass: Vector | None,
    rigid: tuple[float, Vector, Matrix] | None,
    path: Path,
) -> tuple[Integrals, Vector]:
    """Return sums from participation factors; what needs shapes is left out."""
    if rigid is None:
        raise BadInput("rigid: missing; participation factors need the rigid sums", path)
    weight, first, inertia = rigid
    mass = np.ones(n) if mass is None else mass
    translation, rotation = (
        array_of(data, key, (3, n), path) for key in ("translation", "rotation")
    )
    second = second_of(inertia)
    return first_order_integrals(weight, first, second, translation, rotation), mass


def _geometric(data: dict[str, Any], n: int, path: Path) -> Shortening | None:
    """Return the geometric stiffness of the file; None where it has none."""
    given = data.get("geometric_stiffness")
    if given is None:
        return None
    if not isinstance(given, dict):
        raise BadInput("geometric_stiffness: must give uniform and linear", path)
    require_known(given, _GEOMETRIC, path, "geometric_stiffness")
    uniform = array_of(given, "uniform", (3, n, n), path)
    linear = array_of(given, "linear", (3, 3, n, n), path)
    for key, matrices in (("uniform", uniform), ("linear", linear)):
        if not np.allclose(matrices, matrices.swapaxes(-1, -2), rtol=1e-4, atol=1e-9):
            raise BadInput(f"{path}: geometric_stiffness.{key}: is not symmetric in the modes")
    return Shortening(uniform.transpose(1, 2, 0), linear.transpose(2, 3, 1, 0))


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
        None
        if i.shortening is None
        else Shortening(i.shortening.first * mass / length, i.shortening.second * mass),
    )
