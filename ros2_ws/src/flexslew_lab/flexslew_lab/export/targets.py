"""A C module compiled for other processors by `zig cc`: size of code, RAM and stack."""

import re
import struct
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from flexslew_lab.export.c_module import CModule
from flexslew_lab.export.compiled import WARNINGS, ZIG, run_compiler
from flexslew_plant.extras import required

# by name, the flags of `zig cc`; a bare target has the declarations of musl's math.h
TARGETS = {
    "x86-64": ("-target", "x86_64-linux-musl"),
    "aarch64": ("-target", "aarch64-linux-musl"),
    "Cortex-M7": ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7"),
}
_ALLOCATED, _WRITTEN = 2, 1  # flags of sections of ELF


class TargetSizes(NamedTuple):
    """What a module takes on a processor [bytes]."""

    target: str
    code: int  # with the tables
    ram: int  # of the memory, which the caller provides
    stack: int  # of a step


class CodeSizes(NamedTuple):
    """What an object or a linked program takes [bytes]."""

    fixed: int  # code and constants
    writable: int
    frames: dict[str, int]  # stack of each function, without those that it calls


def compiled_for(
    target: str, sources: Sequence[Path], place: Path, flags: Sequence[str] = ("-c",)
) -> CodeSizes:
    """Compile C code for a processor, or link objects; return what it takes.

    Args:
        target: its name in TARGETS.
        sources: files of the code; their folders have the headers.
        place: of the object, or of the program that is linked without the flag -c.
        flags: more of the compiler.

    Raises:
        ModuleNotFoundError: ziglang is not installed.
        BadInput: the compiler refuses the code.
    """
    include = Path(str(required("ziglang").__file__)).parent / "lib" / "libc" / "include"
    musl = [f"-isystem{include / name}" for name in ("arm-linux-musl", "generic-musl")]
    given = TARGETS[target]
    command = [*ZIG, *given, *(musl if "freestanding" in given[1] else []), *WARNINGS, "-Os"]
    command += ["-fno-sanitize=all", "-Wframe-larger-than=0", "-Wno-error=frame-larger-than"]
    folders = [f"-I{folder}" for folder in sorted({source.parent for source in sources})]
    command += [*folders, *flags, *map(str, sources), "-o", str(place)]
    with TemporaryDirectory() as cache:  # from an object that it has kept it reports no frames
        words = run_compiler(command, {"ZIG_LOCAL_CACHE_DIR": cache})
    frames = re.findall(r"stack frame size \((\d+)\).* in '(\w+)'", words)
    return CodeSizes(*_sections(place), {name: int(size) for size, name in frames})


def sizes_on_targets(module: CModule, folder: Path) -> list[TargetSizes]:
    """Return what a module takes on each processor.

    Args:
        module: the C code.
        folder: with its files; objects are written there.

    Raises:
        ModuleNotFoundError: ziglang is not installed.
        BadInput: the compiler refuses the code.
    """
    probe = folder / f"{module.name}_ram.c"
    probe.write_text(
        f'#include "{module.name}.h"\nextern {module.name}_memory ram;\n'
        f"{module.name}_memory ram;\n",
        encoding="utf-8",
    )
    found = []
    for target in TARGETS:
        place = folder / f"{module.name}_{target}.o"
        code = compiled_for(target, [folder / f"{module.name}.c"], place)
        ram = compiled_for(target, [probe], place).writable
        found.append(TargetSizes(target, code.fixed, ram, _stack(code.frames)))
        place.unlink()
    probe.unlink()
    return found


def _stack(frames: dict[str, int]) -> int:
    """Return the stack of the deepest calls of a module: a step, and one of its phases."""
    steps, phases = (
        [size for name, size in frames.items() if re.fullmatch(rf"(\w+_)?{kind}\w*", name)]
        for kind in ("step", "phase")
    )
    return max(steps, default=0) + max(phases, default=0)


def _sections(path: Path) -> tuple[int, int]:
    """Return how many bytes of an ELF object are read only, and how many may be written."""
    data = path.read_bytes()
    wide = data[4] == 2
    first, size, count = (
        struct.unpack_from("<Q", data, 0x28)[0]
        if wide
        else struct.unpack_from("<I", data, 0x20)[0],
        *struct.unpack_from("<HH", data, 0x3A if wide else 0x2E),
    )
    fixed = writable = 0
    for k in range(count):
        row = struct.unpack_from("<IIQQQQ" if wide else "<IIIIII", data, first + k * size)
        flags, length = row[2], row[5]
        if flags & _ALLOCATED and flags & _WRITTEN:
            writable += length
        elif flags & _ALLOCATED:
            fixed += length
    return fixed, writable
