"""No node falls so far behind that a swap finds a stale estimator or the log a gap."""

from dataclasses import dataclass, field

from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.refusal import Cause, Refusal

# How far ahead of the disk the plant may be, not paced: what the kill of a recorder may cost
RECORDED_WITHIN = 100  # [ticks]; one second at the default period
HEARD_WITHIN = LOOP_DEPTH // 4  # the same, paced: of what DDS keeps for a recorder [ticks]


@dataclass
class _Heard:
    tick: int  # last measurement it has seen
    epoch: int
    allowed: int  # ticks behind the plant
    paced: int | None  # the same for a paced plant; None: the plant does not wait for it
    held_since: float | None = None  # the plant has been waiting for it [wall s]
    lost: bool = False  # silent for so long that it is waited for no more


@dataclass
class Backlog:
    """The last tick that each node has seen, from the statuses of controllers and recorders.

    Not paced, the plant holds back for the slowest. Paced, a controller that is too far behind is
    not ready; only for a recorder the plant falls behind its schedule, before the log has a gap.

    Args:
        allowed: largest distance behind the plant [ticks].
        patience: the plant stops waiting for a node without progress after this time [wall s].
        paced: whether the run is paced by the wall clock.
    """

    allowed: int = 1000
    patience: float = 2.0
    paced: bool = False
    _heard: dict[str, _Heard] = field(init=False, default_factory=dict)

    def heard(self, name: str, tick: int, epoch: int, recorder: bool = False) -> None:
        """Take a status.

        Args:
            name: of the node.
            tick: the last that it has seen.
            epoch: of that tick.
            recorder: it is one, and not a controller.
        """
        before = self._heard.get(name)
        if before is None or (before.epoch, before.tick) != (epoch, tick):
            limits = (RECORDED_WITHIN, HEARD_WITHIN) if recorder else (self.allowed, None)
            self._heard[name] = _Heard(tick, epoch, *limits)

    def expect_recorder(self, name: str, tick: int, epoch: int) -> None:
        """Count from this tick on for a recorder that is there and has sent no status yet."""
        if name not in self._heard:
            self.heard(name, tick, epoch, recorder=True)

    def forget(self, name: str) -> None:
        """Wait for this one no more: it has ended."""
        self._heard.pop(name, None)

    def slow(self, tick: int, epoch: int, now: float) -> list[str]:
        """Return the nodes for which the plant must hold back now.

        Args:
            tick: tick of the next question.
            epoch: epoch of that question.
            now: wall clock [s].
        """
        slow = []
        for name, heard in self._heard.items():
            allowed = heard.paced if self.paced else heard.allowed
            if heard.lost or allowed is None or _lag(heard, tick, epoch) <= allowed:
                continue
            if heard.held_since is None:
                heard.held_since = now
            heard.lost = now - heard.held_since > self.patience
            if not heard.lost:
                slow.append(name)
        return slow

    def lag(self, name: str, tick: int, epoch: int) -> int | None:
        """Return by how many ticks it was behind at its last status; None without a status."""
        heard = self._heard.get(name)
        return None if heard is None else _lag(heard, tick, epoch)

    def reason(
        self, controller: str, tick: int, epoch: int, resting: bool = False
    ) -> Refusal | None:
        """Return why a controller that is too far behind at this tick cannot take charge.

        Args:
            controller: name of the controller.
            tick: tick of the bench.
            epoch: epoch of the bench.
            resting: no question comes before the bench goes on, so one that was started meanwhile,
                and has seen none, is not behind: it begins with the next.
        """
        heard = self._heard.get(controller)
        if heard is None or _lag(heard, tick, epoch) <= heard.allowed:
            return None
        if resting and heard.tick == 0:
            return None
        words = f"it has seen tick {heard.tick}, the bench is at {tick}"
        return Refusal(words, cause=Cause.BEHIND)


def _lag(heard: _Heard, tick: int, epoch: int) -> int:
    """Return the distance behind the plant [ticks]."""
    return tick - (heard.tick if heard.epoch == epoch else 0)
