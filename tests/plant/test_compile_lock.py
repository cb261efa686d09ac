"""Machine code in a cache that several processes fill at once."""

import fcntl
import importlib
import os
import signal
from pathlib import Path
from threading import Timer
from typing import Any

import numba
import pytest
from numba import config
from numba.core.caching import IndexDataCacheFile

from flexslew_plant.arrays import compiled, inlined, vectorised
from flexslew_plant.compile_lock import CompileLock, lock_of, one_at_a_time

NESTED = """
def inner(x):
    return x + 1.0

def outer(x):
    return inner(x) * 2.0
"""


def is_free(path: Path) -> bool:
    handle = os.open(path, os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(handle)
    return True


def test_the_lock_is_held_from_the_look_into_the_cache_to_the_last_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = CompileLock(tmp_path / "lock")
    free = []
    for name in ("load", "save"):
        plain = getattr(IndexDataCacheFile, name)

        def look(*words: Any, plain: Any = plain) -> Any:
            done = plain(*words)
            free.append(is_free(lock.path))
            return done

        monkeypatch.setattr(IndexDataCacheFile, name, look)
    (tmp_path / "nested.py").write_text(NESTED)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    nested = importlib.import_module("nested")
    nested.inner = one_at_a_time(numba.njit(nested.inner, cache=True), lock)
    outer = one_at_a_time(numba.njit(nested.outer, cache=True), lock)
    assert outer(3.0) == 8.0
    assert free == [False] * 4  # both are looked for and saved, one within the other
    assert is_free(lock.path)


def test_what_is_compiled_for_later_runs_is_compiled_under_the_lock() -> None:
    for kept in (compiled, vectorised):
        assert kept(is_free).compile.__qualname__.startswith("one_at_a_time.")


def test_a_failed_compilation_lets_go_of_the_lock(tmp_path: Path) -> None:
    lock = CompileLock(tmp_path / "lock")
    wrong = one_at_a_time(numba.njit(lambda x: x.nothing), lock)
    with pytest.raises(numba.TypingError):
        wrong(1.0)
    assert is_free(lock.path)


def test_a_signal_ends_the_wait_for_the_lock(tmp_path: Path) -> None:
    lock = CompileLock(tmp_path / "lock")
    handle = os.open(lock.path, os.O_RDWR | os.O_CREAT)
    fcntl.flock(handle, fcntl.LOCK_EX)

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGUSR1, interrupt)
    Timer(0.05, os.kill, (os.getpid(), signal.SIGUSR1)).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            one_at_a_time(numba.njit(lambda x: x + 1), lock)(1)
    finally:
        signal.signal(signal.SIGUSR1, before)
        os.close(handle)
    with lock:  # it does not think that it holds it
        assert not is_free(lock.path)
    assert is_free(lock.path)


def test_without_a_place_for_the_lock_it_compiles_all_the_same() -> None:
    lock = CompileLock(Path("/proc/nowhere/lock"))
    assert one_at_a_time(numba.njit(lambda x: x + 1), lock)(1) == 2


def test_another_process_that_compiles_one_function_keeps_nobody_from_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    taken, other = lock_of(__file__, "taken"), lock_of(__file__, "other")
    assert lock_of(__file__, "taken") is taken
    assert lock_of("elsewhere.py", "taken").path != taken.path
    with other:
        pass
    handle = os.open(taken.path, os.O_RDWR | os.O_CREAT)
    fcntl.flock(handle, fcntl.LOCK_EX)  # as that process has it
    try:
        assert one_at_a_time(numba.njit(lambda x: x + 1), other)(1) == 2
        assert not is_free(taken.path)
    finally:
        os.close(handle)
    with taken, taken:  # a function that is compiled within itself
        assert not is_free(taken.path)


def test_a_function_that_is_in_no_file_compiles_all_the_same() -> None:
    space: dict[str, Any] = {}
    exec("def twice(x):\n    return 2.0 * x", space)
    assert inlined(space["twice"])(1.5) == 3.0
