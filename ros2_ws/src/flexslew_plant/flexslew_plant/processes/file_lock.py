"""A lock on a file between processes; the system drops it when its holder ends, however it ends."""

import importlib
import os
from pathlib import Path

_LINKS = getattr(os, "O_NOFOLLOW", 0)  # not on Windows
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)  # opening one would wait for its writer


def lock_file(path: Path, mode: int = 0o644, create: bool = True) -> int | None:
    """Return the handle of a file after locking it; None where another process holds it.

    Closing the handle releases the lock.

    Args:
        path: path of the file, which is no link.
        mode: mode of a file that is made.
        create: make and open it for writing; else open an existing one for reading.

    Raises:
        OSError: the file cannot be opened.
    """
    access = os.O_RDWR | os.O_CREAT if create else os.O_RDONLY | _NO_WAIT
    handle = os.open(path, access | _LINKS, mode)
    try:
        is_locked = lock_handle(handle, wait=False)
    except BaseException:
        os.close(handle)
        raise
    if not is_locked:
        os.close(handle)
        return None
    return handle


def lock_handle(handle: int, wait: bool) -> bool:
    """Return whether an open file is locked now: by flock, on Windows by msvcrt, else not at all.

    Args:
        handle: handle of the file.
        wait: whether to wait until no other process holds it; else return at once.

    Raises:
        OSError: the file system has no locks.
    """
    try:
        import fcntl
    except ImportError:
        return _lock_other(handle, wait)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True


def _lock_other(handle: int, wait: bool) -> bool:
    """Return whether the first byte of a file is locked, where there is no flock."""
    try:
        windows = importlib.import_module("msvcrt")
    except ImportError:
        return True  # a system without locks: one process at a time is up to the user
    while True:
        try:
            windows.locking(handle, windows.LK_LOCK if wait else windows.LK_NBLCK, 1)
        except PermissionError:  # LK_LOCK gives up after ten seconds
            if not wait:
                return False
        else:
            return True
