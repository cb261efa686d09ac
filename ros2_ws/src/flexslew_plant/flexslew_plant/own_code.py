"""Classes of the user's own (laws, testbeds, ...), loaded by name: the one door for code.

It is closed unless the caller passes a `Trust` that names the class. A trial file that the user
gives is the user's own word (`ANY_CODE`); a name in a log, a received study folder, a request
or a message is another person's (`NO_CODE`, or what --trust names).
"""

import hashlib
import importlib
import importlib.util
import os
import shlex
import sys
import traceback
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.machinery import SourceFileLoader
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any
from weakref import WeakKeyDictionary

from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.refusal import Refusal

ALL = "all"  # trusts every name
LAWS, TESTBEDS, METRICS, PLANNERS = GROUPS = (  # entry points of packages
    "flexslew.laws",
    "flexslew.testbeds",
    "flexslew.metrics",
    "flexslew.planners",
)


@dataclass(frozen=True)
class Trust:
    """The code that may be loaded, and the files that may be read, by names in trials and requests.

    Attributes:
        names: trusted names of classes, and of files where they may not be read otherwise.
        trust_all: whether every name is trusted.
        files: whether files may be read that values name; None: those that values of a person or a
            request name, not those that a log names.
    """

    names: frozenset[str] = frozenset()
    trust_all: bool = False
    files: bool | None = None

    @classmethod
    def of(cls, names: Collection[str]) -> "Trust":
        """Return the trust in these names; `all` stands for every one."""
        return ANY_CODE if ALL in names else cls(frozenset(names))

    def is_allowed(self, name: str) -> bool:
        """Return whether the class of this name may be loaded."""
        return self.trust_all or name in self.names

    def is_file_allowed(self, path: str) -> bool:
        """Return whether the file of this name may be read."""
        return self.files is not False or self.is_allowed(path)

    def for_log(self) -> "Trust":
        """Return the trust in the values of a log: by default, it names no files."""
        return replace(self, files=bool(self.files))

    def with_files(self) -> "Trust":
        """Return the same trust after allowing the files that the values of a log name."""
        return replace(self, files=True)


NO_CODE, ANY_CODE = Trust(), Trust(trust_all=True)
# by class and name: what code_hash returns
_FOUND: WeakKeyDictionary[type[Any], dict[str, str]] = WeakKeyDictionary()


class Untrusted(BadInput):
    """Code is named that is not trusted.

    Args:
        words: where it is named, and what would run.
        name: name of the class.
    """

    def __init__(self, words: Refusal | str, name: str) -> None:
        super().__init__(words)
        self.name = name


def require_file(trust: Trust, path: str, source: str) -> None:
    """Require that the file of this name may be read.

    Raises:
        Untrusted: if it may not.
    """
    if not trust.is_file_allowed(path):
        words = f"{source}: refused to read {path:.200}, which a log names"
        raise Untrusted(f"{words}; {allow_words(path)}", path)


def require_command(trust: Trust, command: Sequence[str], source: str) -> None:
    """Require that a program may be started.

    Raises:
        Untrusted: if it may not; the message names the SHA-256 of its files.
    """
    name = shlex.join(command)
    if trust.is_allowed(name):
        return
    digest = code_hash(name) or "no file of it is here"
    words = f"{source}: refused to run {name:.200} (SHA-256 {digest}), which is named there"
    raise Untrusted(f"{words}; read it first, then {allow_words(name)}", name)


def allow_words(name: str) -> str:
    """Return how the use of a class or a file is allowed, for the shell."""
    return f"allow it with --trust {shlex.quote(name)}"


def is_user_code(name: str) -> bool:
    """Return whether a name stands for a file or a module: `my_law.py:MyLaw`, `package.MyLaw`."""
    return ".py:" in name or "." in name


def file_of(name: str) -> Path | None:
    """Return the file that would run for a name, without running any of it; None: not found."""
    entry = next(filter(None, (_installed(group).get(name) for group in GROUPS)), None)
    module = entry.module if entry is not None else name.rpartition(".")[0]
    if entry is None and ".py:" in name:
        path = Path(name.rpartition(":")[0])
        return path if path.is_file() else None
    top, *inner = module.split(".")
    with suppress(ImportError, ValueError, AttributeError):
        # find_spec imports the packages around a module: ask for the outermost one only
        spec = importlib.util.find_spec(top) if top else None
        if spec is None or spec.origin is None:
            return None
        place = Path(spec.origin)
        for part in inner:
            folder = place.parent / part
            place = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
        return place if place.is_file() else None
    return None


def code_hash(name: str) -> str:
    """Return the SHA-256 of the file that a name stands for, hexadecimal; empty: no such file.

    A name may be a command, too: then of its files, one after the other.

    Python imports a module once: of a class of one, the file is meant as it was when the class was
    found first here, which is what runs, even if it has changed since.
    """
    place, _, attribute = name.rpartition(".")
    found = getattr(sys.modules.get(place), attribute, None)
    if isinstance(found, type) and name in (known := _FOUND.get(found, {})):
        return known[name]
    path = file_of(name)
    files = _files_of_command(name) if path is None else [path]
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest() if files else ""


