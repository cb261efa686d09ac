"""How the bench fares, as diagnostic_msgs on /diagnostics, once a second of wall time."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from flexslew_plant.bench.operation.session import Session
from flexslew_plant.graph import topics
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.offers import publisher

_PERIOD = 1.0  # [wall s]


class Diagnostics:
    """Publishes tick rate, missed ticks, and the lag of controllers and recorders.

    Args:
        node: the plant.
        session: session of the plant.
    """

    def __init__(self, node: Node, session: Session) -> None:
        self._session, self._place = session, f"{node.get_namespace().rstrip('/')}/flexslew"
        self._publisher = publisher(node, topics.DIAGNOSTICS)
        self._last = 0.0, 0  # wall time [s] and tick
        self._missed = 0

    def poll(self, now: float) -> None:
        """Publish if it is time."""
        since, tick = self._last
        if now - since < _PERIOD:
            return
        session, bench = self._session, self._session.bench
        rate = max(bench.tick - tick, 0) / (now - since) if since else 0.0
        missed = max(bench.drive.missed - self._missed, 0)
        self._last, self._missed = (now, bench.tick), bench.drive.missed
        active = bench.drive.active or "the brake"
        words = f"{session.run.state}, {active} is in charge"
        level = DiagnosticStatus.WARN if missed or not bench.drive.active else DiagnosticStatus.OK
        status_list = [
            self._status(
                "bench",
                level,
                words,
                {
                    "tick": bench.tick,
                    "ticks per second": f"{rate:.1f}",
                    "missed": bench.drive.missed,
                    "brake latched": bench.handover.latched,
                },
            )
        ]
        for name in sorted(session.reasons):
            reason = session.reason(name, now)
            level = DiagnosticStatus.WARN if reason else DiagnosticStatus.OK
            status_list.append(self._status(name, level, str(reason or "ready"), self._lag(name)))
        for name in session.heartbeats.of_role("recorder"):
            timed_out = session.heartbeats.inactive(name, now)
            level = DiagnosticStatus.ERROR if timed_out else DiagnosticStatus.OK
            words = "heartbeat lost" if timed_out else "recording"
            status_list.append(self._status(name, level, words, self._lag(name)))
        message = DiagnosticArray(status=status_list)
        message.header.stamp = stamp(bench.time)
        self._publisher.publish(message)

    def _lag(self, name: str) -> dict[str, object]:
        bench = self._session.bench
        lag = self._session.node_progress.lag(name, bench.tick, bench.epoch)
        return {"ticks behind": "unknown" if lag is None else lag}

    def _status(
        self, name: str, level: bytes, words: str, values: dict[str, object]
    ) -> DiagnosticStatus:
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return DiagnosticStatus(
            level=level, name=f"{self._place}: {name}", message=words, hardware_id="", values=pairs
        )
