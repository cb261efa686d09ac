"""Which process this is, in words that another process can look it up by."""

import os
from functools import cache
from pathlib import Path

_STARTED = 19  # index in /proc/PID/stat, counted from the state


def current_identity() -> str:
    """Return what this process is known by: boot and PID namespace/id; empty: by nothing."""
    return f"{_where()}/{os.getpid()}" if _where() else ""


def has_terminated(identity: str) -> bool:
    """Return whether a process of this machine and PID namespace has certainly ended."""
    if not _is_local(identity):
        return False
    try:
        state = _stat(identity)[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    except OSError:
        return False
    return state in "ZX"


def started(identity: str) -> int | None:
    """Return when a process started, since the boot of the machine [ns]; None if unknown here.

    The wall clock may have been set meanwhile.
    """
    try:
        ticks = int(_stat(identity)[_STARTED]) if _is_local(identity) else None
    except OSError:
        return None
    return None if ticks is None else ticks * (1_000_000_000 // os.sysconf("SC_CLK_TCK"))


def _is_local(identity: str) -> bool:
    where, _, number = identity.partition("/")
    return bool(number.isdecimal() and where and where == _where())


def _stat(identity: str) -> list[str]:
    """Return the fields of /proc/PID/stat of a process, from its state on (proc_pid_stat(5))."""
    number = identity.partition("/")[2]
    return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()


@cache
def _where() -> str:
    """Return this boot of this machine, and the PID namespace; empty where /proc has neither."""
    try:  # the first namespace has the same number on every machine
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}:{os.readlink('/proc/self/ns/pid')}"
    except OSError:
        return ""
