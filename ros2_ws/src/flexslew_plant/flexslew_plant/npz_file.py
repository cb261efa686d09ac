"""The arrays of an .npz file, with their sizes checked before anything is unpacked."""

import math
import zipfile
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

LARGEST = 256 << 20  # of all arrays of a file together [B]
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_READ_ERRORS = (
    OSError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)


def read_npz(source: Path | BytesIO) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file by name.

    Raises:
        OSError: if the file cannot be opened.
        ValueError: if it is damaged, no .npz file, or larger than LARGEST once unpacked.
    """
    with source.open("rb") if isinstance(source, Path) else source as file:
        try:
            with zipfile.ZipFile(file) as archive:
                _check_sizes(archive)
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return {name: _array(arrays, name) for name in arrays.files}
        except _READ_ERRORS as error:
            raise ValueError(str(error) or "it is cut off") from None


def _array(arrays: Any, name: str) -> NDArray[Any]:
    """Return an array of an opened file; an error names it."""
    try:
        array: NDArray[Any] = arrays[name]
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    return array


def _check_sizes(archive: zipfile.ZipFile) -> None:
    """Check what the arrays of an archive need in memory.

    Raises:
        ValueError: if it is more than LARGEST, or more than the archive holds.
    """
    total = sum(entry.file_size for entry in archive.infolist())
    if total > LARGEST:
        raise ValueError(f"it unpacks to {total >> 20:,} MiB; at most {LARGEST >> 20} are read")
    for entry in archive.infolist():
        with archive.open(entry) as file:
            read = _HEADERS.get(npy.read_magic(file))
            if read is None:
                raise ValueError(f"{entry.filename}: is no array of plain numbers")
            shape, _, kind = read(file)
        declared = math.prod(shape) * kind.itemsize
        if min(shape, default=0) < 0 or declared > entry.file_size:
            raise ValueError(
                f"{entry.filename}: claims {declared:,} bytes of numbers and holds "
                f"{entry.file_size:,}"
            )
