"""OUTPUT4 files of Nastran are read as pyYeti writes them, and as the manual shows them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.finite_elements.frames import ANGLE, arrays, saved

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)

FOUR = ImportOptions(modes=4)
FORMS = ("dense", "bigmat", "nonbigmat")


def text(name: str, matrix: Any, form: str) -> str:
    """Return a matrix as OUTPUT4 writes text: columns of five numbers per line, two words each."""
    rows, columns = matrix.shape
    lines = [f"{columns:8d}{-rows if form == 'bigmat' else rows:8d}{2:8d}{2:8d}{name:8s}1P,5E16.9"]
    for k, column in enumerate(matrix.T, start=1):
        (at,) = np.nonzero(column)
        if not len(at):
            continue
        values = column[at[0] : at[-1] + 1]
        count, first = len(values), int(at[0]) + 1
        if form == "dense":
            lines.append(f"{k:8d}{first:8d}{count:8d}")
        elif form == "bigmat":
            lines += [f"{k:8d}{0:8d}{2 * count + 2:8d}", f"{2 * count + 1:8d}{first:8d}"]
        else:
            packed = first + 65536 * (2 * count + 1)
            lines += [f"{k:8d}{0:8d}{2 * count + 1:8d}", f"{packed:12d}"]
        for start in range(0, count, 5):
            lines.append("".join(f"{v:16.9E}" for v in values[start : start + 5]))
    lines += [f"{columns + 1:8d}{1:8d}{1:8d}", f"{1.0:16.9E}"]
    return "\n".join(lines) + "\n"


def model(folder: Path, form: str = "dense", **changes: Any) -> Path:
    data = {**arrays(ANGLE, 3), **changes}
    path = folder / "model.op4"
    matrices = {"MAA": data["M"], "KAA": data["K"], "NODES": data["nodes"],
                "BOUNDARY": data["boundary"][:, None] + 1.0}  # fmt: skip
    path.write_text("".join(text(name, matrix, form) for name, matrix in matrices.items()))
    return path


@pytest.mark.parametrize("form", FORMS)
def test_text_is_read_in_every_form(tmp_path: Path, form: str) -> None:
    """Ten digits of a stiffness leave five of the slowest frequencies."""
    expected = import_model(saved(tmp_path, **arrays(ANGLE, 3)), FOUR).content
    found = import_model(model(tmp_path, form), FOUR).content
    for key in ("frequencies_hz", "translation", "rotation", "points"):
        np.testing.assert_allclose(found[key], expected[key], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("binary", [True, False])
def test_what_pyyeti_writes_is_read(tmp_path: Path, form: str, order: str, binary: bool) -> None:
    op4 = pytest.importorskip("pyyeti.nastran.op4", reason="pyyeti is not installed")
    data = arrays(ANGLE, 3)
    matrices = {"maa": data["M"], "kaa": data["K"], "nodes": data["nodes"],
                "boundary": data["boundary"][:, None] + 1.0}  # fmt: skip
    path = tmp_path / "model.op4"
    op4.write(str(path), matrices, binary=binary, endian=order, sparse=form)
    found = import_model(path, FOUR).content["frequencies_hz"]
    expected = import_model(saved(tmp_path, **data), FOUR).content["frequencies_hz"]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def binary(name: str, matrix: Any, order: str) -> bytes:
    """Return a dense matrix of two words per number in records of Fortran."""

    def record(*parts: Any) -> bytes:
        content = b"".join(part if isinstance(part, bytes) else part.tobytes() for part in parts)
        mark = np.array(len(content), f"{order}i4").tobytes()
        return mark + content + mark

    def ints(*values: int) -> Any:
        return np.array(values, f"{order}i4")

    rows, columns = matrix.shape
    content = record(ints(columns, rows, 2, 2), name.ljust(8).encode())
    for k, column in enumerate(matrix.T, start=1):
        content += record(ints(k, 1, 2 * rows), column.astype(f"{order}f8"))
    return content + record(ints(columns + 1, 1, 2), np.array(1.0, f"{order}f8"))


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_files_of_both_byte_orders_are_read(tmp_path: Path, order: str) -> None:
    data = arrays(ANGLE, 3)
    path = tmp_path / "model.op4"
    path.write_bytes(binary("KAA", data["K"], order) + binary("MAA", data["M"], order))
    found = import_model(path, ImportOptions(("1-6",), 4)).content["frequencies_hz"]
    expected = import_model(saved(tmp_path, **data), FOUR).content["frequencies_hz"]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "K: missing|M: missing|no record of 24 bytes"),
        (b"12", "not an OUTPUT4 file"),
        (b"\x18\0\0\0" + bytes(24) + b"\x18\0\0\0", "not an OUTPUT4 file"),
        (b"\x30\0\0\0" + bytes(48) + b"\x30\0\0\0", "64 bits are not read"),
        (b"       3       3       2       4KAA     1P,5E16.9\n", "type 4; 1 and 2 are real"),
        (b"99999999       3       2       2KAA     1P,5E16.9\n", "99999999"),
        (b"       3       3       2       2KAA     1P,5E16.9\n       1       1", "OUTPUT4"),
    ],
)
def test_what_is_no_output4_file_is_refused_in_one_line(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "model.op4"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=words) as error:
        import_model(path, FOUR)
    assert "\n" not in str(error.value)
