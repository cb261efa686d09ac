"""The tick up to which a topic is complete: not beyond a gap, even if later ticks have come."""


class TickSequence:
    """Follows the ticks of one topic, which a publisher sends in their order.

    Messages may overtake each other, as two ways to a recorder are not equally fast. In an epoch
    the first tick that is received is the first one there is.

    Attributes:
        whole: epoch and simulated time [ns] of the last tick before the first gap.
        heard: a tick was received.
    """

    def __init__(self) -> None:
        self.whole = 0, -1
        self._next = -1  # tick
        self._after_gap: dict[int, int] = {}  # behind a gap: simulated time by tick

    @property
    def received(self) -> bool:
        """Whether a tick was received."""
        return self._next >= 0

    def receive(self, epoch: int, tick: int, at: int) -> None:
        """Take a tick and its simulated time [ns]."""
        if epoch > self.whole[0] or not self.received:
            self._after_gap, self._next = {}, tick
        if epoch < self.whole[0] or tick < self._next:
            return
        self._after_gap[tick] = at
        self._close_gap(epoch)

    def skip(self) -> bool:
        """Give up the first gap; return whether there was one."""
        if not self._after_gap:
            return False
        self._next = min(self._after_gap)
        self._close_gap(self.whole[0])
        return True

    def _close_gap(self, epoch: int) -> None:
        while (at := self._after_gap.pop(self._next, None)) is not None:
            self.whole = epoch, at
            self._next += 1
