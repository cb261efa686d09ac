"""A C module compiled for this machine, and called from Python."""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from flexslew_control.controllers.controller import Answer, bare_answer
from flexslew_lab.export.c_module import CModule, Signal
from flexslew_plant.arrays import EMPTY, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Event
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.refusal import Refusal

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic")
_EXACT = ("-O2", "-ffp-contract=off")


ZIG = [sys.executable, "-P", "-m", "ziglang", "cc"]  # the compiler of the extra `c`


def compilers() -> dict[str, list[str]]:
    """Return the C compilers that are here by name, as the beginnings of their commands."""
    found = {name: [path] for name in ("gcc", "clang", "cc") if (path := shutil.which(name))}
    if importlib.util.find_spec("ziglang") is not None:
        found["zig"] = ZIG
    return found


def compiler() -> list[str]:
    """Return the command of a C compiler; the environment variable CC names another one.

    Raises:
        BadInput: there is none.
    """
    if given := os.environ.get("CC"):
        return given.split()
    for command in compilers().values():
        return command
    raise BadInput(
        "no C compiler is here; install gcc or clang, or `./flexslew extras c`", "--check"
    )


def run_compiler(command: list[str], variables: Mapping[str, str] = MappingProxyType({})) -> str:
    """Run a compiler; return its warnings.

    Args:
        command: with all arguments.
        variables: more of the environment.

    Raises:
        BadInput: it refuses the code; the message has its first line.
    """
    environment = {**os.environ, **variables}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        words = (done.stderr or done.stdout).strip().splitlines()
        raise BadInput(
            f"the compiler refuses it: {words[0] if words else 'no message'}", command[0]
        )
    return done.stderr


class CompiledModule:
    """A module that was compiled into a folder, with a memory of its own.

    Args:
        module: the C code.
        folder: where the library is written.
        single: whether it was written for float.

    Raises:
        BadInput: there is no compiler, or it refuses the code.
    """

    def __init__(self, module: CModule, folder: Path, single: bool = False) -> None:
        self.module = module
        for name, text in module.sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        library = folder / f"{module.name}.so"
        library.unlink(missing_ok=True)  # one of that name may be loaded
        source = str(folder / f"{module.name}.c")
        run_compiler(
            [*compiler(), *WARNINGS, *_EXACT, "-shared", "-fPIC", source, "-o", str(library), "-lm"]
        )
        self._library = ctypes.CDLL(str(library))
        self._real = ctypes.c_float if single else ctypes.c_double
        # of any size: what a module keeps is less than all of its text
        self.memory = ctypes.create_string_buffer(sum(map(len, module.sources.values())))
        self._input = self._buffer(module.inputs)
        self._output = self._buffer(module.outputs)
        self._step = self._library[f"{module.name}_step"]
        self.init()

    def _buffer(self, signals: tuple[Signal, ...]) -> Any:
        return (self._real * sum(signal.size for signal in signals))()

    def function(self, name: str) -> Any:
        """Return a further function of the module, by what follows the module's name."""
        return self._library[f"{self.module.name}_{name}"]

    def init(self) -> None:
        """Begin again before the first tick."""
        self._library[f"{self.module.name}_init"](self.memory)

    def step(self, inputs: Vector) -> Vector:
        """Return the outputs of a tick, side by side, from the inputs, side by side."""
        self._input[:] = inputs.tolist()
        self._step(self.memory, self._input, self._output)
        return np.array(self._output, dtype=np.float64)

    def repeat(self, inputs: Vector, count: int) -> None:
        """Carry out many ticks with the same inputs, for measurements of time."""
        self._input[:] = inputs.tolist()
        for _ in range(count):
            self._step(self.memory, self._input, self._output)


def inputs_of(measurement: Measurement, name: str) -> Vector:
    """Return a measurement as the members of a module's struct, side by side."""
    active = float(measurement.controller == name)
    return np.concatenate(([measurement.time, active], *measurement[4:]))


class CompiledController:
    """A controller in C on the bench in process; see run.in_process.

    Args:
        name: of the controller on the bench.
        compiled: its code.
    """

    reason: Refusal | None = None

    def __init__(self, name: str, compiled: CompiledModule) -> None:
        self.name, self.compiled = name, compiled
        self.events: deque[Event] = deque()
        self._key = (-1, -1)
        self._effort: Vector = EMPTY

    def observe(self, measurement: Measurement) -> Answer | None:
        """Return the answer if the measurement names this controller."""
        key = measurement.epoch, measurement.tick
        if measurement.epoch != self._key[0]:
            self.compiled.init()
        if key != self._key:
            self._effort = self.compiled.step(inputs_of(measurement, self.name))
            self._key = key
        if measurement.controller != self.name:
            return None
        return bare_answer(
            EffortCommand(measurement.tick, measurement.epoch, self.name, self._effort)
        )

    def close(self) -> None:
        """Do nothing: its memory is that of this process."""
