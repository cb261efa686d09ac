"""Which process this is, in words that another process can look it up by."""

import os
from functools import cache
from pathlib import Path


def own_identity() -> str:
    """Return what this process is known by: boot and PID namespace/id; empty: by nothing."""
    return f"{_where()}/{os.getpid()}" if _where() else ""


def has_ended(identity: str) -> bool:
    """Return whether a process of this machine and PID namespace has certainly ended."""
    where, _, number = identity.partition("/")
    if not number.isdecimal() or not where or where != _where():
        return False
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    except OSError:
        return False
    return state in "ZX"


@cache
def _where() -> str:
    """Return this boot of this machine, and the PID namespace; empty where /proc does not say."""
    try:  # the first namespace has the same number on every machine
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}:{os.readlink('/proc/self/ns/pid')}"
    except OSError:
        return ""
