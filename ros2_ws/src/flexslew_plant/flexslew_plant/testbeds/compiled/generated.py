"""Functions from text, each with a file by which the cache of machine code finds it again."""

import hashlib
import os
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import config

from flexslew_plant.processes.private_folder import cache_folder


def generated(name: str, text: str, names: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the function that a text defines; what runs is the text, never the file."""
    digest = hashlib.sha256(text.encode()).hexdigest()[:24]
    path = cache_folder("generated", config.CACHE_DIR) / f"{name}_{digest}.py"
    _keep(path, text)
    given = {**names, "__name__": __name__}  # a module that any loader can import
    exec(compile(text, str(path), "exec"), given)
    found: Callable[..., Any] = given[name]
    return found


def _keep(path: Path, text: str) -> None:
    """Write a file that is not there, whole and once: the cache goes by its time, too.

    Raises:
        OSError: nothing can be written.
    """
    if path.exists():
        return
    handle, temporary = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(handle, "w") as file:
        file.write(text)
    with suppress(FileExistsError):
        os.link(temporary, path)
    os.unlink(temporary)
