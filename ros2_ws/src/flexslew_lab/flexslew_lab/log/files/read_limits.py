"""How much of a log is taken into memory at once: a bag may claim, or unpack to, gigabytes."""

from contextvars import ContextVar

from flexslew_plant.errors import BadInput

MIB = 1 << 20
LARGEST = 64 * MIB  # of a chunk or another record, and of all rare messages together [B]
# As parts of the largest chunk. What becomes many small objects takes about thirty times its bytes.
_PARTS = {
    "a chunk": 1,
    "a record": 1,
    "events, plans and statuses": 1,
    "a message of every tick": 16,
    "a metadata record": 32,
    "a message definition": 64,
}
CHANNELS = 256  # of one file

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
    allowed = _largest.get() // _PARTS[what]
    if size > allowed:
        raise BadInput(
            f"{what} of {size / MIB:.1f} MiB, the limit is {allowed / MIB:.3g}; if you "
            "trust this log, raise the limit with --largest-chunk",
            source,
        )


def most_chunks() -> int:
    """Return how many chunks of one file may be indexed: 32 bytes of memory each."""
    return _largest.get() // 32
