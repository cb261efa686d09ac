"""Work that goes on in the background when its command has ended, and how others wait for it."""

import os
from pathlib import Path

from flexslew_plant.processes.file_lock import lock_handle

_MACHINE_CODE = "set_up.log"  # in the cache: of the set-up, which compiles for later runs


def machine_code_log() -> Path:
    """Return the log of the set-up's compilation, in the cache of machine code that is in use."""
    return Path(os.environ.get("NUMBA_CACHE_DIR", ""), _MACHINE_CODE)


def in_background(log: Path) -> bool:
    """Return True in a process that goes on from here, False in this one, which may end.

    The other one has a session of its own, yields to every other process, writes to the log and
    holds it locked until its end. If the log is locked already, there is no other one.
    """
    handle = os.open(log, os.O_CREAT | os.O_WRONLY, 0o644)
    if not _locked(handle, wait=False) or os.fork():
        os.close(handle)
        return False
    os.ftruncate(handle, 0)
    os.setsid()
    os.nice(19)
    for stream in range(3):
        os.dup2(handle, stream)
    return True


def wait_for(log: Path) -> None:
    """Return as soon as no process writes this log in the background any more."""
    if log.is_file():
        with log.open("a") as file:
            _locked(file.fileno(), wait=True)


def _locked(handle: int, wait: bool) -> bool:
    """Return whether an open file is locked now; see file_lock.hold."""
    try:
        return lock_handle(handle, wait)
    except OSError:  # a file system without locks
        return True
