"""Files that a page sends: their names, their size, and the folder in which they are kept."""

import re
from pathlib import Path
from typing import NamedTuple

from flexslew_lab.log.files.whole_file import write_whole
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import LARGEST, MIB

FOLDER = "uploads"  # in the folder of the run
MOST = 50  # files of a run
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._ -]{0,99}")


class UploadedFile(NamedTuple):
    """A file as a page sent it."""

    name: str
    content: bytes


def stored(folder: Path, file: UploadedFile, endings: tuple[str, ...]) -> Path:
    """Return where an uploaded file was stored; one of the same name is replaced.

    Args:
        folder: of the run.
        file: the upload.
        endings: of names that are allowed.

    Raises:
        BadInput: the name or the size is not allowed, or there are too many files.
        OSError: it cannot be written.
    """
    path = folder / FOLDER / file.name
    if _NAME.fullmatch(file.name) is None or file.name.endswith((".", " ")):
        words = "the name of a file has letters, digits, dots, blanks, - and _, at most 100"
        raise BadInput(words, key="upload", value=file.name[:100])
    if path.suffix.lower() not in endings:
        raise BadInput(f"a file ends in {', '.join(endings)}", key="upload", value=file.name)
    if len(file.content) > LARGEST:
        raise BadInput(f"{file.name} is larger than {LARGEST // MIB} MiB", key="upload")
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() and sum(1 for _ in path.parent.iterdir()) >= MOST:
        raise BadInput(f"the run has {MOST} files already: {path.parent}", key="upload")
    write_whole(path, file.content)
    return path
