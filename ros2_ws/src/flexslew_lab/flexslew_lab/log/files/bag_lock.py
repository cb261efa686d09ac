"""One recorder a folder: a lock that the system drops when its process ends."""

import errno
import os
from pathlib import Path

from flexslew_plant.errors import BadInput
from flexslew_plant.processes.file_lock import lock_file

LOCK_FILE = ".recording"


def lock_folder(folder: Path) -> int:
    """Return the handle of the lock on a bag's folder.

    Raises:
        BadInput: another recorder has it.
    """
    try:
        handle = lock_file(folder / LOCK_FILE)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EISDIR):
            raise BadInput("is not a lock file; remove it", folder / LOCK_FILE) from None
        raise
    if handle is None:
        raise BadInput(
            "another recorder writes here; choose another folder or end it first", folder
        )
    return handle


def release_folder(handle: int, folder: Path) -> None:
    """Let another recorder have the folder."""
    (folder / LOCK_FILE).unlink(missing_ok=True)
    os.close(handle)
