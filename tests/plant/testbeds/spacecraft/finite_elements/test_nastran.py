"""Punch and output2 files of Nastran are the models that their matrices are in an .npz file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh
from tests.plant.testbeds.spacecraft.finite_elements.frames import ANGLE, Array, arrays, saved
from tests.plant.testbeds.spacecraft.finite_elements.test_op4 import binary as op4_binary

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)

pytest.importorskip("pyyeti")

FOUR = ImportOptions(("1",), 4)
TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # rows: axes of CORD2R 10
CORD = (
    "CORD2R*               10               0 0.000000000E+00 0.000000000E+00\n"
    "*        0.000000000E+00 1.000000000E+00 0.000000000E+00 0.000000000E+00\n"
    "*        0.000000000E+00 1.000000000E+00 0.000000000E+00\n"
)


def grids(places: Array, turned: int) -> str:
    """Return GRID cards, numbers from 1; one of them with axes of its own."""
    lines = [CORD]
    for number, place in enumerate(places, start=1):
        x, y, z = (f"{value:16.9E}" for value in place)
        axes = 10 if number == turned else 0
        lines.append(f"GRID*   {number:16d}{0:16d}{x}{y}\n*       {z}{axes:16d}\n")
    return "".join(lines)


def dmig(name: str, matrix: Array, rows: list[tuple[int, int]]) -> str:
    """Return the lower half of a symmetric matrix as DMIG cards with ten digits."""
    lines = [f"DMIG    {name:8s}{0:8d}{6:8d}{2:8d}{0:8d}{'':16s}{len(rows):8d}\n"]
    for column, (number, direction) in enumerate(rows):
        at = column + np.flatnonzero(matrix[column:, column])
        if not len(at):
            continue
        lines.append(f"DMIG*   {name:16s}{number:16d}{direction:16d}\n")
        for k in at:
            value = f"{matrix[k, column]:16.9E}".replace("E", "D")
            lines.append(f"*       {rows[k][0]:16d}{rows[k][1]:16d}{value}\n")
    return "".join(lines)


def extrn(rows: list[tuple[int, int]]) -> str:
    """Return an EXTRN card: four nodes and their directions per line."""
    nodes: dict[int, str] = {}
    for number, direction in rows:
        nodes[number] = nodes.get(number, "") + str(direction)
    fields = [f"{number:8d}{directions:>8s}" for number, directions in nodes.items()]
    lines = ["".join(fields[k : k + 4]) for k in range(0, len(fields), 4)]
    return "EXTRN   " + "\n        ".join(lines) + "\n"


def model() -> tuple[Any, list[tuple[int, int]], Array]:
    """Return the arrays of a frame, its rows, and what turns node 2 into its own axes."""
    data = arrays(ANGLE, 3)
    rows = [(node + 1, k + 1) for node in range(len(data["nodes"])) for k in range(6)]
    axes = [TURN if node == 1 else np.eye(3) for node in range(len(data["nodes"]))]
    return data, rows, block_diag(*(np.kron(np.eye(2), a) for a in axes))


def dmig_file(folder: Path, places_in: str = ".pch") -> Path:
    data, rows, turn = model()
    path = folder / "frame.pch"
    cards = "".join(dmig(f"{m}AAX", turn @ data[m] @ turn.T, rows) for m in "MK")
    path.write_text("BEGIN SUPER 7\n" + cards)
    with path.with_suffix(places_in).open("a") as file:
        file.write(grids(data["nodes"], 2) + "ENDDATA\n")
    return path


def op4_file(folder: Path) -> Path:
    data, rows, turn = model()
    path = folder / "frame.pch"
    path.write_text(extrn(rows) + grids(data["nodes"], 2))
    matrices = {f"{m}XX": turn @ data[m] @ turn.T for m in "MK"} | {"BXX": np.zeros((1, 1))}
    path.with_suffix(".op4").write_bytes(
        b"".join(op4_binary(name, matrix, "<") for name, matrix in matrices.items())
    )
    return path


def op2_file(folder: Path, order: str = "<") -> Path:
    data, _, _ = model()
    path = folder / "frame.op2"
    matrices = {"MAA": data["M"], "KAA": data["K"], "NODES": data["nodes"],
                "BOUNDARY": data["boundary"][:, None] + 1.0}  # fmt: skip
    path.write_bytes(output2(matrices, order))
    return path


def op2_beside(folder: Path) -> Path:
    data, rows, turn = model()
    path = folder / "frame.pch"
    path.write_text(extrn(rows) + grids(data["nodes"], 2))
    matrices = {f"{m}AA": turn @ data[m] @ turn.T for m in "MK"}
    path.with_suffix(".op2").write_bytes(output2(matrices, "<"))
    return path


def output2(matrices: dict[str, Array], order: str) -> bytes:
    """Return an output2 file of dense matrices of double precision."""

    def ints(*values: int) -> bytes:
        return np.array(values, f"{order}i4").tobytes()

    def record(content: bytes) -> bytes:
        return ints(len(content)) + content + ints(len(content))

    def keys(*values: int) -> bytes:
        return b"".join(record(ints(value)) for value in values)

    content = keys(3) + record(ints(11, 30, 26)) + keys(7) + record(b"NASTRAN FORT TAPE ID CODE - ")
    content += keys(2) + record(b"XXXXXXXX") + keys(-1, 0)
    for name, matrix in matrices.items():
        label, (rows, columns) = name.ljust(8).encode(), matrix.shape
        content += keys(2) + record(label) + keys(-1, 7)
        content += record(ints(101, columns, rows, 6, 2, rows, 10000)) + keys(-2, 1, 0)
        content += keys(2) + record(label) + keys(-3, 1, 1)
        for k, column in enumerate(matrix.T):
            values = np.asarray(column, f"{order}f8").tobytes()
            content += keys(1 + 2 * rows) + record(ints(1) + values) + keys(-(4 + k))
            content += keys(1, 1 if k + 1 < columns else 0)
        content += keys(0)
    return content + keys(0)


FILES: dict[str, tuple[Callable[[Path], Path], float]] = {
    "DMIG cards": (dmig_file, 1e-4),  # ten digits of a stiffness leave five of a frequency
    "DMIG cards, places in the input": (lambda folder: dmig_file(folder, ".bdf"), 1e-4),
    "DMIG cards, places in the assembly": (lambda folder: dmig_file(folder, ".asm"), 1e-4),
    "OUTPUT4 beside": (op4_file, 1e-8),
    "output2 beside": (op2_beside, 1e-8),
    "output2": (op2_file, 1e-8),
    "output2, other byte order": (lambda folder: op2_file(folder, ">"), 1e-8),
}


@pytest.mark.parametrize("name", FILES)
def test_a_model_is_that_of_its_matrices(tmp_path: Path, name: str) -> None:
    write, accuracy = FILES[name]
    expected = import_model(saved(tmp_path, **arrays(ANGLE, 3)), FOUR).content
    found = import_model(write(tmp_path), FOUR).content
    for key in ("frequencies_hz", "translation", "rotation", "points", "masses"):
        np.testing.assert_allclose(found[key], expected[key], rtol=accuracy, atol=accuracy)
    assert found["rigid"]["mass"] == pytest.approx(expected["rigid"]["mass"], rel=accuracy)


@pytest.mark.parametrize("turned", [1, 2])
def test_a_reduced_model_moves_its_interface_as_one_rigid_body(tmp_path: Path, turned: int) -> None:
    """Two grids and all clamped modes as scalar points are the whole model on those two nodes."""
    data, rows, _ = model()
    held, size = 12, len(rows)
    mass, stiffness = data["M"], data["K"]
    inner = np.ix_(range(held, size), range(held, size))
    squares, modes = eigh(stiffness[inner], mass[inner])
    follow = -np.linalg.solve(stiffness[inner], stiffness[held:, :held])
    change = np.block([[np.eye(held), np.zeros((held, size - held))], [follow, modes]])
    axes = [TURN if node + 1 == turned else np.eye(3) for node in range(2)]
    turn = block_diag(*(np.kron(np.eye(2), a) for a in axes), np.eye(size - held))
    path = tmp_path / "reduced.pch"
    scalar = [(1001 + k, 0) for k in range(size - held)]
    path.write_text(extrn(rows[:held] + scalar) + grids(data["nodes"][:2], turned))
    content = b""
    for name in "MK":
        reduced = turn @ change.T @ data[name] @ change @ turn.T
        content += op4_binary(f"{name}XX", reduced, "<")
    path.with_suffix(".op4").write_bytes(content)
    found = import_model(path, ImportOptions((), 4)).content
    expected = import_model(saved(tmp_path, **data), ImportOptions(("1", "2"), 4)).content
    np.testing.assert_allclose(
        found["frequencies_hz"], np.sqrt(squares[:4]) / (2.0 * np.pi), rtol=1e-7
    )
    signs = np.sign(np.sum(np.array(found["rotation"]) * np.array(expected["rotation"]), axis=0))
    for key in ("frequencies_hz", "translation", "rotation"):
        turned_signs = signs if key != "frequencies_hz" else 1.0
        np.testing.assert_allclose(
            np.array(found[key]) * turned_signs, expected[key], rtol=1e-6, atol=1e-7
        )
    for key in ("mass", "first_moment", "inertia"):
        np.testing.assert_allclose(found["rigid"][key], expected["rigid"][key], atol=1e-7)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    data, rows, _ = model()
    path = tmp_path / "frame.pch"
    for text, words in (
        ("GRID,1,,0.,0.,0.\n", "neither DMIG cards of mass and stiffness nor EXTRN cards"),
        (extrn(rows), r"frame.op4 or .op2 is missing"),
        (dmig("KAAX", data["K"], rows), "M: missing: mass M and stiffness K are needed, as MAA"),
        ("".join(dmig(f"{m}AAX", data[m], rows) for m in "MK"), "no GRID cards"),
    ):
        path.write_text(text)
        with pytest.raises(BadInput, match=words):
            import_model(path, FOUR)
    points = [(1001 + k, 0) for k in range(3)]
    path.write_text("".join(dmig(f"{m}AAX", np.eye(3), points) for m in "MK"))
    with pytest.raises(BadInput, match="it has scalar points alone"):
        import_model(path, FOUR)
    path.write_text(extrn(rows[:-1]) + grids(data["nodes"], 2))
    path.with_suffix(".op4").write_bytes(b"".join(op4_binary(f"{m}XX", data[m], "<") for m in "MK"))
    with pytest.raises(BadInput, match=r"frame.pch names 41 rows"):
        import_model(path, FOUR)
    cut = rows[:6] + rows[7:]
    kept = [k for k in range(len(rows)) if k != 6]
    path.write_text(
        "".join(dmig(f"{m}AAX", data[m][np.ix_(kept, kept)], cut) for m in "MK")
        + grids(data["nodes"], 2)
    )
    with pytest.raises(BadInput, match="GRID: 2 is not allowed: its displacements have axes of"):
        import_model(path, FOUR)


def refusal(path: Path) -> str:
    """Return why a file is refused, or nothing."""
    try:
        import_model(path, FOUR)
    except BadInput as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", ["DMIG cards", "OUTPUT4 beside", "output2"])
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = FILES[name][0](tmp_path)
    whole = path.read_bytes()
    random = np.random.default_rng(7)
    for trial in range(6):
        damaged = bytearray(whole[: random.integers(1, len(whole))] if trial % 3 == 0 else whole)
        for place in random.integers(0, len(damaged), 0 if trial == 0 else 1 + trial):
            damaged[place] = random.integers(0, 256)
        path.write_bytes(damaged)
        assert "\n" not in refusal(path)


def test_an_output2_file_that_claims_a_large_matrix_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "large.op2"
    content = output2({"KAA": np.eye(3)}, "<")
    size = np.array([3, 3], "<i4").tobytes()
    at = content.index(np.array([101, 3, 3], "<i4").tobytes()) + 4
    assert content[at : at + 8] == size
    path.write_bytes(
        content[:at] + np.array([100_000, 90_000], "<i4").tobytes() + content[at + 8 :]
    )
    with pytest.raises(BadInput, match=r"KAA has 90000 x 100000 numbers, at most 9,000,000"):
        import_model(path, FOUR)
