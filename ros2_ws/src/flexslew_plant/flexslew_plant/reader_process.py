"""Readers of foreign files as processes of their own: a damaged file cannot end or fill the bench.

A reader is a module whose program calls `write_arrays`. Libraries that read files of others end
their process, fill the memory or never end over some damaged files.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

_TIMEOUT = 60.0  # of a reader [s]
_ERROR = "refused"  # key of what a reader prints, in place of the arrays
_OTHERS = "="  # of the array that holds all but numbers as JSON; no variable is called so
_TOO_LARGE = 3  # exit code of a reader that needs more memory
_PACKAGES = Path(__file__).parents[1]  # where a reader finds this package


class Unreadable(Exception):
    """Raised by a reader: why the file is refused."""


def read_arrays(
    module: str, path: Path, request: Sequence[Any], memory: int, otherwise: str
) -> dict[str, Any]:
    """Return what a reader finds in a file: arrays and other values by name.

    Args:
        module: of the reader.
        path: of the file.
        request: further arguments, as JSON has them.
        memory: of the reader, besides its modules [bytes].
        otherwise: why the file is refused where the reader fails without a reason.

    Raises:
        ValueError: it is damaged, too large, takes too long, or the reader refuses it.
    """
    from flexslew_plant.npz_file import read_npz

    command = [sys.executable, "-P", "-m", module, str(path), str(memory), json.dumps(request)]
    found = os.pathsep.join(filter(None, (str(_PACKAGES), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"PYTHONPATH": found}
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=_TIMEOUT, check=True, env=environment
        )
    except subprocess.TimeoutExpired:
        raise ValueError(f"its reader has not ended within {_TIMEOUT:g} s") from None
    except subprocess.CalledProcessError as error:
        if error.returncode == _TOO_LARGE:
            raise ValueError(f"it unpacks to more than {memory >> 20} MiB") from None
        raise ValueError(otherwise) from None
    arrays = read_npz(BytesIO(done.stdout))
    others: dict[str, Any] = json.loads(str(arrays.pop(_OTHERS)))
    if why := others.pop(_ERROR, ""):
        raise ValueError(why)
    return arrays | others


def write_arrays(read: Callable[..., tuple[dict[str, Any], dict[str, Any]]]) -> None:
    """Read the file that the command line names and write what is found, as `read_arrays` asks.

    Args:
        read: returns arrays and other values of a path; calls the last argument once its modules
            are loaded, which limits the memory.
    """
    import numpy as np

    path, memory, request = sys.argv[1:]
    try:
        arrays, others = read(path, *json.loads(request), lambda: _limit_memory(int(memory)))
    except MemoryError:
        sys.exit(_TOO_LARGE)
    except Unreadable as error:
        arrays, others = {}, {_ERROR: str(error)}
    buffer = BytesIO()
    content: dict[str, Any] = {_OTHERS: np.array(json.dumps(others)), **arrays}
    np.savez(buffer, **content)
    sys.stdout.buffer.write(buffer.getvalue())


def _limit_memory(size: int) -> None:
    """Limit the address space of this process, where the system can."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError):
        return
    limit = pages * resource.getpagesize() + size
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
