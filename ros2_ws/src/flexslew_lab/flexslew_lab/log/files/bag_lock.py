"""One recorder a folder: a lock that the system drops when its process ends."""

import errno
import fcntl
import os
from pathlib import Path

from flexslew_plant.errors import BadInput

LOCK_FILE = ".recording"


def lock_folder(folder: Path) -> int:
    """Return the handle of the lock on a bag's folder.

    Raises:
        BadInput: another recorder has it.
    """
    try:
        handle = os.open(folder / LOCK_FILE, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EISDIR):
            raise BadInput(f"{folder / LOCK_FILE}: is no file of ours; remove it") from None
        raise
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise BadInput(
            f"{folder}: another recorder writes here; choose another folder or end it first"
        ) from None
    return handle


def unlock_folder(handle: int, folder: Path) -> None:
    """Let another recorder have the folder."""
    (folder / LOCK_FILE).unlink(missing_ok=True)
    os.close(handle)
