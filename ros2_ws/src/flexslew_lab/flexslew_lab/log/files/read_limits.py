"""How much of a log is taken into memory at once, and unpacked at all: a bag may be crafted."""

from contextvars import ContextVar
from pathlib import Path

from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import MAX_LENGTH

MIB = 1 << 20
LARGEST = 64 * MIB  # of a chunk or another record, and of all rare messages together [B]
TEXT_KIND = "a YAML or JSON text"
# As parts of the largest chunk. What becomes many small objects takes about thirty times its bytes.
_PARTS = {
    "a chunk": 1,
    "a record": 1,
    "events, plans and statuses": 1,
    "a message of every tick": 16,
    "a metadata record": 32,
    "a message definition": 64,
    TEXT_KIND: LARGEST // MAX_LENGTH,
}
CHANNELS = 256  # of one file
# What a file unpacks to, as a multiple of its size; a bench that rests writes 3 times that
_RATIO = 64
_SLACK = 8  # part of the largest chunk that a small file may unpack to beyond it
TEXT = 32  # what a byte of YAML costs of the same [B]

_largest: ContextVar[int] = ContextVar("largest", default=LARGEST)


def read_at_most(largest: int) -> None:
    """Read logs with another limit from now on [B]."""
    _largest.set(largest)


def check_size(what: str, size: int, source: str) -> None:
    """Check that something of a log is not too large to be read.

    Args:
        what: a key of the table above.
        size: that it has or claims [B].
        source: the log and the place, for the error.

    Raises:
        BadInput: it is larger than the limit.
    """
    allowed = most(what)
    if size > allowed:
        raise BadInput(
            f"{what} of {size / MIB:.1f} MiB, the limit is {allowed / MIB:.3g}; if you "
            "trust this log, raise the limit with --largest-chunk",
            source,
        )


def most(what: str) -> int:
    """Return how large something of a log may be; see check_size [B]."""
    return _largest.get() // _PARTS[what]


class SizeCheck:
    """What one pass over a file has unpacked: it bounds the time by the size of the file.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._allowed = _largest.get() // _SLACK + _RATIO * path.stat().st_size
        self._sum = 0

    def add(self, size: int) -> None:
        """Take a part of this size [B].

        Raises:
            BadInput: a file of this size holds no more in earnest.
        """
        self._sum += size
        if self._sum > self._allowed:
            raise BadInput(
                f"unpacks to more than {self._allowed / MIB:.1f} MiB, {_RATIO} times its size; if "
                "you trust this log, raise the limit with --largest-chunk",
                self._path,
            )


def most_chunks() -> int:
    """Return how many chunks of one file may be indexed: 32 bytes of memory each."""
    return _largest.get() // 32
