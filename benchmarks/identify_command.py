"""The command `identify` on ten minutes of shaking at 10 ms: its processor time and memory.

The log is that of the shipped experiment `shake_csa`. The floor is a process that only reads it.
"""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

_COMMAND = ("-m", "flexslew_lab.cli.main")
_READING = (
    "import sys; from pathlib import Path; "
    "from flexslew_lab.identification.identification import experiment_of; "
    "experiment_of(Path(sys.argv[1]))"
)


def figures() -> dict[str, float]:
    """Return the figures.

    identify_command_seconds, _memory_mb: of the whole command, start of Python included: processor
    time of all threads [s] and largest resident memory [MB].
    identify_fit_seconds, _memory_mb: the same with a parameter that is fitted.
    identify_reading_seconds, _memory_mb: of a process that reads the log and ends.
    """
    with TemporaryDirectory() as folder:
        run = str(Path(folder) / "shaken")
        _measured(*_COMMAND, "trial", "shake_csa", "--in-process", "--out", run)
        command = _measured(*_COMMAND, "identify", run)
        fit = _measured(*_COMMAND, "identify", run, "--fit", "parameters.bending_stiffness")
        reading = _measured("-c", _READING, run)
    return {
        "identify_command_seconds": command[0],
        "identify_command_memory_mb": command[1],
        "identify_fit_seconds": fit[0],
        "identify_fit_memory_mb": fit[1],
        "identify_reading_seconds": reading[0],
        "identify_reading_memory_mb": reading[1],
    }


def _measured(*arguments: str) -> tuple[float, float]:
    """Return processor time [s] and largest memory [MB] of a process of Python.

    Raises:
        RuntimeError: it failed.
    """
    command = [sys.executable, "-P", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"exit code {process.returncode}: {' '.join(arguments)}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3
