"""What an .npz file takes in memory is known before anything is unpacked."""

import resource
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from flexslew_plant.errors import BadInput
from flexslew_plant.npz_file import LARGEST, read_npz
from flexslew_plant.system_file import system_from_file
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape


def entry(shape: str, kind: str = "<f8", body: bytes = b"", version: int = 1) -> bytes:
    """Return an .npy file whose header claims a shape."""
    header = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}}}".encode() + b"\n"
    return b"\x93NUMPY" + struct.pack("<BBH", version, 0, len(header)) + header + body


def archive(path: Path, **entries: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in entries.items():
            file.writestr(f"{name}.npy", content)
    return path


def zeros(path: Path) -> Path:
    """Write 300 MiB of zeros into a file of about 2 MB."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        for name in "ABC":
            file.writestr(f"{name}.npy", entry("(3620, 3620)", body=bytes(8 * 3620**2)))
    return path


CRAFTED = {
    "a count of 1e13": ("(10000000000000,)", "<f8", 1),
    "a product of 1e24": ("(1000000000000, 1000000000000)", "<f8", 1),
    "a large item": ("(2,)", "|V1000000000", 1),
    "a negative count": ("(-5, -5)", "<f8", 1),
    "objects": ("(1,)", "|O", 1),
    "another version": ("(1,)", "<f8", 9),
}


@pytest.mark.parametrize("name", CRAFTED)
@pytest.mark.parametrize("read", [read_npz, modal_shape, lambda p: system_from_file(str(p), "x")])
def test_a_header_that_claims_more_than_there_is_is_refused_in_one_line(
    tmp_path: Path, name: str, read: Callable[[Path], object]
) -> None:
    shape, kind, version = CRAFTED[name]
    path = archive(tmp_path / "a.npz", A=entry(shape, kind, bytes(80), version))
    with pytest.raises((ValueError, BadInput)) as error:
        read(path)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_small_file_that_unpacks_to_much_is_refused_before_it_is_unpacked(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.npz"
    program = "import sys; from tests.plant.test_npz_file import *; zeros(Path(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", program, path], check=True, cwd=Path(__file__).parents[2])
    assert path.stat().st_size < 3e6
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for read in (read_npz, modal_shape, lambda p: system_from_file(str(p), "x")):
        with pytest.raises((ValueError, BadInput), match=f"at most {LARGEST >> 20} are read"):
            read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # [KiB]


def test_damage_anywhere_is_refused_as_a_wrong_value(tmp_path: Path) -> None:
    whole = BytesIO()
    rng = np.random.default_rng(1)
    np.savez_compressed(whole, A=rng.normal(size=(4, 4)), B=np.eye(2))
    content = whole.getvalue()
    refused = 0
    for place in range(0, len(content), 3):
        damaged = bytearray(content)
        damaged[place] ^= 1 << rng.integers(8)
        for text in (bytes(damaged), content[:place]):
            try:
                read_npz(BytesIO(text))
            except ValueError:
                refused += 1
    assert refused > len(content) // 3


def test_what_numpy_wrote_is_read(tmp_path: Path) -> None:
    arrays = {"A": np.eye(3), "B": np.arange(3), "names": np.array(["x", "y"]), "Ts": np.array(0.1)}
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
        found = read_npz(tmp_path / "a.npz")
        assert {*found} == {*arrays}
        for name, array in arrays.items():
            np.testing.assert_array_equal(found[name], array)


@pytest.mark.slow
def test_a_small_mat_file_that_unpacks_to_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"A": np.zeros((6500, 6500))}, do_compression=True)  # 322 MiB
    assert path.stat().st_size < 1e6
    with pytest.raises(BadInput, match="unpacks to more than 256 MiB"):
        system_from_file(str(path), "x")
