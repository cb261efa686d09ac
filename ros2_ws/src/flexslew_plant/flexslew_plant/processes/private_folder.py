"""Folders for files that a user's processes execute: no other user may write there."""

import os
import stat
import sys
import tempfile
from functools import cache
from pathlib import Path

_OTHERS, _SEARCH = stat.S_IWGRP | stat.S_IWOTH, stat.S_IXGRP | stat.S_IXOTH
_reasons: list[str] = []  # reasons, of this process


class UnsafeFolder(OSError):
    """Another user can write into a folder of code that would be executed."""


def private_folder(path: Path) -> Path:
    """Return a folder that only this user may write into; create it with mode 0700 if missing.

    Raises:
        UnsafeFolder: if the path is a symbolic link or no folder, if another user owns it, or if
            another user may write into it or replace it.
        OSError: if it cannot be created.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        path.mkdir(mode=0o700)
    except FileExistsError:
        if not stat.S_ISDIR(path.lstat().st_mode):
            raise UnsafeFolder(f"{path} is a symbolic link or no folder; remove it") from None
    require_safe(path, _OTHERS)
    return path


def require_safe(path: Path, forbidden_mode: int = stat.S_IWOTH) -> None:
    """Require that no other user can write into a folder or replace it.

    The owner of the folder, and of each one above it, is this user, root or the owner of this code.
    Others may write into one above it only where the sticky bit keeps them from renaming. What is
    below a folder that others may not enter is safe regardless of its own mode.

    Args:
        path: of the folder.
        forbidden_mode: the bits of its own mode that must not be set.

    Raises:
        UnsafeFolder: if another user can.
        OSError: if there is no such folder.
    """
    if not hasattr(os, "getuid"):  # Windows has folders for each user
        return
    allowed_users = {os.getuid(), 0, Path(__file__).stat().st_uid}
    place, problem = path.resolve(strict=True), ""
    for folder in (place, *place.parents):
        status = folder.stat()
        if status.st_uid not in allowed_users:
            problem = f"{folder} belongs to user {status.st_uid}"
            break
        if not status.st_mode & _SEARCH:
            problem = ""
        elif folder == place and status.st_mode & forbidden_mode:
            problem = f"other users can write into {folder}; remedy: chmod go-w {folder}"
        elif status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX:
            problem = f"other users can write into {folder}; remedy: chmod o-w {folder}"
    if problem:
        raise UnsafeFolder(problem)


@cache
def cache_folder(name: str, base_folder: str = "") -> Path:
    """Return a private folder for files that later runs use again.

    Args:
        name: of the folder.
        base_folder: the folder around it, for example NUMBA_CACHE_DIR. If it is empty, unsafe or
            read-only: `flexslew` in the user's cache folder; if that cannot be used either: a new
            folder for this process only.
    """
    for parent in filter(None, (base_folder, _user_cache())):
        place = Path(parent)
        try:
            if not place.exists():
                private_folder(place)
            return private_folder(place / name)
        except UnsafeFolder as error:
            report_unsafe(str(error))
        except OSError:
            continue  # read-only
    return Path(tempfile.mkdtemp(prefix=f"flexslew_{name}_"))


def report_unsafe(reason: str) -> None:
    """Write to the terminal, once per process, why a folder is not used."""
    if not _reasons:
        sys.stderr.write(f"flexslew: machine code is compiled again: {reason}\n")
    _reasons.append(reason)


def _user_cache() -> str:
    """Return flexslew's folder in the user's cache folder (XDG; %LOCALAPPDATA% on Windows)."""
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA", "")
    if not os.path.isabs(base):  # XDG: a relative path is ignored
        base = os.path.expanduser("~/.cache")
    return os.path.join(base, "flexslew") if os.path.isabs(base) else ""
