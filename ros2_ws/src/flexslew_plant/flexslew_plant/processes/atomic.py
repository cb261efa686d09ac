"""Work that an interrupt must not cut in two."""

import threading
from time import monotonic

_PATIENCE = 2.0  # longer than this a block does not keep an interrupt waiting [wall s]


class _Atomic(threading.local):
    """A block of this thread, entered any number of times: an interrupt waits for its end."""

    def __init__(self) -> None:
        self._depth = 0
        self._since: float | None = None  # when the interrupt came that waits [wall s]

    def __enter__(self) -> None:
        self._depth += 1

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        if self._since is not None and not self._depth:
            self.interrupt()

    def interrupt(self) -> None:
        """Raise KeyboardInterrupt: what a handler of signals calls.

        Within a block it is raised at the end of it, or by the next signal after two seconds.
        """
        if self._depth:
            self._since = self._since or monotonic()
            if monotonic() < self._since + _PATIENCE:
                return
        self._since = None
        raise KeyboardInterrupt


atomic = _Atomic()
