"""A ROS domain of one's own, so that two runs on one machine do not meet; and which are in use."""

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from flexslew_lab.run.domain_locks import (
    DomainLock,
    domain_locks,
    is_locked,
    lock_domain,
    user,
)
from flexslew_plant.errors import BadInput, FlexslewError

_HIGHEST = 101  # above it the ports of DDS meet the ephemeral ones of Linux
_LAST = 232  # the highest of DDS
_ROOT = str(Path(__file__).resolve().parents[2])  # the checkout, or the installation by pip
_WORDS = 4096  # largest description of a run in a lock [bytes]
_locks: dict[int, int] = {}  # open locks of this process by domain


class RunningBench(NamedTuple):
    """A bench of this machine, as the lock of its domain describes it."""

    domain: int  # ROS_DOMAIN_ID
    trial: str = ""
    folder: str = ""  # of the run
    root: str = ""  # checkout or installation that flies it
    user: int = 0
    known: bool = True  # whether a run of this machine has claimed the domain
    bench: bool = True  # whether it is one: an examination of a controller is none

    @property
    def is_local(self) -> bool:
        """Whether it is flown by the code of this checkout."""
        return self.root == _ROOT

    @property
    def words(self) -> str:
        """Trial, folder and domain in one line."""
        where = f" in {self.folder}" if self.folder else ""
        other = f", of {self.root}" if self.root and not self.is_local else ""
        return f"{self.trial or 'a bench'}{where}, ROS_DOMAIN_ID {self.domain}{other}"


@contextmanager
def locked_domain(what: str = "", folder: Path | None = None, bench: bool = True) -> Iterator[int]:
    """Yield a ROS_DOMAIN_ID that no other run of this machine holds; the user's, if set.

    While it is held, `running_benches` lists it. The one that has rested longest is taken: where
    the nodes of a run still leave, those of the next one may stand still at their start (Fast DDS
    3.2, see standstill.py).

    Args:
        what: description of the run, for commands that look for a bench.
        folder: folder of the run, for the same.
        bench: whether a bench runs there; else no command is led to it.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
        FlexslewError: if no domain is free.
    """
    requested, handle = requested_domain(), None
    if requested is not None:
        if requested in _locks:  # claimed by this process before it knew the folder
            _describe(_locks[requested], what, folder, bench)
        number = requested
        with suppress(OSError):
            handle = lock_domain(number, domain_locks())
    else:
        number, handle = _free_domain()
    try:
        if handle is not None:
            _locks[number] = handle
            _describe(handle, what, folder, bench)
        yield number
    finally:
        _released(number, handle)


def _free_domain() -> tuple[int, int]:
    """Return the free domain with the oldest last run, and its locked file.

    The highest comes first: a number that a user sets by hand is usually low.

    Raises:
        FlexslewError: if no domain is free.
    """
    locks = domain_locks()
    last = {lock.domain: lock.modified for lock in sorted(locks, key=_modified)}
    errors = []
    for number in sorted(range(1, _HIGHEST + 1), key=lambda n: (last.get(n, 0.0), -n)):
        try:
            handle = lock_domain(number, locks)
        except OSError as error:
            errors.append(f"{error.filename or number}: {error.strerror}")
            continue
        if handle is not None:
            return number, handle
    in_use = _HIGHEST - len(errors)
    others = f", {len(errors)} cannot be locked ({errors[0]})" if errors else ""
    raise FlexslewError(
        f"no ROS domain from 1 to {_HIGHEST} is free: {in_use} are in use{others}; set "
        "ROS_DOMAIN_ID to one"
    )


def requested_domain() -> int | None:
    """Return the domain that ROS_DOMAIN_ID names; None where it is not set.

    Raises:
        BadInput: it is not a number of a domain.
    """
    requested = os.environ.get("ROS_DOMAIN_ID", "").strip()
    if not requested:
        return None
    if not (requested.isdigit() and int(requested) <= _LAST):
        raise BadInput(f"a number from 0 to {_LAST}", key="ROS_DOMAIN_ID", value=requested)
    return int(requested)


def running_benches(all_users: bool = False) -> list[RunningBench]:
    """Return the benches of this user that run on this machine, by domain.

    Args:
        all_users: include benches of other users, as far as their locks can be read.
    """
    found = []
    for lock in domain_locks():
        with suppress(OSError):  # one that this user cannot read
            if is_locked(lock.path):
                found.append(_running_bench(lock))
    this_user = user()
    return sorted(b for b in found if b.bench and (all_users or b.user == this_user))


def default_bench() -> RunningBench:
    """Return the bench that a command of this checkout means.

    ROS_DOMAIN_ID decides where it is set; else the only bench of this checkout; else the only one
    of this user.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
        FlexslewError: several benches are meant, or the domain is another user's.
    """
    requested = requested_domain()
    if requested is not None:
        bench = next((b for b in running_benches(all_users=True) if b.domain == requested), None)
        if bench is not None and bench.user != user():
            raise FlexslewError(f"ROS_DOMAIN_ID {requested} is the bench of another user")
        return bench or RunningBench(requested, known=False)
    found = running_benches()
    candidates: Sequence[RunningBench] = [bench for bench in found if bench.is_local] or found
    if len(candidates) > 1:
        runs = "; ".join(bench.words for bench in candidates)
        raise FlexslewError(f"several benches run here; set ROS_DOMAIN_ID to the one meant: {runs}")
    return candidates[0] if candidates else RunningBench(0, known=False)


def bench_without_lock() -> list[RunningBench]:
    """Return the domain of this shell, unless a run has claimed it.

    Nodes that are started one by one, or by `ros2 launch`, claim none.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
    """
    here = requested_domain() or 0
    locked = any(bench.domain == here for bench in running_benches(all_users=True))
    return [] if locked else [RunningBench(here, known=False)]


def bench_domain() -> tuple[int, bool]:
    """Return the domain of the bench to talk to, and whether a run has claimed it.

    Raises:
        BadInput, FlexslewError: see default_bench.
    """
    bench = default_bench()
    return bench.domain, bench.known


def _running_bench(lock: DomainLock) -> RunningBench:
    """Return the run that a lock file describes; only its owner for a file of another version."""
    with lock.path.open(encoding="utf-8", errors="replace") as file:
        text, owner = file.read(_WORDS), os.fstat(file.fileno()).st_uid
    try:
        record = json.loads(text)
        trial, folder, root = (str(record[key]) for key in ("trial", "folder", "root"))
        bench = bool(record.get("bench", True))
        return RunningBench(lock.domain, trial, folder, root, owner, bench=bench)
    except (ValueError, KeyError, TypeError):
        return RunningBench(lock.domain, user=owner)


def _describe(handle: int, what: str, folder: Path | None, bench: bool) -> None:
    """Write the description of a domain's run into its lock, for commands that look for a bench."""
    where = "" if folder is None else str(folder.resolve())
    facts = {"trial": what[:200], "folder": where, "root": _ROOT, "bench": bench}
    os.ftruncate(handle, 0)
    os.pwrite(handle, json.dumps(facts).encode(), 0)


def _released(number: int, handle: int | None) -> None:
    if handle is not None:
        del _locks[number]
        os.ftruncate(handle, 0)  # this also sets the time of the file
        os.close(handle)


def _modified(lock: DomainLock) -> float:
    return lock.modified
