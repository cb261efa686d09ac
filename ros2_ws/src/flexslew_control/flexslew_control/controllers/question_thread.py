"""Separation of the questions of the bench from those of another bench's topic or an old log.

A bench sends a question each tick, repeats it until it is answered, and begins a new epoch at tick
0. So a question that does not follow is put aside. It counts only if the bench really is there now:
when several more follow it while the bench's own thread is silent, as after a gap.
"""

from typing import TypeAlias

Key: TypeAlias = tuple[int, int]  # epoch and tick

_REPEATS = 3  # questions that follow a strange one, or repeat it, before it counts


class QuestionThread:
    """The questions that were received, in their order."""

    def __init__(self) -> None:
        self._last: Key | None = None
        self._candidate: Key | None = None  # that may be where the bench is now
        self._repeats = 0
        self.resumed = False  # by the last question: its thread is another than the one before

    @property
    def newest(self) -> Key | None:
        """The last question that counted; None: there was none."""
        return self._last

    def take(self, key: Key) -> bool:
        """Return whether a question counts."""
        self.resumed = False
        last = self._last
        if last is None or _is_next(last, key) or (key[0] > last[0] and key[1] == 0):
            self._last, self._candidate = key, None
            return True
        if self._candidate is None or not _is_next(self._candidate, key):
            self._candidate, self._repeats = key, 0
            return False
        self._candidate = key
        self._repeats += 1
        if self._repeats < _REPEATS:
            return False
        self._last, self._candidate, self.resumed = key, None, True
        return True


def _is_next(before: Key, key: Key) -> bool:
    """Return whether a question is the one before again, or the next one."""
    return before[0] == key[0] and 0 <= key[1] - before[1] <= 1
