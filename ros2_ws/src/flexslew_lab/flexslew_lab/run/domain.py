"""A ROS domain of one's own, so that two runs on one machine do not meet; and which are in use."""

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.processes.file_lock import lock_file

_HIGHEST = 101  # above it the ports of DDS meet the ephemeral ones of Linux
_LAST = 232  # that DDS knows
_ROOT = str(Path(__file__).resolve().parents[2])  # the checkout, or the installation by pip
_WORDS = 4096  # that a lock says of its run, at most [bytes]
_held: dict[int, int] = {}  # open locks of this process by domain


class RunningBench(NamedTuple):
    """A bench of this machine, as the lock of its domain describes it."""

    domain: int  # ROS_DOMAIN_ID
    trial: str = ""
    folder: str = ""  # of the run
    root: str = ""  # whose code flies it
    user: int = 0
    known: bool = True  # whether a run of this machine has claimed the domain
    bench: bool = True  # whether it is one: an examination of a controller is none

    @property
    def here(self) -> bool:
        """Whether it is flown by the code of this checkout."""
        return self.root == _ROOT

    @property
    def words(self) -> str:
        """Trial, folder and domain in one line."""
        where = f" in {self.folder}" if self.folder else ""
        other = f", of {self.root}" if self.root and not self.here else ""
        return f"{self.trial or 'a bench'}{where}, ROS_DOMAIN_ID {self.domain}{other}"


@contextmanager
def own_domain(what: str = "", folder: Path | None = None, bench: bool = True) -> Iterator[int]:
    """Yield a ROS_DOMAIN_ID that no other run of this machine holds; the user's, if set.

    While it is held, `running_benches` lists it. The one that has rested longest is taken: where
    the nodes of a run still leave, those of the next one may stand still at their start (Fast DDS
    3.2, see standstill.py).

    Args:
        what: runs there, for those who look for a bench.
        folder: of the run, for the same.
        bench: is what runs there; else nobody who looks for one is led to it.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
        FlexslewError: all are taken.
    """
    requested = chosen_domain()
    if requested is not None:
        if requested in _held:  # claimed by this process before it knew the folder
            _describe(_held[requested], what, folder, bench)
        handle = _locked(requested, what, folder, bench)
        try:
            yield requested
        finally:
            _released(requested, handle)
        return
    for number in sorted(range(1, _HIGHEST + 1), key=_last_used):
        handle = _locked(number, what, folder, bench)
        if handle is None:
            continue
        try:
            yield number
        finally:
            _released(number, handle)
        return
    raise FlexslewError("all ROS domains from 1 to 101 are in use; set ROS_DOMAIN_ID to one")


def chosen_domain() -> int | None:
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


def running_benches(everybody: bool = False) -> list[RunningBench]:
    """Return the benches of this user that run on this machine, by domain.

    Args:
        everybody: those of other users, too, as far as their locks can be read.
    """
    found = []
    for path in _folder().glob("flexslew_domain_*.lock"):
        number = path.stem.rpartition("_")[2]
        try:
            handle = lock_file(path, create=False)
            if handle is None:
                found.append(_described(int(number), path))
            else:
                os.close(handle)
        except (OSError, ValueError):
            continue  # another user's, or no lock of ours
    mine = _user()
    return sorted(b for b in found if b.bench and (everybody or b.user == mine))


def bench_to_operate() -> RunningBench:
    """Return the bench that a command of this checkout means.

    ROS_DOMAIN_ID decides where it is set; else the only bench of this checkout; else the only one
    of this user.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
        FlexslewError: several benches are meant, or the domain is another user's.
    """
    chosen = chosen_domain()
    if chosen is not None:
        bench = next((b for b in running_benches(everybody=True) if b.domain == chosen), None)
        if bench is not None and bench.user != _user():
            raise FlexslewError(f"ROS_DOMAIN_ID {chosen} is the bench of another user")
        return bench or RunningBench(chosen, known=False)
    found = running_benches()
    meant: Sequence[RunningBench] = [bench for bench in found if bench.here] or found
    if len(meant) > 1:
        runs = "; ".join(bench.words for bench in meant)
        raise FlexslewError(f"several benches run here; set ROS_DOMAIN_ID to the one meant: {runs}")
    return meant[0] if meant else RunningBench(0, known=False)


def bench_without_claim() -> list[RunningBench]:
    """Return the domain of this shell, unless a run has claimed it.

    Nodes that are started one by one, or by `ros2 launch`, claim none.

    Raises:
        BadInput: ROS_DOMAIN_ID is not a number of a domain.
    """
    here = chosen_domain() or 0
    claimed = any(bench.domain == here for bench in running_benches(everybody=True))
    return [] if claimed else [RunningBench(here, known=False)]


def bench_domain() -> tuple[int, bool]:
    """Return the domain of the bench to talk to, and whether a run has claimed it.

    Raises:
        BadInput, FlexslewError: see bench_to_operate.
    """
    bench = bench_to_operate()
    return bench.domain, bench.known


def _described(number: int, path: Path) -> RunningBench:
    """Return what a lock says of its run; of one of another version only its owner is known."""
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read(_WORDS)
    try:
        claim = json.loads(text)
        trial, folder, root = (str(claim[key]) for key in ("trial", "folder", "root"))
        bench = bool(claim.get("bench", True))
        return RunningBench(number, trial, folder, root, int(claim["user"]), bench=bench)
    except (ValueError, KeyError, TypeError):
        return RunningBench(number, user=path.stat().st_uid)


def _locked(number: int, what: str, folder: Path | None, bench: bool) -> int | None:
    """Return the open lock of a domain; None where another run holds it."""
    try:
        handle = lock_file(_lock_path(number), 0o666)
    except OSError:
        return None  # another user's
    if handle is None:
        return None
    _held[number] = handle
    _describe(handle, what, folder, bench)
    return handle


def _describe(handle: int, what: str, folder: Path | None, bench: bool) -> None:
    """Write into a lock what runs in its domain, for those who look for a bench."""
    where = "" if folder is None else str(folder.resolve())
    facts = {
        "trial": what[:200], "folder": where, "root": _ROOT, "user": _user(), "bench": bench
    }  # fmt: skip
    os.ftruncate(handle, 0)
    os.pwrite(handle, json.dumps(facts).encode(), 0)


def _released(number: int, handle: int | None) -> None:
    if handle is not None:
        del _held[number]
        os.ftruncate(handle, 0)  # and so the file tells when
        os.close(handle)


def _lock_path(number: int) -> Path:
    return _folder() / f"flexslew_domain_{number}.lock"


def _last_used(number: int) -> float:
    """Return when a run has taken or left a domain; 0: never since the machine started."""
    try:
        return _lock_path(number).stat().st_mtime
    except OSError:
        return 0.0


def _user() -> int:
    return getattr(os, "getuid", int)()


def _folder() -> Path:
    return Path(tempfile.gettempdir())
