"""Which readings of a log may be NaN: those that a fault of the run makes so."""

from collections.abc import Iterable

import numpy as np

from flexslew_plant.events import Event, FaultChanged
from flexslew_plant.faults import FREEZE, NAN

_END = np.iinfo(np.int64).max  # of a span that goes on
_MOST = 64  # faults that blind one channel at once; a crafted log may hold more


class _Channel:
    """The ticks at which one kind of sensor reads NaN in one epoch."""

    def __init__(self) -> None:
        self.starts: list[int] = []
        self.ends: list[int] = []  # first tick after each
        self._active_faults: list[object] = []  # faults that blind it

    def take(self, tick: int, what: FaultChanged) -> None:
        """Take a fault that begins or ends."""
        fault = what.fault or {}
        if not what.on:
            if fault in self._active_faults:
                self._active_faults.remove(fault)
                self.ends[-1] = _END if self._active_faults else tick
            return
        is_nan = bool(self._active_faults) or (bool(self.ends) and self.ends[-1] == tick)
        if fault.get("kind") == NAN.name or (fault.get("kind") == FREEZE.name and is_nan):
            if not self._active_faults:
                self.starts.append(tick)
                self.ends.append(_END)
            if len(self._active_faults) < _MOST:
                self._active_faults.append(fault)


class BlindSensors:
    """The channels that faults blind, by the events of a run.

    A sensor that freezes while it reads NaN goes on to read it.

    Args:
        events: in their order.
    """

    def __init__(self, events: Iterable[Event]) -> None:
        self._channels: dict[tuple[str, int], _Channel] = {}
        for event in events:
            if isinstance(event.what, FaultChanged) and event.what.fault:
                key = str(event.what.fault.get("channel")), event.epoch
                self._channels.setdefault(key, _Channel()).take(event.tick, event.what)

    def at(self, name: str, epoch: np.ndarray, tick: np.ndarray) -> np.ndarray:
        """Return whether a channel may read NaN at each of these ticks, (ticks,)."""
        found = np.zeros(len(tick), dtype=bool)
        for number in np.unique(epoch).tolist():
            channel = self._channels.get((name, number))
            if channel is None or not channel.starts:
                continue
            ticks = tick.astype(np.int64)
            k = np.searchsorted(channel.starts, ticks, side="right") - 1
            ends = np.asarray(channel.ends)[k]
            found |= (epoch == number) & (k >= 0) & (ticks < ends)
        return found
