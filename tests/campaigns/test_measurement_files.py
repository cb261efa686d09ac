"""Files of measurements that are damaged: one line, or numbers, never a traceback."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.identification.records.foreign import external_record
from flexslew_lab.identification.responses.universal import read_modal_data, read_responses
from flexslew_plant.errors import FlexslewError
from tests.lab.identification.responses.test_universal import beam
from tests.lab.identification.test_files import INPUTS, OUTPUTS, WRITERS, table

FILES = tuple(name for name in WRITERS if "." in name)


def damaged(content: bytes, case: np.random.Generator) -> bytes:
    """Return bytes that are flipped, cleared, doubled, dropped, cut off or other text."""
    found = bytearray(content)
    for _ in range(int(case.integers(1, 4))):
        at, size = int(case.integers(len(found))), int(case.integers(1, 200))
        if case.random() < 0.3:
            at = min(at, 600)  # headers lie there
        how = str(case.choice(["flip", "zero", "double", "drop", "noise", "cut", "digit"]))
        part = bytes(found[at : at + size])
        if how == "flip":
            found[at] ^= 1 << int(case.integers(8))
        elif how == "cut":
            del found[max(at, 1) :]
        elif how == "digit":
            found[at : at + 1] = str(
                case.choice(["9", "-", "e", ",", "\n", '"', "99999999"])
            ).encode()
        else:
            new = {"zero": bytes(size), "double": 2 * part, "drop": b"", "noise": case.bytes(size)}
            found[at : at + size] = new[how]
    return bytes(found)


def test_a_damaged_file_of_measurements_is_refused_in_one_line_or_read(
    tmp_path: Path, case: np.random.Generator
) -> None:
    name = str(case.choice(FILES))
    WRITERS[name](tmp_path / name, table(100))
    content = (tmp_path / name).read_bytes()
    for _ in range(5):
        (tmp_path / name).write_bytes(damaged(content, case))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                found = external_record(tmp_path / name, INPUTS, OUTPUTS).record
            except FlexslewError as error:
                assert str(error).isprintable()  # noqa: PT017
                continue
        assert np.isfinite(found.measured).all()


def test_damaged_modes_of_a_test_are_refused_in_one_line_or_read(
    tmp_path: Path, case: np.random.Generator
) -> None:
    pytest.importorskip("pyuff")
    path = tmp_path / "a.unv"
    beam(path)
    content = path.read_bytes()
    for _ in range(10):
        path.write_bytes(damaged(content, case))
        for read in (lambda: read_modal_data(path, 1.0), lambda: read_responses(path)):
            try:
                read()
            except FlexslewError as error:
                assert str(error).isprintable()  # noqa: PT017
