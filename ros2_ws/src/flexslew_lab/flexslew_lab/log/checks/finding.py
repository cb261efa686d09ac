"""One thing that was looked at in a log."""

from typing import NamedTuple


class Finding(NamedTuple):
    """What was looked at, and whether it is as it should be."""

    ok: bool
    what: str
    detail: str
