"""Lock files of ROS domains: one per domain and user, in the folder of temporary files.

A user locks a domain in a file of their own and examines the files of all other users, which are
readable but not writable. The system drops a lock when its holder ends.
"""

import os
import re
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from flexslew_plant.processes.file_lock import lock_file

_NAME = re.compile(r"flexslew_domain_(\d{1,3})(?:_\d+)?\.lock")
_FILE_MODE = 0o644  # by every user, for any umask


class DomainLock(NamedTuple):
    """A lock file of a domain."""

    domain: int
    path: Path
    modified: float  # when a run locked or released it last [s]


def domain_locks() -> list[DomainLock]:
    """Return the lock files of all users."""
    found = []
    with os.scandir(folder()) as entries:
        for entry in entries:
            name = _NAME.fullmatch(entry.name)
            with suppress(OSError):  # removed meanwhile
                if name is not None and entry.is_file(follow_symlinks=False):
                    found.append(DomainLock(int(name[1]), Path(entry.path), entry.stat().st_mtime))
    return found


def lock_domain(number: int, others: Iterable[DomainLock]) -> int | None:
    """Return the open lock file of this user; None if another run holds the domain.

    Two users that try one domain at once may both get None; each then tries another one.

    Args:
        number: number of the domain.
        others: the lock files of all users.

    Raises:
        OSError: if the file of this user cannot be locked, or that of another one not examined.
    """
    path = folder() / f"flexslew_domain_{number}_{user()}.lock"
    handle = lock_file(path)
    if handle is None:
        return None
    try:
        if hasattr(os, "fchmod"):
            os.fchmod(handle, _FILE_MODE)
        taken = any(
            is_locked(other.path)
            for other in others
            if other.domain == number and other.path != path
        )
    except BaseException:
        os.close(handle)
        raise
    if taken:
        os.close(handle)
        return None
    return handle


def is_locked(path: Path) -> bool:
    """Return whether a run holds a lock file.

    Raises:
        OSError: if the file cannot be opened.
    """
    try:
        handle = lock_file(path, create=False)
    except FileNotFoundError:
        return False
    if handle is None:
        return True
    os.close(handle)
    return False


def folder() -> Path:
    """Return the folder of the lock files."""
    return Path(tempfile.gettempdir())


def user() -> int:
    """Return the number of this user; 0 where the system has none."""
    return getattr(os, "getuid", int)()
