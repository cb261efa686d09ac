"""Where results go: checked before the work starts, so that hours of it are not lost at its end.

os.path is used where pathlib raises for a name that is too long or holds a null byte.
"""

import os
from datetime import datetime
from pathlib import Path

from flexslew_plant.errors import BadInput

RUNS = Path("runs")  # below the working directory
WITHOUT = "without_feedforward"  # bag of the same trial without feedforward, in a run's folder


def check_output_file(path: Path, option: str, read: str | Path | None = None) -> Path:
    """Return the path after checking that a file can be written there; nothing is left behind.

    Args:
        path: the file; its folder is made when it is written.
        option: what named it on the command line, for the error.
        read: a trial, of which the command makes what it writes: a file, or a shipped one's name.

    Raises:
        BadInput: it is a folder, its folder cannot hold it, or it is the trial or a log, which
            would be lost.
    """
    if os.path.isdir(path):
        raise BadInput(f"{option}: {path} is a folder; give the name of a file")
    if read and os.path.exists(read) and os.path.exists(path) and os.path.samefile(read, path):
        raise BadInput(f"{option}: {path} is the trial itself; give another name")
    if path.suffix == ".mcap" and os.path.exists(path):
        raise BadInput(f"{option}: {path} is a log; give another name")
    if os.path.exists(path) and not os.access(path, os.W_OK):
        raise BadInput(f"{option}: {path} cannot be written: it is read-only")
    _try(path.parent, path, option, path.name)
    return path


def check_output_folder(path: Path, option: str, empty: bool = False) -> Path:
    """Return the path after checking that files can be written there; nothing is left behind.

    Args:
        path: the folder, made when the first file is written.
        option: what named it on the command line, for the error.
        empty: whether a folder that holds something is refused.

    Raises:
        BadInput: it is a file, cannot be written, or is not empty although it has to be.
    """
    if os.path.exists(path) and not os.path.isdir(path):
        raise BadInput(f"{option}: {path} is a file; give the name of a folder")
    _try(path, path, option, f".flexslew-{os.getpid()}")
    if empty and os.path.isdir(path) and any(path.iterdir()):
        raise BadInput(f"{option}: {path} is not empty; choose another folder")
    return path


def bag_folder(run: Path) -> Path:
    """Return the bag in a run's folder, or the path itself."""
    bag = run / "bag"
    return bag if os.path.isdir(bag) else run  # also of a name that is too long for one


def new_folder(name: str, out: Path | None) -> Path:
    """Return the folder of a run, checked, not yet made.

    Args:
        name: of the run.
        out: the folder that --out names; None: a new one below runs/.

    Raises:
        BadInput: see check_output_folder.
    """
    if out is not None:
        return check_output_folder(out, "--out", empty=True)
    now = datetime.now().strftime("%Y%m%d-%H%M%S")
    out = RUNS / f"{name}-{now}"
    counter = 1
    while os.path.exists(out):
        counter += 1
        out = RUNS / f"{name}-{now}-{counter}"
    return check_output_folder(out, "--out (default)", empty=True)


def new_file(name: str) -> Path:
    """Return a new file below runs/, not yet written.

    Args:
        name: begins its name; its suffix is kept.
    """
    stem, dot, suffix = name.rpartition(".")
    now = datetime.now().strftime("%Y%m%d-%H%M%S")
    path = RUNS / f"{stem}-{now}{dot}{suffix}"
    counter = 1
    while os.path.exists(path):
        counter += 1
        path = RUNS / f"{stem}-{now}-{counter}{dot}{suffix}"
    return path


def _try(folder: Path, named: Path, option: str, name: str) -> None:
    """Write a file of this name into the folder and remove it, with the folders made for it."""
    made: list[Path] = []
    try:
        for missing in reversed([f for f in (folder, *folder.parents) if not os.path.exists(f)]):
            missing.mkdir()
            made.append(missing)
        if not os.path.exists(folder / name):
            (folder / name).touch(exist_ok=False)
            (folder / name).unlink()
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        why = getattr(error, "strerror", None) or str(error)
        raise BadInput(f"{option}: {named} cannot be written: {why}") from None
    finally:
        for one in reversed(made):
            one.rmdir()
