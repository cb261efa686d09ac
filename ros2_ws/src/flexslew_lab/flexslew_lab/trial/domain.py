"""A ROS domain of one's own, so that two runs on one machine do not meet."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flexslew_plant.errors import FlexslewError

_HIGHEST = 101  # above it the ports of DDS meet the ephemeral ones of Linux


@contextmanager
def own_domain() -> Iterator[int]:
    """Yield a ROS_DOMAIN_ID that no other run of this machine holds; the user's, if set.

    Raises:
        FlexslewError: all are taken.
    """
    wanted = os.environ.get("ROS_DOMAIN_ID")
    if wanted:
        yield int(wanted)
        return
    for number in range(1, _HIGHEST + 1):
        path = Path(tempfile.gettempdir()) / f"flexslew_domain_{number}.lock"
        try:
            handle = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        except OSError:
            continue  # another user's
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(handle)
            continue
        try:
            yield number
        finally:
            os.close(handle)
        return
    raise FlexslewError("all ROS domains from 1 to 101 are in use; set ROS_DOMAIN_ID to one")
