"""Classes of the user's own: from a file, a module or an installed package."""

import importlib
import importlib.util
import sys
import traceback
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from flexslew_plant.errors import BadInput


def find_class(name: str, group: str, what: str, source: str, known: tuple[str, ...]) -> type[Any]:
    """Return the class that a name stands for.

    Args:
        name: `file.py:Class` (a path from the working directory), `package.module.Class`, or the
            name of an entry point.
        group: of the entry points of installed packages, for example flexslew.laws.
        what: what it should be, for the error ("law").
        source: file or node to name in an error.
        known: the names that are built in, for the error.

    Raises:
        BadInput: there is no such class, or its module cannot be imported.
    """
    installed = {point.name: point for point in entry_points(group=group)}
    try:
        if name in installed:
            found = installed[name].load()
        elif ".py:" in name:
            path, _, attribute = name.rpartition(":")
            found = getattr(module_at(Path(path)), attribute)
        elif "." in name:
            place, _, attribute = name.rpartition(".")
            found = getattr(importlib.import_module(place), attribute)
        else:
            allowed = ", ".join(sorted({*known, *installed}))
            kind = what.title().replace(" ", "")
            raise BadInput(
                f"{source}: {name} is not a {what}; allowed: {allowed}, my_{what}.py:My{kind}, "
                f"package.module.My{kind}"
            )
    except BadInput:
        raise
    except Exception as error:  # a user's module may do anything
        raise BadInput(f"{source}: {name} cannot be loaded: {one_line(error)}") from error
    if not isinstance(found, type):
        raise BadInput(f"{source}: {name} is a {type(found).__name__}; a class is needed")
    return found


def module_at(path: Path) -> ModuleType:
    """Return the module of a file, under a name that hides no other; loaded once per content.

    Raises:
        ImportError: it is no Python file.
    """
    stem = f"flexslew_user_{path.stem}"
    loaded = sys.modules.get(stem)
    try:
        stat = path.stat()
        stamp = (str(path.resolve()), stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        raise ImportError(f"{path}: {error.strerror}") from None
    if loaded is not None and getattr(loaded, "_flexslew_stamp", None) == stamp:
        return loaded
    spec = importlib.util.spec_from_file_location(stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    module.__dict__["_flexslew_stamp"] = stamp
    sys.modules[stem] = module  # pickling and Numba look a function's module up by its name
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[stem]
        raise
    return module


def one_line(error: Exception) -> str:
    """Return an exception in one line, with the place in the user's code where it was raised."""
    text = " ".join(str(error).split())
    words = f"{type(error).__name__}: {text}" if text else type(error).__name__
    if isinstance(error, SyntaxError):  # its own words name the place
        return words
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not _ours(f.filename)]
    if not frames:
        return words
    place = next(f for f in reversed(frames) if f.filename == frames[0].filename)
    path = Path(place.filename)
    shown = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    return f"{words} ({shown}, line {place.lineno})"


def _ours(filename: str) -> bool:
    """Return whether a frame is of the bench or of the machinery that imports modules."""
    if filename.startswith("<frozen") or "importlib" in filename:
        return True
    return any(part.startswith("flexslew_") for part in Path(filename).parts[-3:-1])
