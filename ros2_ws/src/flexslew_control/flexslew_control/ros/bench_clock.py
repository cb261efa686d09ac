"""The simulated time for nodes that do not receive every tick."""

from collections.abc import Callable
from math import inf
from time import monotonic

from flexslew_msgs import msg
from rclpy.node import Node

from flexslew_plant.graph import topics
from flexslew_plant.ros.messages import seconds_of
from flexslew_plant.ros.offers import subscription


class BenchClock:
    """Follows the state of the bench, which the plant publishes at intervals.

    Args:
        node: node that subscribes.
        on_reset: called after a reset of the bench.
        on_state: takes every state, before that.
    """

    def __init__(
        self,
        node: Node,
        on_reset: Callable[[], None],
        on_state: Callable[[msg.BenchState], None] = lambda state: None,
    ) -> None:
        self._on_reset, self._take = on_reset, on_state
        self._state = msg.BenchState()
        self._received_at = 0.0  # when it came [wall s]
        subscription(node, topics.BENCH_STATE, self._on_state)

    @property
    def has_state(self) -> bool:
        """Whether a state of the bench was received."""
        return self._received_at > 0.0

    @property
    def epoch(self) -> int:
        """Number of resets."""
        return int(self._state.epoch)

    @property
    def last_tick(self) -> int:
        """Tick at which the run ends; zero: only when it is stopped."""
        return int(self._state.last_tick)

    @property
    def running(self) -> bool:
        """Whether ticks pass, as far as is known."""
        return bool(self._state.state == "running")

    @property
    def over(self) -> bool:
        """Whether the run has come to its end."""
        return bool(self._state.state == "finished")

    def now(self) -> float:
        """Return the simulated time [s]: as received, plus the time since where it is paced."""
        passed = (
            (monotonic() - self._received_at) * self._state.rate_factor if self.running else 0.0
        )
        return seconds_of(self._state.stamp) + passed

    def later(self, wait: float) -> float:
        """Return how much simulated time passes in a wall time at least as at real time [s]."""
        return wait * max(1.0, float(self._state.rate_factor))

    def _on_state(self, message: msg.BenchState) -> None:
        if message.stamp.sec < 0 or not 0.0 <= message.rate_factor < inf:
            return  # no plant publishes this
        before, self._state, self._received_at = self._state, message, monotonic()
        self._take(message)
        if message.epoch != before.epoch:
            self._on_reset()
