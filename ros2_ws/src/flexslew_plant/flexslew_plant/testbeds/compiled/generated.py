"""Functions from text, with a file beside the machine code so that its cache finds them again."""

import hashlib
import os
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import config


def generated(name: str, text: str, names: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the function that a text defines; what runs is the text, never the file.

    Args:
        name: of the function.
        text: its definition.
        names: that it uses besides built-in ones.
    """
    digest = hashlib.sha256(text.encode()).hexdigest()[:24]
    path = _folder() / f"{name}_{digest}.py"
    _keep(path, text)
    given = {**names, "__name__": __name__}  # a module that whoever loads it can import
    exec(compile(text, str(path), "exec"), given)
    found: Callable[..., Any] = given[name]
    return found


def _folder() -> Path:
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR) / "generated"
    user = getattr(os, "getuid", int)()  # Windows has a folder for each user
    return Path(tempfile.gettempdir()) / f"flexslew_generated_{user}"


def _keep(path: Path, text: str) -> None:
    """Write a file that is not there, whole and once: the cache goes by its time, too.

    Raises:
        OSError: nothing can be written.
    """
    if path.exists():
        return
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle, own = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(handle, "w") as file:
        file.write(text)
    with suppress(FileExistsError):
        os.link(own, path)
    os.unlink(own)
