"""Whether nodes can start at all on the shared memory of this machine."""

import os
from pathlib import Path

from flexslew_plant.errors import BadInput

FOLDER = Path("/dev/shm")
LEAST = 16 * 1024  # below it the tracing library under rclpy ends a process by SIGBUS [B]


def require_shared_memory(folder: Path = FOLDER) -> None:
    """Refuse to start nodes where they would die without a word.

    DDS itself needs none: it sends by UDP.

    Args:
        folder: where the system keeps it.

    Raises:
        BadInput: it is there, and full.
    """
    try:
        state = os.statvfs(folder)
    except FileNotFoundError:
        return
    free = state.f_bavail * state.f_frsize
    if free < LEAST:
        raise BadInput(
            f"{free} bytes are free, and nodes need {LEAST}: remove what is left there, "
            "give a container more (--shm-size 64m), or fly with --in-process",
            folder,
        )
