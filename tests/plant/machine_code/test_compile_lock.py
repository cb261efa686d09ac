"""Machine code in a cache that several processes fill at once."""

import fcntl
import importlib
import multiprocessing
import os
import signal
import sys
from pathlib import Path
from threading import Timer
from typing import Any

import numba
import pytest
from numba import config

from flexslew_plant.arrays import compiled, inline, vectorised
from flexslew_plant.machine_code.compile_lock import (
    CompileLock,
    FilesForGood,
    lock_of,
    one_at_a_time,
)

NESTED = """
def inner(x):
    return x + 1.0

def outer(x):
    return inner(x) * 2.0
"""


def is_free(path: Path) -> bool:
    """Return True if no process holds a lock or a part of it."""
    parts = path.parent.glob(f"{path.name}-*") if path.parent.is_dir() else ()
    return all(map(_is_free, (path, *parts)))


def _is_free(path: Path) -> bool:
    handle = os.open(path, os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(handle)
    return True


def test_the_lock_is_held_from_the_miss_in_the_cache_to_the_last_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = CompileLock(tmp_path / "lock")
    seen = []
    for name in ("load", "save"):
        plain = getattr(FilesForGood, name)

        def look(*words: Any, plain: Any = plain, name: str = name) -> Any:
            free = is_free(lock.path)
            done = plain(*words)
            seen.append((name, free and is_free(lock.path)))
            return done

        monkeypatch.setattr(FilesForGood, name, look)
    (tmp_path / "nested.py").write_text(NESTED)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    nested = importlib.import_module("nested")
    inner = one_at_a_time(numba.njit(nested.inner, cache=True), lock)
    monkeypatch.setattr(nested, "inner", inner)
    outer = one_at_a_time(numba.njit(nested.outer, cache=True), lock)
    assert outer(3.0) == 8.0
    # looked for without the lock, then with it; the inner one within that of the outer one
    within = [("load", False)] * 3 + [("save", False)] * 2
    assert seen == [("load", True), *within]
    assert is_free(lock.path)


def test_what_is_in_the_cache_is_loaded_while_another_process_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    (tmp_path / "single.py").write_text(NESTED.split("\n\n")[0])
    monkeypatch.syspath_prepend(tmp_path)
    function = importlib.import_module("single").inner
    lock = CompileLock(tmp_path / "lock")
    assert one_at_a_time(numba.njit(function, cache=True), lock)(1.0) == 2.0
    handle = os.open(lock.path, os.O_RDWR | os.O_CREAT)
    fcntl.flock(handle, fcntl.LOCK_EX)  # as that process has it
    monkeypatch.setattr(CompileLock, "take", lambda self, part: pytest.fail("it waits"))
    try:
        again = one_at_a_time(numba.njit(function, cache=True), lock)
        assert again(1.0) == 2.0
        assert sum(again.stats.cache_hits.values()) == 1
    finally:
        os.close(handle)


def test_an_index_names_only_files_that_are_whole_and_stay_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = FilesForGood(str(tmp_path), "name", (1.0, 2))
    named, plain = [], FilesForGood._save_index

    def save_index(self: FilesForGood, overloads: dict[str, str]) -> None:
        named.append({key: self._load_data(name) for key, name in overloads.items()})
        plain(self, overloads)

    monkeypatch.setattr(FilesForGood, "_save_index", save_index)
    files.save("first", 1)
    old = files._load_index()["first"]
    files.save("second", 2)
    files.save("first", 3)
    assert named == [{"first": 1}, {"first": 1, "second": 2}, {"first": 3, "second": 2}]
    changed = FilesForGood(str(tmp_path), "name", (2.0, 2))  # of a changed source
    changed.save("first", 4)
    assert (files._load_data(old), changed.load("first"), changed.load("second")) == (1, 4, None)


def test_no_entry_of_an_index_is_lost_when_processes_save_at_the_same_time(tmp_path: Path) -> None:
    def save(process: int) -> None:
        files = FilesForGood(str(tmp_path), "name", (1.0, 2))
        for k in range(25):
            files.save((process, k), k)

    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=save, args=(process,)) for process in range(4)]
    for each in processes:
        each.start()
    for each in processes:
        each.join()
    index = FilesForGood(str(tmp_path), "name", (1.0, 2))._load_index()
    assert set(index) == {(process, k) for process in range(4) for k in range(25)}


def test_an_index_with_types_of_a_module_that_was_moved_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "moved.py").write_text("class Key:\n    pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    before = FilesForGood(str(tmp_path), "name", (1.0, 2))
    before.save(importlib.import_module("moved").Key, "machine code")
    (tmp_path / "moved.py").unlink()
    monkeypatch.delitem(sys.modules, "moved")
    importlib.invalidate_caches()
    after = FilesForGood(str(tmp_path), "name", (2.0, 2))
    assert after.load(int) is None
    after.save(int, "new machine code")
    assert after.load(int) == "new machine code"


def test_two_specialisations_of_a_function_are_compiled_at_the_same_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "kinds.py").write_text(NESTED.split("\n\n")[0])
    monkeypatch.syspath_prepend(tmp_path)
    function = importlib.import_module("kinds").inner
    lock = CompileLock(tmp_path / "lock")
    one_at_a_time(numba.njit(function, cache=True), lock)(1.0)
    (part,) = tmp_path.glob("lock-*")
    handle = os.open(part, os.O_RDWR)
    fcntl.flock(handle, fcntl.LOCK_EX)  # as a process that compiles it for floats has it
    try:
        assert one_at_a_time(numba.njit(function, cache=True), lock)(1) == 2
        assert len(list(tmp_path.glob("lock-*"))) == 2
    finally:
        os.close(handle)


def test_what_is_compiled_for_later_runs_is_compiled_under_the_lock() -> None:
    for kept in (compiled, vectorised):
        function: Any = kept(is_free)
        assert function.compile.__qualname__.startswith("one_at_a_time.")


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
        lock.take()
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
        other.take()
    handle = os.open(taken.path, os.O_RDWR | os.O_CREAT)
    fcntl.flock(handle, fcntl.LOCK_EX)  # as that process has it
    try:
        assert one_at_a_time(numba.njit(lambda x: x + 1), other)(1) == 2
        assert not is_free(taken.path)
    finally:
        os.close(handle)
    with taken, taken:  # a function that is compiled within itself
        taken.take()
        assert not is_free(taken.path)


def test_a_function_that_is_in_no_file_compiles_all_the_same() -> None:
    space: dict[str, Any] = {}
    exec("def twice(x):\n    return 2.0 * x", space)
    assert inline(space["twice"])(1.5) == 3.0
