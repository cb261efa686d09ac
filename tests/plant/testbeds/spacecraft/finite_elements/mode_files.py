"""Result files of CalculiX, written by hand: two modes of three masses on a line."""

from pathlib import Path

import numpy as np
from scipy.linalg import eigh

LUMPS = np.array([1.0, 2.0, 1.0])
PLACES = np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [2.0, 0.0, 0.5]])
STIFFNESS = np.array([[500.0, -160.0], [-160.0, 60.0]])
SQUARES, BENDING = eigh(STIFFNESS, np.diag(LUMPS[1:]))
SHAPES = np.zeros((3, 3, 2))
SHAPES[1:, 2] = BENDING  # along z; the first node is clamped


def rod_files(folder: Path) -> Path:
    """Return an .frd next to its .dat; two rods of 2 kg join the nodes 1, 2 and 3."""
    (folder / "model.frd").write_text(_frd())
    (folder / "model.dat").write_text(_dat())
    return folder / "model.frd"


def _frd() -> str:
    def rows(values: np.ndarray) -> list[str]:
        return [f" -1{k:10d}" + "".join(f"{x:12.5E}" for x in row)
                for k, row in enumerate(values, start=1)]  # fmt: skip

    lines = ["    1C", f"    2C{3:30d}{1:38d}", *rows(PLACES), " -3"]
    lines += [f"    3C{2:30d}{1:38d}"]
    for k in (1, 2):
        lines += [f" -1{k:10d}   11    0    1", f" -2{k:10d}{k + 1:10d}"]
    lines.append(" -3")
    for k, square in enumerate(SQUARES):
        cycles = np.sqrt(square) / (2.0 * np.pi)
        lines += [f"  100CL  10{k + 1} {cycles:.9f}"[:24], " -4  DISP        4    1"]
        lines += [" -5  D1          1    2    1    0", *rows(SHAPES[..., k]), " -3"]
    return "\n".join([*lines, " 9999"]) + "\n"


def _dat() -> str:
    def rows(values: np.ndarray, first: int | None = None) -> list[str]:
        heads = [""] * len(values) if first is None else [f"{k:7d}" for k in (1, 2)]
        return [head + "".join(f"{x:16.7E}" for x in row)
                for head, row in zip(heads, values, strict=True)]  # fmt: skip

    forces = np.einsum("i,ijm->mj", LUMPS, SHAPES)
    torques = np.einsum("i,imj->mj", LUMPS, np.cross(PLACES[:, None], SHAPES.swapaxes(1, 2)))
    second = np.einsum("i,ij,ik->jk", LUMPS, PLACES, PLACES)
    moments = [second[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    inner = np.einsum("i,ij,ik->jk", LUMPS[1:], PLACES[1:], PLACES[1:])
    totals = [3.0] * 3 + list(np.trace(inner) - np.diag(inner))
    omegas = np.sqrt(SQUARES)
    modes = np.column_stack((SQUARES, omegas, omegas / (2.0 * np.pi), np.zeros(2)))
    elements = np.column_stack((np.full(2, 2.0), np.zeros((2, 6))))
    centre = LUMPS @ PLACES / 4.0
    name = "for set EALL and time  0.1000000E+01"
    lines = ["     E I G E N V A L U E   O U T P U T", " MODE NO    EIGENVALUE", *rows(modes, 1)]
    lines += ["     P A R T I C I P A T I O N   F A C T O R S", "MODE NO.   X-COMPONENT"]
    lines += rows(np.hstack((forces, torques)), 1)
    lines += ["     T O T A L   E F F E C T I V E   M A S S", *rows(np.array([totals]))]
    for _ in omegas:  # which CalculiX repeats per mode
        lines += [
            f" mass (element, mass) and mass moment of itertia(xx) {name}",
            *rows(elements, 1),
        ]
        lines += [f" total mass {name}", "  4.000000E+00"]
        lines += [f" total mass moment of inertia (xx,yy,zz,xy,xz,yz) {name}"]
        lines += [*rows(np.array([moments])), f" center of gravity {name}"]
        lines += [*rows(centre[None]), f" total mass moment of inertia about the center {name}"]
        lines += rows(np.array([moments]))
    return "\n\n".join(lines) + "\n"
