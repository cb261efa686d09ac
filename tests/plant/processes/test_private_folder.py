"""Folders whose content is executed: no other user can write there."""

import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from flexslew_plant.processes.private_folder import (
    UnsafeFolder,
    cache_folder,
    private_folder,
    require_safe,
)

OWNER, ATTACKER = 4242, 4343
AS_ROOT = pytest.mark.skipif(os.getuid() != 0, reason="only root can start a process of a user")
# Root starts the interpreter and imports all that it needs: its folder may be closed to the user.
COMPILE = """
import json, os, sys, tempfile
import numba
from numba import config
from flexslew_plant.arrays import compiled
from flexslew_plant.machine_code.compile_lock import lock_of
from flexslew_plant.processes.private_folder import cache_folder
from flexslew_plant.testbeds.compiled.generated import generated
numba.njit(lambda x: x + 1.0)(1.0)

user, given = json.loads(sys.argv[1])
os.setgroups([]), os.setgid(user), os.setuid(user)
os.environ.pop("XDG_CACHE_HOME", None)
os.environ.update(given)
config.CACHE_DIR, tempfile.tempdir = given.get("NUMBA_CACHE_DIR", ""), None
cache_folder.cache_clear()

function = compiled(generated("add_one", "def add_one(x):\\n    return x + 1.0\\n", {}))
assert function(1.0) == 2.0
print(function.py_func.__code__.co_filename)
print(lock_of("file", "function").path)
"""


@pytest.fixture
def shared() -> Iterator[Path]:
    """Yield a folder that every user may enter, with a home and a temporary folder."""
    place = Path(tempfile.mkdtemp())
    place.chmod(0o755)
    (place / "home").mkdir(mode=0o700)
    (place / "tmp").mkdir()
    (place / "tmp").chmod(0o1777)
    if os.getuid() == 0:
        os.chown(place / "home", OWNER, OWNER)
    yield place
    shutil.rmtree(place)


def folders_of_user(shared: Path, **given: str) -> tuple[list[Path], str]:
    """Return where a user's process puts generated code and locks, and what it reports."""
    known = {"HOME": str(shared / "home"), "TMPDIR": str(shared / "tmp"), **given}
    call = [sys.executable, "-P", "-c", COMPILE, json.dumps([OWNER, known])]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [Path(line).parent for line in done.stdout.split()], done.stderr


def test_a_new_folder_is_private_and_is_returned_again(tmp_path: Path) -> None:
    folder = private_folder(tmp_path / "a" / "b")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert private_folder(folder) == folder


def as_link(path: Path) -> None:
    (path.parent / "elsewhere").mkdir(mode=0o700)
    path.symlink_to(path.parent / "elsewhere")


def as_writable(mode: int) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.mkdir()
        path.chmod(mode)

    return make


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (as_link, "is a symbolic link"),
        (Path.touch, "no folder"),
        (as_writable(0o777), "other users can write"),
        (as_writable(0o1777), "other users can write"),
        (as_writable(0o770), "other users can write"),
    ],
)
def test_an_unsafe_folder_is_refused(
    make: Callable[[Path], None], words: str, shared: Path
) -> None:
    make(shared / "folder")
    with pytest.raises(UnsafeFolder, match=words):
        private_folder(shared / "folder")


def test_a_folder_that_others_can_rename_is_refused(shared: Path) -> None:
    (shared / "tmp" / "own").mkdir(mode=0o700)
    require_safe(shared / "tmp" / "own")  # the sticky bit keeps others from renaming it
    (shared / "tmp").chmod(0o777)
    with pytest.raises(UnsafeFolder, match=r"other users can write into .*/tmp; remedy"):
        require_safe(shared / "tmp" / "own")


def test_what_is_below_a_closed_folder_is_safe(tmp_path: Path) -> None:
    (tmp_path / "closed").mkdir(mode=0o700)
    (tmp_path / "closed" / "open").mkdir()
    (tmp_path / "closed" / "open").chmod(0o777)
    require_safe(tmp_path / "closed" / "open")


def test_an_unsafe_choice_leads_to_the_cache_of_the_user(
    shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared / "cache"))
    chosen = shared / "chosen"
    assert cache_folder("code", str(chosen)) == chosen / "code"
    chosen.chmod(0o777)
    cache_folder.cache_clear()
    assert cache_folder("code", str(chosen)) == shared / "cache" / "flexslew" / "code"
    assert stat.S_IMODE((shared / "cache" / "flexslew").stat().st_mode) == 0o700


@pytest.mark.slow
@AS_ROOT
def test_a_user_compiles_in_folders_of_his_own(shared: Path) -> None:
    found, words = folders_of_user(shared)
    own = shared / "home" / ".cache" / "flexslew"
    assert found == [own / "generated", own / "locks"]
    assert {(f.stat().st_uid, stat.S_IMODE(f.stat().st_mode)) for f in found} == {(OWNER, 0o700)}
    assert list((own / "generated" / "__pycache__").glob("*.nbi"))
    assert not list((shared / "tmp").iterdir())
    assert not words


@pytest.mark.slow
@AS_ROOT
@pytest.mark.parametrize(
    ("place", "linked"), [("XDG_CACHE_HOME", True), ("NUMBA_CACHE_DIR", False)]
)
def test_folders_that_another_user_has_planted_are_not_used(
    place: str, linked: bool, shared: Path
) -> None:
    planted = shared / "tmp" / "planted"
    around = planted if place.startswith("NUMBA") else planted / "flexslew"
    for name in ("generated", "locks"):
        (around / name).mkdir(parents=True)
    for path in (planted, *planted.rglob("*")):
        os.chown(path, ATTACKER, ATTACKER)
        path.chmod(0o777)
    if linked:  # from a folder of the user into that of the other one
        own = shared / "tmp" / "own"
        (own if place.startswith("NUMBA") else own / "flexslew").mkdir(parents=True)
        for path in (own, *own.rglob("*")):
            os.chown(path, OWNER, OWNER)
        for name in ("generated", "locks"):
            (own / (around / name).relative_to(planted)).symlink_to(around / name)
    chosen = shared / "tmp" / "own" if linked else planted
    found, words = folders_of_user(shared, **{place: str(chosen)})
    assert not [folder for folder in found if folder.is_relative_to(planted)]
    assert {folder.stat().st_uid for folder in found} == {OWNER}
    assert not [path for path in planted.rglob("*") if path.is_file()]
    assert len(words.splitlines()) == 1
    assert "machine code is compiled again" in words