def _files_of_command(name: str) -> list[Path]:
    """Return the files that the command of a program names: itself, a script, data."""
    try:
        parts = shlex.split(name)
    except ValueError:
        return []
    return [path for path in map(Path, parts) if path.is_file()]


def find_class(
    name: str, group: str, what: str, source: str, known: tuple[str, ...], trust: Trust
) -> type[Any]:
    """Return the class that a name stands for.

    Args:
        name: `file.py:Class` (a path from the working directory), `package.module.Class`, or the
            name of an entry point.
        group: group of entry points of installed packages, for example flexslew.laws.
        what: kind of the class, for the error ("law").
        source: file or node to name in an error.
        known: the names that are built in, for the error.
        trust: the code that may be loaded; an entry point of an installed package always may.

    Raises:
        Untrusted: a file or a module is named that is not trusted.
        BadInput: there is no such class, or its module cannot be imported.
    """
    installed = _installed(group)
    if name not in installed and is_user_code(name):
        require_trust(trust, name, source)
    try:
        if name in installed:
            found = installed[name].load()
        elif ".py:" in name:
            path, _, attribute = name.rpartition(":")
            found = getattr(module_at(Path(path)), attribute)
        elif "." in name:
            place, _, attribute = name.rpartition(".")
            found = getattr(importlib.import_module(place), attribute)
            if isinstance(found, type):
                _FOUND.setdefault(found, {})[name] = code_hash(name)
        else:
            allowed = ", ".join(sorted({*known, *installed}))
            kind = what.title().replace(" ", "")
            hint = spelling_hint(name, {*known, *installed})
            raise BadInput(
                f"{name} is not a {what}; {hint}allowed: {allowed}, my_{what}.py:My{kind}, "
                f"package.module.My{kind}",
                source,
            )
    except BadInput:
        raise
    except Exception as error:  # a user's module may do anything
        raise BadInput(f"{name} cannot be loaded: {one_line(error)}", source) from error
    if not isinstance(found, type):
        raise BadInput(f"{name} is a {type(found).__name__}; a class is needed", source)
    return found


def _installed(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name.

    What each package offers is read again where a folder of sys.path has changed.
    """
    folder_times = []
    for folder in sys.path:
        with suppress(OSError):
            folder_times.append((folder, os.stat(folder or ".").st_mtime_ns))
    return _cached_entry_points(group, tuple(folder_times))


@lru_cache(maxsize=16)
def _cached_entry_points(group: str, _: tuple[tuple[str, int], ...]) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def require_trust(trust: Trust, name: str, source: str) -> None:
    """Require that the class of this name may be loaded.

    Raises:
        Untrusted: if it may not; the message names its file and SHA-256.
    """
    if trust.is_allowed(name):
        return
    path, digest = file_of(name), code_hash(name)
    if path is None:
        raise Untrusted(
            f"{source}: refused to run {name} (which is not found here), which is named there; "
            f"read the class first, then {allow_words(name)}",
            name,
        )
    words = f"{source}: refused to run {name} ({path.resolve()}, SHA-256 {digest}), which is named "
    raise Untrusted(f"{words}there; read it first, then {allow_words(name)}", name)


def module_at(path: Path) -> ModuleType:
    """Return the module of a file, under a name that hides no other; loaded once per content.

    Raises:
        ImportError: not a Python file.
    """
    module_name = f"flexslew_user_{path.stem}"
    loaded = sys.modules.get(module_name)
    try:
        stat = path.stat()
        stamp = (str(path.resolve()), stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        raise ImportError(f"{path}: {error.strerror}") from None
    if loaded is not None and getattr(loaded, "_flexslew_stamp", None) == stamp:
        return loaded
    if path.suffix != ".py":
        raise ImportError(f"{path} is not a Python file")
    spec = importlib.util.spec_from_file_location(
        module_name, path, loader=_UncachedLoader(module_name, str(path))
    )
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    module.__dict__["_flexslew_stamp"] = stamp
    sys.modules[module_name] = module  # pickling and Numba look a function's module up by its name
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[module_name]
        raise
    return module


class _UncachedLoader(SourceFileLoader):
    """Compiles a file as it stands.

    What Python keeps of a file is taken for current within a second of its last change: the bench
    would fly one law and log the hash of another.
    """

    def get_code(self, fullname: str) -> CodeType:
        code: CodeType = self.source_to_code(self.get_data(self.path), self.path)
        return code


def one_line(error: Exception) -> str:
    """Return an exception in one line, with the place in the user's code where it was raised."""
    text = " ".join(str(error).split())
    words = f"{type(error).__name__}: {text}" if text else type(error).__name__
    if isinstance(error, SyntaxError):  # its own words name the place
        return words
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not _is_internal(f.filename)]
    if not frames:
        return words
    place = next(f for f in reversed(frames) if f.filename == frames[0].filename)
    path = Path(place.filename)
    display_path = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    return f"{words} ({display_path}, line {place.lineno})"


def _is_internal(filename: str) -> bool:
    """Return whether a frame is of the bench or of the machinery that imports modules."""
    if filename.startswith("<frozen") or "importlib" in filename:
        return True
    return any(part.startswith("flexslew_") for part in Path(filename).parts[-3:-1])
