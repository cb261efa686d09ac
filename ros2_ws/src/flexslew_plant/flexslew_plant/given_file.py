"""Files that a person, a trial or a request names: regular files of limited size, nothing else."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from flexslew_plant.errors import BadInput

MIB = 1 << 20
_BINARY = getattr(os, "O_BINARY", 0)  # Windows
LARGEST = 64 * MIB  # of a file that is read as a whole [bytes]


def open_given(path: Path | str, largest: int | None = None) -> BinaryIO:
    """Return a file that is open for reading.

    A pipe, a device or a folder is refused before anything is read: a pipe would be waited for.

    Args:
        path: of the file; a symbolic link is followed.
        largest: size that is allowed [bytes]; None: any.

    Raises:
        BadInput: if it is missing, not a regular file, or too large.
    """
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY)
    except (OSError, ValueError) as error:  # a name with a zero byte
        why = getattr(error, "strerror", None) or str(error)
        raise BadInput(f"cannot be read: {why}", path) from None
    status = os.fstat(handle)
    why = "" if stat.S_ISREG(status.st_mode) else "it is no regular file"
    if not why and largest is not None and status.st_size > largest:
        why = f"it has {status.st_size / MIB:.1f} MiB, the limit is {largest // MIB}"
    if why:
        os.close(handle)
        raise BadInput(f"cannot be read: {why}", path)
    return os.fdopen(handle, "rb")


def given_bytes(path: Path | str, largest: int = LARGEST) -> bytes:
    """Return the content of a file.

    Raises:
        BadInput: see open_given.
    """
    with open_given(path, largest) as file:
        size = os.fstat(file.fileno()).st_size or largest  # a file of /proc has none
        content = file.read(size + 1)  # not largest + 1, for which memory would be set aside
    if len(content) > largest:
        raise BadInput(f"cannot be read: the limit is {largest // MIB} MiB", path)
    return content


def given_text(path: Path | str, largest: int = LARGEST) -> str:
    """Return the content of a text file (UTF-8, with or without a byte-order mark).

    Raises:
        BadInput: see open_given; or if it is not UTF-8.
    """
    try:
        text = given_bytes(path, largest).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadInput("cannot be read: it is not a text file", path) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")
