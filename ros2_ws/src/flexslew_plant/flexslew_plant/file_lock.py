"""A lock on a file between processes; the system drops it when its holder ends, however it ends."""

import fcntl
import os
from pathlib import Path


def lock_file(path: Path, mode: int = 0o644, create: bool = True) -> int | None:
    """Return the handle of a file after locking it; None where another process holds it.

    Whoever closes the handle lets the next one have it.

    Args:
        path: of the file, which is no link.
        mode: of a file that is made.
        create: whether to make one.

    Raises:
        OSError: the file cannot be opened.
    """
    handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | (os.O_CREAT if create else 0), mode)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        return None
    except BaseException:
        os.close(handle)
        raise
    return handle
