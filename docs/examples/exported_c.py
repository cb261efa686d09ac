"""A controller of the bench that calls C code written by `./flexslew export TRIAL --c FOLDER`.

See docs/export_c.md. The argument is the file NAME.c of the folder. The code is compiled by `cc`,
or by the compiler that the environment variable CC names.
"""

import ctypes
import os
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import rclpy
from any_language import Controller
from flexslew_msgs.msg import Measurement, Testbed
from rclpy.executors import ExternalShutdownException

LONGEST_GAP = 1000  # a measurement further ahead comes from another bench [ticks]


class Module:
    """Compiled code of an export, with the memory of one controller.

    Args:
        source: file NAME.c.
        folder: for the library.
    """

    def __init__(self, source: Path, folder: str) -> None:
        library = f"{folder}/controller.so"
        flags = ["-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC"]
        compiler = os.environ.get("CC", "cc").split()
        subprocess.run([*compiler, *flags, str(source), "-o", library, "-lm"], check=True)
        code = ctypes.CDLL(library)
        self.init, self.step = code[f"{source.stem}_init"], code[f"{source.stem}_step"]
        # the size of NAME_memory is in the header; it is smaller than the source
        self.memory = ctypes.create_string_buffer(source.stat().st_size)


class Exported(Controller):
    """Steps the module once per measurement, in order."""

    def __init__(self, source: Path, module: Module) -> None:
        super().__init__(source.stem, str(source))
        self.module, self.period, self.key = module, 0.0, (-1, -1)
        self.output, self.active = (ctypes.c_double * 0)(), False

    def on_testbed(self, testbed: Testbed) -> None:
        """Store the period and the number of actuators."""
        self.period, self.output = testbed.period, (ctypes.c_double * len(testbed.effort_limit))()
        super().on_testbed(testbed)

    def on_measurement(self, m: Measurement) -> None:
        """Step the module, for other controllers' measurements too; answer if it is named."""
        epoch, last = self.key
        if m.epoch == epoch and m.tick > last + LONGEST_GAP:
            return
        self.status.last_tick, self.status.epoch = m.tick, m.epoch
        named = m.controller == self.get_name()
        if not self.limit:
            return
        if m.epoch != epoch:
            self.module.init(self.module.memory)
        if (m.epoch, m.tick) > self.key:  # else it is repeated, with the same answer
            self.key, self.active = (m.epoch, m.tick), named
            measured = (m.joint_position, m.joint_velocity, m.tip_deflection, m.root_curvature)
            numbers = [number for part in (*measured, m.applied_effort) for number in part]
            numbers = [m.tick * self.period, float(named), *numbers]
            values = (ctypes.c_double * len(numbers))(*numbers)
            self.module.step(self.module.memory, values, self.output)
        if named and self.active:  # it has no answer if a question is passed on to it
            self.answer(m, list(self.output))


if __name__ == "__main__":
    given = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as place:
        compiled = Module(given, place)
        rclpy.init()
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            rclpy.spin(Exported(given, compiled))
