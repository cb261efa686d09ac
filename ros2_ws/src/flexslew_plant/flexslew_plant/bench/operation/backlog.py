"""No node falls so far behind that a swap finds a stale estimator or the log a gap."""

from dataclasses import dataclass, field

from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.refusal import Cause, Refusal

# How far ahead of the disk the plant may be, not paced: what the kill of a recorder may cost
RECORDER_LIMIT = 100  # [ticks]; one second at the default period
DDS_LIMIT = LOOP_DEPTH // 4  # the same, paced: of what DDS keeps for a recorder [ticks]


@dataclass
class _NodeStatus:
    tick: int  # last measurement it has seen
    epoch: int
    allowed: int  # ticks behind the plant
    paced: int | None  # the same for a paced plant; None: the plant does not wait for it
    wait_start: float | None = None  # the plant has been waiting for it [wall s]
    lost: bool = False  # silent for so long that it is waited for no more


@dataclass
class NodeProgress:
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
    _nodes: dict[str, _NodeStatus] = field(init=False, default_factory=dict)

    def received(self, name: str, tick: int, epoch: int, recorder: bool = False) -> None:
        """Take a status.

        Args:
            name: of the node.
            tick: the last that it has seen.
            epoch: of that tick.
            recorder: it is one, and not a controller.
        """
        before = self._nodes.get(name)
        if before is None or (before.epoch, before.tick) != (epoch, tick):
            limits = (RECORDER_LIMIT, DDS_LIMIT) if recorder else (self.allowed, None)
            self._nodes[name] = _NodeStatus(tick, epoch, *limits)

    def expect_recorder(self, name: str, tick: int, epoch: int) -> None:
        """Count from this tick on for a recorder that is there and has sent no status yet."""
        if name not in self._nodes:
            self.received(name, tick, epoch, recorder=True)

    def clear(self, name: str) -> None:
        """Wait for this one no more: it has ended."""
        self._nodes.pop(name, None)

    def slow(self, tick: int, epoch: int, now: float) -> list[str]:
        """Return the nodes for which the plant must hold back now.

        Args:
            tick: tick of the next question.
            epoch: epoch of that question.
            now: wall clock [s].
        """
        slow = []
        for name, node in self._nodes.items():
            allowed = node.paced if self.paced else node.allowed
            if node.lost or allowed is None or _lag(node, tick, epoch) <= allowed:
                continue
            if node.wait_start is None:
                node.wait_start = now
            node.lost = now - node.wait_start > self.patience
            if not node.lost:
                slow.append(name)
        return slow

    def lag(self, name: str, tick: int, epoch: int) -> int | None:
        """Return by how many ticks it was behind at its last status; None without a status."""
        node = self._nodes.get(name)
        return None if node is None else _lag(node, tick, epoch)

    def reason(
        self, controller: str, tick: int, epoch: int, at_rest: bool = False
    ) -> Refusal | None:
        """Return why a controller that is too far behind at this tick cannot take charge.

        Args:
            controller: name of the controller.
            tick: tick of the bench.
            epoch: epoch of the bench.
            at_rest: no question comes before the bench goes on, so one that was started meanwhile,
                and has seen none, is not behind: it begins with the next.
        """
        node = self._nodes.get(controller)
        if node is None or _lag(node, tick, epoch) <= node.allowed:
            return None
        if at_rest and node.tick == 0:
            return None
        words = f"it has seen tick {node.tick}, the bench is at {tick}"
        return Refusal(words, cause=Cause.BEHIND)


def _lag(node: _NodeStatus, tick: int, epoch: int) -> int:
    """Return the distance behind the plant [ticks]."""
    return tick - (node.tick if node.epoch == epoch else 0)
