"""Files that are there whole or not at all, in the folder that was chosen and nowhere else."""

import os
import tempfile
from pathlib import Path

from flexslew_plant.errors import BadInput


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a text in UTF-8, or bytes; a link at this path is replaced, never followed.

    Raises:
        BadInput: if a folder has this name.
        OSError: if the system takes no more bytes, or none there; with the name of this path.
    """
    if path.is_dir() and not path.is_symlink():
        raise BadInput("is a folder, not a file; move it away", path)
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:  # which names the draft
        error.filename = str(path)
        raise
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)  # mkstemp allows no other user to read
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
