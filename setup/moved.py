"""Rewrite the absolute paths of a checkout that was moved or copied: `moved.py OLD NEW`.

They are in the scripts of .venv, in the workspace (its symbolic links and generated files), and in
the folder names of the machine-code cache. A compiled library that names the old path finds its
neighbours by LD_LIBRARY_PATH all the same.
"""

import os
import re
import sys
from collections.abc import Iterator
from hashlib import sha1
from pathlib import Path

_LARGEST = 1 << 24  # of a generated text file [B]


def files(folders: list[Path]) -> Iterator[Path]:
    """Yield the files and symbolic links below some folders, through no link."""
    for folder in folders:
        for root, names, others in os.walk(folder):
            links = [name for name in names if os.path.islink(os.path.join(root, name))]
            yield from (Path(root, name) for name in (*links, *others))


def rewrite(path: Path, old: bytes, new: bytes) -> None:
    """Replace a path, alone or as a parent of others, in a link or a text file."""
    whole = re.compile(rb"(?:(?<![\w.+-])|(?<=-[A-Z]))" + re.escape(old) + rb"(?![\w.+-])")
    if path.is_symlink():
        target = os.fsencode(os.readlink(path))
        if whole.match(target):
            path.unlink()
            os.symlink(new + target[len(old) :], path)
        return
    if not path.is_file() or (state := path.stat()).st_size > _LARGEST:
        return
    content = path.read_bytes()
    if old not in content or b"\0" in content:
        return
    draft = path.with_name(f"{path.name}.moved")  # a hard link of a copy keeps its content
    draft.write_bytes(whole.sub(lambda _: new, content))
    draft.chmod(state.st_mode & 0o7777)
    os.utime(draft, ns=(state.st_atime_ns, state.st_mtime_ns))
    draft.replace(path)


def rename_machine_code(old: Path, new: Path) -> None:
    """Rename the folders of the cache, each of which Numba finds by the path of its sources."""

    def cache_name(folder: Path) -> str:
        return f"{folder.name}_{sha1(str(folder).encode()).hexdigest()}"

    workspace = new / "ros2_ws"
    names = {}
    for package in (workspace / "src").glob("*"):
        for folder in (part for part, _, _ in os.walk(package)):
            for tree in ("src", "build"):
                relative = Path("ros2_ws", tree) / Path(folder).relative_to(workspace / "src")
                names[cache_name(old / relative)] = cache_name(new / relative)
    for cache in (new / ".numba_cache").glob("*/*"):
        name = names.get(cache.name)
        if name and not cache.with_name(name).exists():
            cache.rename(cache.with_name(name))


def main() -> None:
    """Rewrite the paths of the checkout that the command line names."""
    old, new = (Path(argument) for argument in sys.argv[1:])
    trees = [new / "ros2_ws" / name for name in ("build", "install")]
    venv = new / ".venv"
    if not venv.is_symlink():
        trees.append(venv / "bin")
        rewrite(venv / "pyvenv.cfg", os.fsencode(old), os.fsencode(new))
    stamps = [*(new / "ros2_ws" / "install").glob("flexslew.*")]
    for path in files(trees):
        if path not in stamps:
            rewrite(path, os.fsencode(old), os.fsencode(new))
    rename_machine_code(old, new)
    for path in stamps:  # the last ones: an interrupted call is repeated
        rewrite(path, os.fsencode(old), os.fsencode(new))


if __name__ == "__main__":
    main()
