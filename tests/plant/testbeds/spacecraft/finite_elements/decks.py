"""Input decks of CalculiX: solids of twenty-node bricks on a lattice, and a run of ccx."""

import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

Cell = tuple[int, int, int]
_CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
_EDGES = [
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6)),
    *((6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
]
BRICK = _CORNERS + [
    tuple((p + q) // 2 for p, q in zip(_CORNERS[a], _CORNERS[b], strict=True)) for a, b in _EDGES
]


def block(nx: int, ny: int, nz: int) -> list[Cell]:
    return [(i, j, k) for i in range(nx) for j in range(ny) for k in range(nz)]


def deck(
    cells: Iterable[Cell],
    size: tuple[float, float, float],
    youngs: float = 70e9,
    poisson: float = 0.3,
    element: str = "C3D20",
) -> str:
    """Return a deck that stores the matrices of cells of this size; ROOT are the nodes at x = 0."""
    numbers: dict[tuple[int, ...], int] = {}
    elements = []
    for cell in cells:
        places = [tuple(2 * c + o for c, o in zip(cell, at, strict=True)) for at in BRICK]
        elements.append([numbers.setdefault(place, len(numbers) + 1) for place in places])
    lines = ["*NODE, NSET=NALL"]
    for place, number in numbers.items():
        at = ", ".join(f"{p * s / 2.0:.9g}" for p, s in zip(place, size, strict=True))
        lines.append(f"{number}, {at}")
    lines.append(f"*ELEMENT, TYPE={element}, ELSET=EALL")
    for number, nodes in enumerate(elements, start=1):
        lines += [f"{number}, {', '.join(map(str, nodes[:10]))},", ", ".join(map(str, nodes[10:]))]
    lines += ["*NSET, NSET=ROOT", *(f"{n}," for place, n in numbers.items() if place[0] == 0)]
    lines += ["*MATERIAL, NAME=METAL", "*ELASTIC", f"{youngs:g}, {poisson:g}"]
    lines += ["*DENSITY", "2700", "*SOLID SECTION, ELSET=EALL, MATERIAL=METAL"]
    lines += ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "1", "*END STEP"]
    return "\n".join(lines) + "\n"


def computed(folder: Path, text: str) -> Path:
    """Return a deck next to the matrices that CalculiX computed of it; skip where it is absent."""
    ccx = shutil.which("ccx")
    if ccx is None:
        pytest.skip("CalculiX is not installed: apt-get install calculix-ccx")
    path = folder / "model.inp"
    path.write_text(text)
    subprocess.run([ccx, "model"], cwd=folder, check=True, capture_output=True, timeout=300)
    return path


def with_modes(text: str, modes: int) -> str:
    """Return a deck that computes modes with ROOT clamped, and masses, in place of matrices."""
    step = f"*BOUNDARY\nROOT, 1, 3\n*STEP\n*FREQUENCY\n{modes}\n*NODE FILE\nU\n"
    return (
        text.partition("*STEP")[0] + step + "*EL PRINT, ELSET=EALL, TOTALS=YES\nEMAS\n*END STEP\n"
    )


def truss_files(folder: Path) -> Path:
    """Return a deck with the stored matrices of rods between four nodes and a tip, by hand."""
    places = np.array(
        [[0, 0, 0], [0, 1, 0], [0, 0, 1], [1.5, 0.3, 0.3], [3, 0.2, 0.1]], dtype=float
    )
    stiffness = np.zeros((15, 15))
    for a in range(5):
        for b in range(a + 1, 5):
            along = places[b] - places[a]
            rod = 1e4 * np.outer(along, along) / np.linalg.norm(along) ** 3
            for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
                stiffness[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += sign * rod
    nodes = "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(places, start=1))
    (folder / "model.inp").write_text(f"** rods\n*NODE\n{nodes}*NSET, NSET=ROOT\n1, 2,\n3\n")
    (folder / "model.dof").write_text("".join(f"{k}.{d}\n" for k in range(1, 6) for d in (1, 2, 3)))
    for ending, matrix in ((".sti", stiffness), (".mas", 2.0 * np.eye(15))):
        rows = [f"{i + 1} {j + 1}  {matrix[i, j]:.13e}\n" for j in range(15) for i in range(j + 1)]
        (folder / f"model{ending}").write_text("".join(rows))
    return folder / "model.inp"
