"""Filters the topics of a plant: only the plant of this bench may publish on them."""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from flexslew_lab.log.messages import cdr
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

SIGN_OF_LIFE = "/" + topics.ALIVE
# Frames and markers are anybody's.
_OF_PLANT = frozenset(
    "/" + name.lstrip("/")
    for name in (
        *(topics.MEASUREMENT, topics.TRUTH, topics.TESTBED, topics.ROBOT_DESCRIPTION, topics.CLOCK),
        *(topics.JOINT_STATES, topics.APPENDAGE_STATES),
        *(topics.IMU, topics.ODOMETRY, topics.WRENCH),
    )
)
_UNDECIDED = 5.0  # for a sign of life of a plant that came back; it beats every 0.25 [wall s]
_FAST_DDS, _PREFIX = "rmw_fastrtps", 12  # of a GUID, the part of its participant [B]


class PlantOnly:
    """Admits messages of the plant, and those of others on other topics.

    A plant is identified by its signs of life. Messages of a restarted one may arrive before its
    first sign; they wait for it. Before the first plant, and where the middleware does not give
    the publisher, everything is admitted.
    """

    def __init__(self) -> None:
        self._strangers: dict[str, bool] = {}  # topics with messages of others: was it reported
        self._plants: set[bytes] = set()  # participants of all plants so far
        self._undecided: defaultdict[bytes, deque[tuple[float, str, bytes]]] = defaultdict(deque)

    def admit(
        self, taken: Iterable[tuple[str, bytes, Mapping[str, Any]]], now: float
    ) -> Iterator[tuple[str, bytes]]:
        """Yield topic and CDR of the admitted messages.

        Args:
            taken: topic, CDR, and info of DDS on each message; also of SIGN_OF_LIFE.
            now: [wall s].
        """
        for topic, data, info in taken:
            who = _participant(info)
            if topic == SIGN_OF_LIFE:
                if who not in self._plants and _is_of_plant(data):
                    self._plants.add(who)
            elif topic in _OF_PLANT and who and self._plants and who not in self._plants:
                self._undecided[who].append((now, topic, data))
            else:
                yield topic, data
        for who, held in list(self._undecided.items()):
            if who in self._plants:
                yield from ((topic, data) for _, topic, data in self._undecided.pop(who))
                continue
            while held and held[0][0] < now - _UNDECIDED:
                self._strangers.setdefault(held.popleft()[1], False)

    def strangers(self) -> list[str]:
        """Return topics on which messages were left out, each once."""
        fresh = [topic for topic, told in self._strangers.items() if not told]
        self._strangers.update(dict.fromkeys(fresh, True))
        return fresh


def _is_of_plant(sign_of_life: bytes) -> bool:
    try:
        return bool(cdr.decode(topics.TOPICS[topics.ALIVE].type, sign_of_life).role == "plant")
    except BadInput:
        return False  # anything at all


def _participant(info: Mapping[str, Any]) -> bytes:
    """Return the DDS participant that published a message, one for all nodes of a process.

    Args:
        info: info on the message from rclpy.

    Returns:
        Empty if rclpy or its middleware does not give it.
    """
    gid = info.get("publisher_gid") or {}
    told = gid.get("implementation_identifier", "").startswith(_FAST_DDS)
    return bytes(gid["data"][:_PREFIX]) if told else b""
