"""Which nodes on the graph are alive, by the heartbeats that every node of the bench sends."""

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

BEAT_EVERY = 0.25  # [wall s]
SILENT_AFTER = 0.8  # without a beat a node counts as gone [wall s]
_ONE = ("plant", "planner")  # roles that a bench has once, under any name


class Beat(NamedTuple):
    """One sign of life; see flexslew_msgs/Alive."""

    node: str
    role: str  # plant, controller, recorder, planner, console or live
    instance: int  # drawn by the process at its start
    since: int  # when it started [ns of the wall clock]
    process: str = ""  # machine and PID namespace/id; empty: not known

    @property
    def age(self) -> tuple[int, int]:
        """What orders two of one name: the older one is the smaller."""
        return self.since, self.instance


class Presence:
    """The heartbeats of all nodes, and how long ago they came."""

    def __init__(self) -> None:
        self._heard: dict[int, tuple[Beat, float]] = {}  # by instance, with the wall time [s]
        self._known: dict[str, str] = {}  # role by name, of all nodes with a beat so far

    def hear(self, beat: Beat, now: float) -> None:
        """Take a beat that came at this wall time [s]."""
        self._heard[beat.instance] = beat, now
        self._known[beat.node] = beat.role

    def excuse(self, seconds: float) -> None:
        """Shift all waiting times: the receiver was late, not the nodes."""
        self._heard = {key: (beat, at + seconds) for key, (beat, at) in self._heard.items()}

    def ended(self, beat: Beat) -> None:
        """Note that the process of this beat is no more: it is silent from now on."""
        self._heard[beat.instance] = beat, -inf

    def alive(self, now: float) -> dict[str, Beat]:
        """Return the nodes that are alive, by name; the oldest one of several with one name."""
        found: dict[str, Beat] = {}
        for beat, at in self._heard.values():
            if now - at <= SILENT_AFTER and (
                beat.node not in found or beat.age < found[beat.node].age
            ):
                found[beat.node] = beat
        return found

    def counts(self, name: str, instance: int, now: float) -> bool:
        """Return whether a message from an instance counts as one from the node of this name.

        Of two nodes of one name, the older one's messages count. If no node of the name is alive,
        or the instance is not given (0), every message counts.
        """
        first = self.alive(now).get(name)
        return not instance or first is None or first.instance == instance

    def contradicted(self, name: str, instance: int, since: float, now: float) -> bool:
        """Return whether the node of this name has sent a beat after a message of another instance.

        Args:
            name: name of both.
            instance: the instance that sent the message.
            since: when it sent the message [wall s].
            now: wall clock [s].
        """
        first = self.alive(now).get(name)
        beats = {beat.instance: at for beat, at in self._heard.values()}
        return first is not None and first.instance != instance and beats[first.instance] > since

    def silent(self, name: str, now: float) -> bool:
        """Return whether a node that gave signs of life gives none any more."""
        return name in self._known and name not in self.alive(now)

    def overdue(self, now: float) -> list[Beat]:
        """Return the last beats of all nodes with an overdue next beat."""
        return [beat for beat, at in self._heard.values() if now - at > 1.2 * BEAT_EVERY]

    def lost(self, names: Iterable[str], patience: float, now: float) -> set[str]:
        """Return those of these names with a beat once, but none for `patience` [wall s]."""
        known = self._known.keys() & set(names)
        return {name for name in known if now - self.last_heard(name) > patience}

    def last_heard(self, name: str) -> float:
        """Return when a node of this name gave its last sign of life [wall s]; -inf: never."""
        return max((at for beat, at in self._heard.values() if beat.node == name), default=-inf)

    def of_role(self, role: str) -> list[str]:
        """Return all names with this role that have ever sent a beat."""
        return sorted(name for name, had in self._known.items() if had == role)

    def older(self, beat: Beat, now: float) -> Beat | None:
        """Return the first that came before it, of its name or of a role that is had once."""
        rivals = [other for other in self._rivals(beat, now) if other.age < beat.age]
        return min(rivals, key=lambda other: other.age, default=None)

    def younger(self, beat: Beat, now: float) -> list[Beat]:
        """Return those that came after it, of its name or of a role that is had once."""
        return [other for other in self._rivals(beat, now) if other.age > beat.age]

    def _rivals(self, beat: Beat, now: float) -> list[Beat]:
        return [
            other
            for other, at in self._heard.values()
            if other.instance != beat.instance
            and now - at <= SILENT_AFTER
            and (other.node == beat.node or (other.role == beat.role and beat.role in _ONE))
        ]
