"""Files of a study on the disk: there whole or not at all, in its folder and nowhere else."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flexslew_plant.errors import BadInput, RunFault

HALF = ".half"  # at the end of the name of what is not written yet


def put(place: Path, content: bytes) -> None:
    """Write a file whole or not at all; a link at its place is replaced, never followed.

    Raises:
        RunFault: if the disk is full.
        BadInput: if it cannot be written for another reason.
    """
    half = place.with_name(f"{place.name}.{os.getpid()}{HALF}")
    with write_errors(place):
        try:
            half.unlink(missing_ok=True)
            with half.open("xb") as file:  # never through a link
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            half.rename(place)
            folder = os.open(place.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        except OSError:
            half.unlink(missing_ok=True)
            raise


def checked_folder(folder: Path) -> Path:
    """Return a folder within a study's after checking that it is no link to another place.

    Raises:
        BadInput: it is one.
    """
    if folder.is_symlink():
        raise BadInput(
            f"{folder}: is a link, which a study does not follow; put the folder itself there"
        )
    return folder


@contextmanager
def write_errors(place: Path) -> Iterator[None]:
    """Report in one line why something cannot be written.

    Raises:
        RunFault: if the disk is full.
        BadInput: for any other reason.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise BadInput(f"cannot be written: {error}", place) from None
        raise RunFault(
            f"{place.parent}: no space left on the disk; all results up to the last part "
            "is there; make room and run the study again"
        ) from None
