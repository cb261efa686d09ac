"""Shared libraries of C sources, for this machine and by cross-compilation for Windows."""

import platform
import subprocess
from pathlib import Path
from typing import Literal

from flexslew_lab.export.compiled import compilers
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import install_command

Target = Literal["linux64", "win64"]
TARGETS: dict[Target, tuple[str, str]] = {  # the folder of FMI 3.0, and how a library's name ends
    "linux64": ("x86_64-linux", ".so"),
    "win64": ("x86_64-windows", ".dll"),
}
# products are not contracted into fused ones, so that the results are those of the bench
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fvisibility=hidden", "-s")
_ZIG = {"linux64": "x86_64-linux-gnu.2.17", "win64": "x86_64-windows-gnu"}
_WARNINGS = ("-Wall", "-Wextra", "-pedantic", "-Werror")
_LAST_LINES = 3  # of what a compiler writes, in an error
_TIMEOUT = 600.0  # of a compiler, which builds its C library first [wall s]


def compiler_for(target: Target) -> list[str] | None:
    """Return the command of a compiler for a target; None: there is none here."""
    here = (platform.system(), platform.machine()) == ("Linux", "x86_64")
    found = compilers()
    zig = found.pop("zig", None)
    if target == "linux64" and here and found:
        return [*next(iter(found.values())), "-fPIC"]
    if zig is not None:
        position = ["-fPIC"] if target == "linux64" else []  # all code of Windows can be moved
        return [*zig, "-target", _ZIG[target], *position]
    return None


def targets_of(text: str) -> tuple[Target, ...]:
    """Return the targets that a text names: `linux64,win64`.

    Raises:
        BadInput: one is unknown, or none is named.
    """
    named = [name.strip() for name in text.split(",")]
    for name in named:
        if name not in TARGETS:
            known = ", ".join(TARGETS)
            raise BadInput(f"{name!r} is no target; allowed: {known}", key="--binaries")
    return tuple(target for target in TARGETS if target in named)


def require_compiler(targets: tuple[Target, ...]) -> None:
    """Check that a compiler is here for each target.

    Raises:
        BadInput: there is none for one of them.
    """
    for target in targets:
        if compiler_for(target) is None:
            words = f"no C compiler for {target} here: {install_command('ziglang')}"
            raise BadInput(f"{words}, or leave it out", key="--binaries", value=target)


def compile_library(folder: Path, sources: list[str], library: str, target: Target) -> bytes:
    """Return a shared library.

    Args:
        folder: of the sources.
        sources: file names that end in .c.
        library: its file name, which a library of Windows contains.
        target: where it runs.

    Raises:
        BadInput: there is no compiler, or it refuses a source; its last lines.
    """
    require_compiler((target,))
    command = [*(compiler_for(target) or []), *_FLAGS, *_WARNINGS, "-o", library, *sources, "-lm"]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        raise BadInput(f"{command[0]} has not finished for {target} in {_TIMEOUT:g} s") from None
    if done.returncode:
        words = " | ".join(done.stderr.strip().splitlines()[-_LAST_LINES:])
        raise BadInput(f"{command[0]} refuses the sources for {target}: {words}")
    return (folder / library).read_bytes()
