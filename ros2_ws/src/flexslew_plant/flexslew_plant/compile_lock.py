"""One compiler of a function at a time for all processes that share a cache of machine code.

Numba numbers the files of a function's cache without a lock. Two processes that compile one
function at once for different types take the same number, and one file remains under both names;
and an index may name a file before its new content is there. Whoever loads such a file calls
machine code that was made for other types: wrong numbers, or a crash. The lock also spares a start
of many nodes from compiling everything several times: who waits finds it in the cache. Every
function has a lock of its own, so that two processes compile two functions side by side; one that
is compiled within another takes its lock within the other's, in the order of the calls.
"""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba import config
from numba.core.compiler_lock import global_compiler_lock


class CompileLock:
    """A lock between processes; within one, the compiler's own lock holds and may nest.

    Args:
        path: of the file that is locked.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._depth, self._handle = 0, -1

    def __enter__(self) -> None:
        """Wait until nobody else compiles."""
        global_compiler_lock.acquire()
        try:
            if not self._depth:
                self._handle = self._taken()
            self._depth += 1
        except BaseException:
            global_compiler_lock.release()
            raise

    def __exit__(self, *_: object) -> None:
        """Let the next one compile."""
        self._depth -= 1
        if not self._depth and self._handle >= 0:
            os.close(self._handle)
        global_compiler_lock.release()

    def _taken(self) -> int:
        """Return the open and locked file; -1 where none can be made: nor can a cache."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.path, os.O_CREAT | os.O_RDWR, 0o600)
        except OSError:
            return -1
        try:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(handle, fcntl.LOCK_EX)
        except BaseException:  # a signal
            os.close(handle)
            raise
        return handle


@cache  # one in a process: it may be taken again within itself
def lock_of(file: str, function: str) -> CompileLock:
    """Return the lock of a function of a file, in the cache that is in use."""
    digest = hashlib.sha256(f"{file}:{function}".encode()).hexdigest()[:16]
    if config.CACHE_DIR:
        return CompileLock(Path(config.CACHE_DIR) / "locks" / digest)
    return CompileLock(Path(tempfile.gettempdir()) / f"flexslew_compile_{os.getuid()}" / digest)


def one_at_a_time(dispatcher: Any, lock: CompileLock | None = None) -> Any:
    """Return a function of Numba that looks into its cache and compiles under a lock.

    Args:
        dispatcher: what Numba has made of the function.
        lock: by default the function's own.
    """
    compile_it: Callable[[Any], Any] = dispatcher.compile
    function = dispatcher.py_func
    held = lock or lock_of(function.__code__.co_filename, function.__qualname__)

    def compile_alone(signature: Any) -> Any:
        with held:
            return compile_it(signature)

    dispatcher.compile = compile_alone
    return dispatcher
