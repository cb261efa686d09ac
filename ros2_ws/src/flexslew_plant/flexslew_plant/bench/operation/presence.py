"""Which nodes on the graph are alive, by the heartbeats that every node of the bench sends."""

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

HEARTBEAT_PERIOD = 0.25  # [wall s]
HEARTBEAT_TIMEOUT = 0.8  # without a beat a node counts as gone [wall s]
_ONE = ("plant", "planner")  # roles that a bench has once, under any name


class Heartbeat(NamedTuple):
    """One sign of life; see flexslew_msgs/Alive."""

    node: str
    role: str  # plant, controller, recorder, planner, console or live
    instance: int  # drawn by the process at its start
    since: int  # when it started [ns of the wall clock]
    process: str = ""  # machine and PID namespace/id; empty: not known

    @property
    def start_order(self) -> tuple[int, int]:
        """What orders two of one name: the older one is the smaller."""
        return self.since, self.instance


class Heartbeats:
    """The heartbeats of all nodes, and how long ago they came."""

    def __init__(self) -> None:
        self._received: dict[
            int, tuple[Heartbeat, float]
        ] = {}  # by instance, with the wall time [s]
        self._roles: dict[str, str] = {}  # role by name, of all nodes with a beat so far

    def receive(self, heartbeat: Heartbeat, now: float) -> None:
        """Take a beat that came at this wall time [s]."""
        self._received[heartbeat.instance] = heartbeat, now
        self._roles[heartbeat.node] = heartbeat.role

    def extend_timeouts(self, seconds: float) -> None:
        """Shift all waiting times: the receiver was late, not the nodes."""
        self._received = {
            key: (heartbeat, at + seconds) for key, (heartbeat, at) in self._received.items()
        }

    def ended(self, heartbeat: Heartbeat) -> None:
        """Note that the process of this beat is no more: it is silent from now on."""
        self._received[heartbeat.instance] = heartbeat, -inf

    def alive(self, now: float) -> dict[str, Heartbeat]:
        """Return the nodes that are alive, by name; the oldest one of several with one name."""
        found: dict[str, Heartbeat] = {}
        for heartbeat, at in self._received.values():
            if now - at <= HEARTBEAT_TIMEOUT and (
                heartbeat.node not in found
                or heartbeat.start_order < found[heartbeat.node].start_order
            ):
                found[heartbeat.node] = heartbeat
        return found

    def counts(self, name: str, instance: int, now: float) -> bool:
        """Return whether a message from an instance counts as one from the node of this name.

        Of two nodes of one name, the older one's messages count. If no node of the name is alive,
        or the instance is not given (0), every message counts.
        """
        first = self.alive(now).get(name)
        return not instance or first is None or first.instance == instance

    def has_later_heartbeat(self, name: str, instance: int, since: float, now: float) -> bool:
        """Return whether the node of this name has sent a beat after a message of another instance.

        Args:
            name: name of both.
            instance: the instance that sent the message.
            since: when it sent the message [wall s].
            now: wall clock [s].
        """
        first = self.alive(now).get(name)
        received_times = {heartbeat.instance: at for heartbeat, at in self._received.values()}
        return (
            first is not None
            and first.instance != instance
            and received_times[first.instance] > since
        )

    def inactive(self, name: str, now: float) -> bool:
        """Return whether a node that gave signs of life gives none any more."""
        return name in self._roles and name not in self.alive(now)

    def late_heartbeats(self, now: float) -> list[Heartbeat]:
        """Return the last beats of all nodes with an overdue next beat."""
        return [
            heartbeat
            for heartbeat, at in self._received.values()
            if now - at > 1.2 * HEARTBEAT_PERIOD
        ]

    def lost(self, names: Iterable[str], patience: float, now: float) -> set[str]:
        """Return those of these names with a beat once, but none for `patience` [wall s]."""
        known = self._roles.keys() & set(names)
        return {name for name in known if now - self.last_heartbeat_time(name) > patience}

    def last_heartbeat_time(self, name: str) -> float:
        """Return when a node of this name gave its last sign of life [wall s]; -inf: never."""
        return max(
            (at for heartbeat, at in self._received.values() if heartbeat.node == name),
            default=-inf,
        )

    def of_role(self, role: str) -> list[str]:
        """Return all names with this role that have ever sent a beat."""
        return sorted(name for name, had in self._roles.items() if had == role)

    def previous(self, heartbeat: Heartbeat, now: float) -> Heartbeat | None:
        """Return the first that came before it, of its name or of a role that is had once."""
        duplicates = [
            other
            for other in self._duplicates(heartbeat, now)
            if other.start_order < heartbeat.start_order
        ]
        return min(duplicates, key=lambda other: other.start_order, default=None)

    def later(self, heartbeat: Heartbeat, now: float) -> list[Heartbeat]:
        """Return those that came after it, of its name or of a role that is had once."""
        return [
            other
            for other in self._duplicates(heartbeat, now)
            if other.start_order > heartbeat.start_order
        ]

    def _duplicates(self, heartbeat: Heartbeat, now: float) -> list[Heartbeat]:
        return [
            other
            for other, at in self._received.values()
            if other.instance != heartbeat.instance
            and now - at <= HEARTBEAT_TIMEOUT
            and (
                other.node == heartbeat.node
                or (other.role == heartbeat.role and heartbeat.role in _ONE)
            )
        ]
