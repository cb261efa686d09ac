"""A ROS domain of one's own, so that two runs on one machine do not meet; and which are in use."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.file_lock import lock_file

_HIGHEST = 101  # above it the ports of DDS meet the ephemeral ones of Linux
_LAST = 232  # that DDS knows


@contextmanager
def own_domain(what: str = "") -> Iterator[int]:
    """Yield a ROS_DOMAIN_ID that no other run of this machine holds; the user's, if set.

    While it is held, `domains_in_use` lists it.

    Args:
        what: runs there, for those who look for a bench.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
        FlexslewError: all are taken.
    """
    wanted = chosen_domain()
    if wanted is not None:
        handle = _locked(wanted, what)
        try:
            yield wanted
        finally:
            if handle is not None:
                os.close(handle)
        return
    for number in range(1, _HIGHEST + 1):
        handle = _locked(number, what)
        if handle is None:
            continue
        try:
            yield number
        finally:
            os.close(handle)
        return
    raise FlexslewError("all ROS domains from 1 to 101 are in use; set ROS_DOMAIN_ID to one")


def chosen_domain() -> int | None:
    """Return the domain that ROS_DOMAIN_ID names; None where it is not set.

    Raises:
        BadInput: it is not a number of a domain.
    """
    wanted = os.environ.get("ROS_DOMAIN_ID", "").strip()
    if not wanted:
        return None
    if not (wanted.isdigit() and int(wanted) <= _LAST):
        raise BadInput(f"a number from 0 to {_LAST}", key="ROS_DOMAIN_ID", value=wanted)
    return int(wanted)


def domains_in_use() -> dict[int, str]:
    """Return the domains that runs of this machine hold, with what runs there."""
    found = {}
    for path in _folder().glob("flexslew_domain_*.lock"):
        number = path.stem.rpartition("_")[2]
        try:
            handle = lock_file(path, create=False)
            if handle is None:
                found[int(number)] = path.read_text(errors="replace").strip()
            else:
                os.close(handle)
        except OSError:
            continue  # another user's
    return dict(sorted(found.items()))


def bench_domain() -> tuple[int, bool]:
    """Return the domain of the bench to talk to, and whether a run has claimed it.

    ROS_DOMAIN_ID decides where it is set; else the only run of this machine does.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
        FlexslewError: several runs are under way.
    """
    chosen, found = chosen_domain(), domains_in_use()
    if chosen is not None:
        return chosen, chosen in found
    if len(found) > 1:
        runs = ", ".join(f"{number} ({what or 'a bench'})" for number, what in found.items())
        raise FlexslewError(f"several benches run here; set ROS_DOMAIN_ID to one of {runs}")
    return (next(iter(found)), True) if found else (0, False)


def _locked(number: int, what: str) -> int | None:
    """Return the open lock of a domain; None where another run holds it."""
    try:
        handle = lock_file(_folder() / f"flexslew_domain_{number}.lock", 0o666)
    except OSError:
        return None  # another user's
    if handle is None:
        return None
    os.ftruncate(handle, 0)
    os.pwrite(handle, what.encode()[:200], 0)
    return handle


def _folder() -> Path:
    return Path(tempfile.gettempdir())
