"""Processor time that a search may take."""

from time import thread_time


class OutOfTimeError(Exception):
    """A search has used its time."""


def require_time(end: float) -> None:
    """Do nothing before the end of a search.

    Args:
        end: as time.thread_time counts [s].

    Raises:
        OutOfTimeError: after it.
    """
    if thread_time() > end:
        raise OutOfTimeError
