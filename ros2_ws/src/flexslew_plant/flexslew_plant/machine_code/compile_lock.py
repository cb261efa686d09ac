"""One compilation at a time of a function for given types, in all processes that share a cache.

The lock spares a start of many nodes from compiling everything several times: a process that waits
finds the result in the cache. Every specialisation of a function (its types, and what it closes
over) has a lock of its own, so that two processes compile two of them at the same time; a function
that is compiled within another takes its lock within the other's, in the order of the calls. The
index of a function's cache is read, extended and written under another lock, held for that alone.

What is in the cache is loaded without the lock: no process waits for a compiler with a result that
is not needed. So a file must be whole before an index names it, and keep its content for good.
Numba's own files are not: it numbers them, uses a number again after a change of the source, and
writes the index first. A process that loads such a file calls machine code for other types: wrong
numbers, or a crash.
"""

import hashlib
import os
import re
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

from numba import config
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.compiler_lock import global_compiler_lock

from flexslew_plant.machine_code.compile_news import notify_compile
from flexslew_plant.processes.file_lock import lock_handle
from flexslew_plant.processes.private_folder import (
    UnsafeFolder,
    cache_folder,
    report_unsafe,
    require_safe,
)

_ADDRESS = re.compile("0x[0-9a-f]+")  # of a function that is an argument, in the name of its type


class FilesForGood(IndexDataCacheFile):  # type: ignore[misc]
    """The files of a function's cache, each written once, before the index names it."""

    def _load_index(self) -> dict[object, str]:
        """Return the names of the files; none if the index names types that were moved since."""
        try:
            index: dict[object, str] = super()._load_index()
        except (ImportError, AttributeError):
            return {}
        return index

    def save(self, key: object, data: object) -> None:
        """Keep the machine code of a specialisation."""
        name = self._data_name(uuid4().int)
        self._save_data(name, data)
        handle = _locked(Path(f"{self._index_path}.lock"))
        try:
            overloads = self._load_index()
            overloads[key] = name
            self._save_index(overloads)
        finally:
            if handle >= 0:
                os.close(handle)


class CompileLock:
    """Locks between processes; within one, the compiler's own lock holds and may nest.

    Args:
        path: of the file that is locked; a part of the lock has a file of this name with a suffix.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._depth = 0
        self._handles: dict[str, int] = {}

    def __enter__(self) -> None:
        """Keep what `take` takes until the end."""
        global_compiler_lock.acquire()
        self._depth += 1

    def take(self, part: str = "") -> None:
        """Wait until no other process compiles this part, a specialisation."""
        if part not in self._handles:
            self._handles[part] = _locked(self.path.with_name(self.path.name + part))

    def __exit__(self, *_: object) -> None:
        """Release the parts that are held, at the end of the outermost block."""
        self._depth -= 1
        if not self._depth:
            for handle in self._handles.values():
                if handle >= 0:
                    os.close(handle)
            self._handles.clear()
        global_compiler_lock.release()


def _locked(path: Path) -> int:
    """Return the open and locked file; -1 if it cannot be made, as no cache can be then."""
    try:
        handle = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
    except OSError:
        return -1
    try:
        with suppress(OSError):  # a file system without locks
            lock_handle(handle, wait=True)
    except BaseException:  # a signal
        os.close(handle)
        raise
    return handle


@cache  # one in a process: it may be taken again within itself
def lock_of(file: str, function: str) -> CompileLock:
    """Return the lock of a function of a file, in the cache that is in use."""
    digest = hashlib.sha256(f"{file}:{function}".encode()).hexdigest()[:16]
    return CompileLock(cache_folder("locks", config.CACHE_DIR) / digest)


def one_at_a_time(dispatcher: Any, lock: CompileLock | None = None) -> Any:
    """Return a function of Numba that compiles under a lock what its cache does not hold.

    Args:
        dispatcher: what Numba has made of the function.
        lock: by default the function's own.
    """
    compile_it: Callable[[Any], Any] = dispatcher.compile
    function = dispatcher.py_func
    function_lock = lock or lock_of(function.__code__.co_filename, function.__qualname__)

    def compile_locked(signature: Any) -> Any:
        with function_lock:
            return compile_it(signature)

    dispatcher.compile = compile_locked
    name = f"{function.__module__}.{function.__name__}"
    dispatcher._cache = _LockedCache(dispatcher._cache, function_lock, name)
    return dispatcher


class _LockedCache:
    """The cache of a function, which takes the lock where it holds nothing.

    Args:
        cache: Numba's cache of the function.
        lock: the lock that a compiling process holds.
        name: name of the function.
    """

    def __init__(self, cache: Any, lock: CompileLock, name: str) -> None:
        if isinstance(cache, FunctionCache):
            try:  # its files are executed
                require_safe(Path(cache.cache_path))
            except UnsafeFolder as error:
                report_unsafe(str(error))
                cache = NullCache()
        if isinstance(cache, FunctionCache):
            stamp = cache._impl.locator.get_source_stamp()
            cache._cache_file = FilesForGood(cache.cache_path, cache._impl.filename_base, stamp)
        self._cache, self._lock, self._name = cache, lock, name

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the machine code; None: it is not there, and the lock is held."""
        found = self._cache.load_overload(signature, context)
        if found is not None:
            return found
        self._lock.take(self._part(signature, context))
        found = self._cache.load_overload(signature, context)
        if found is None:
            notify_compile(self._name)
        return found

    def _part(self, signature: Any, context: Any) -> str:
        """Return the part of the lock for a specialisation, the same one in every process."""
        if not isinstance(self._cache, FunctionCache):
            return ""
        key = _ADDRESS.sub("", repr(self._cache._index_key(signature, context.codegen())))
        return f"-{hashlib.sha256(key.encode()).hexdigest()[:16]}"

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute that Numba uses."""
        return getattr(self._cache, name)
