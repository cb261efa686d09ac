"""Who on the graph is alive, by the beats that every node of the bench sends."""

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

BEAT_EVERY = 0.25  # [wall s]
SILENT_AFTER = 0.8  # without a beat a node counts as gone [wall s]
_ONE = ("plant", "planner")  # roles that a bench has once, under whatever name


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
        self._known: dict[str, str] = {}  # role by name, of all that were ever heard

    def hear(self, beat: Beat, now: float) -> None:
        """Take a beat that came at this wall time [s]."""
        self._heard[beat.instance] = beat, now
        self._known[beat.node] = beat.role

    def excuse(self, seconds: float) -> None:
        """Start all waiting times anew: it was the listener that was late."""
        self._heard = {key: (beat, at + seconds) for key, (beat, at) in self._heard.items()}

    def ended(self, beat: Beat) -> None:
        """Note that the process of this beat is no more: it is silent from now on."""
        self._heard[beat.instance] = beat, -inf

    def alive(self, now: float) -> dict[str, Beat]:
        """Return who is alive by name; of several with one name the oldest."""
        found: dict[str, Beat] = {}
        for beat, at in self._heard.values():
            if now - at <= SILENT_AFTER and (
                beat.node not in found or beat.age < found[beat.node].age
            ):
                found[beat.node] = beat
        return found

    def counts(self, name: str, instance: int, now: float) -> bool:
        """Return whether what an instance says is said by the node of this name.

        Of two the older one's counts. Where nobody of the name is alive, or the instance is not
        told (0), there is nothing else to go by.
        """
        first = self.alive(now).get(name)
        return not instance or first is None or first.instance == instance

    def contradicted(self, name: str, instance: int, since: float, now: float) -> bool:
        """Return whether the one whose name it is has lived on after another one spoke.

        Args:
            name: of both.
            instance: that spoke.
            since: when it did [wall s].
            now: [wall s].
        """
        first = self.alive(now).get(name)
        beats = {beat.instance: at for beat, at in self._heard.values()}
        return first is not None and first.instance != instance and beats[first.instance] > since

    def silent(self, name: str, now: float) -> bool:
        """Return whether a node that gave signs of life gives none any more."""
        return name in self._known and name not in self.alive(now)

    def overdue(self, now: float) -> list[Beat]:
        """Return the last beats of all whose next one has not come in time."""
        return [beat for beat, at in self._heard.values() if now - at > 1.2 * BEAT_EVERY]

    def lost(self, names: Iterable[str], patience: float, now: float) -> set[str]:
        """Return those of these names that were heard once, and not for `patience` [wall s]."""
        known = self._known.keys() & set(names)
        return {name for name in known if now - self.last_heard(name) > patience}

    def last_heard(self, name: str) -> float:
        """Return when a node of this name gave its last sign of life [wall s]; -inf: never."""
        return max((at for beat, at in self._heard.values() if beat.node == name), default=-inf)

    def of_role(self, role: str) -> list[str]:
        """Return all names with this role that were ever heard."""
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
