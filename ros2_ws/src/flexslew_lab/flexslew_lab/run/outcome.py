"""How a run ended."""

from typing import NamedTuple


class Outcome(NamedTuple):
    """How a run ended."""

    exit_code: int  # 0 done, 2 bad input, 3 a fault, 130 interrupted
    message: str  # what went wrong, one line; empty if nothing did
