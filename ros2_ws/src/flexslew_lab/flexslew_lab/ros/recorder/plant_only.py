"""Filters the topics of a plant: only the plant of this bench may publish on them."""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from flexslew_lab.log.messages import cdr
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

HEARTBEAT_TOPIC = "/" + topics.ALIVE
# Frames and markers are anybody's.
_OF_PLANT = frozenset(
    "/" + name.lstrip("/")
    for name in (
        *(topics.MEASUREMENT, topics.TRUTH, topics.TESTBED, topics.ROBOT_DESCRIPTION, topics.CLOCK),
        *(topics.JOINT_STATES, topics.APPENDAGE_STATES),
        *(topics.IMU, topics.ODOMETRY, topics.WRENCH),
    )
)
_TIMEOUT = 5.0  # for a sign of life of a plant that came back; it beats every 0.25 [wall s]
_FAST_DDS, _PREFIX = "rmw_fastrtps", 12  # of a GUID, the part of its participant [B]


class PlantOnly:
    """Admits messages of the plant, and those of others on other topics.

    A plant is identified by its signs of life. Messages of a restarted one may arrive before its
    first sign; they wait for it. Before the first plant, and where the middleware does not give
    the publisher, everything is admitted.
    """

    def __init__(self) -> None:
        self._rejected_topics: dict[
            str, bool
        ] = {}  # topics with messages of others: was it reported
        self._plant_ids: set[bytes] = set()  # participants of all plants so far
        self._pending: defaultdict[bytes, deque[tuple[float, str, bytes]]] = defaultdict(deque)

    def filter_messages(
        self, taken: Iterable[tuple[str, bytes, Mapping[str, Any]]], now: float
    ) -> Iterator[tuple[str, bytes]]:
        """Yield topic and CDR of the admitted messages.

        Args:
            taken: topic, CDR, and info of DDS on each message; also of HEARTBEAT_TOPIC.
            now: [wall s].
        """
        for topic, data, info in taken:
            who = _participant(info)
            if topic == HEARTBEAT_TOPIC:
                if who not in self._plant_ids and _is_of_plant(data):
                    self._plant_ids.add(who)
            elif topic in _OF_PLANT and who and self._plant_ids and who not in self._plant_ids:
                self._pending[who].append((now, topic, data))
            else:
                yield topic, data
        for who, pending in list(self._pending.items()):
            if who in self._plant_ids:
                yield from ((topic, data) for _, topic, data in self._pending.pop(who))
                continue
            while pending and pending[0][0] < now - _TIMEOUT:
                self._rejected_topics.setdefault(pending.popleft()[1], False)

    def unknown_items(self) -> list[str]:
        """Return topics on which messages were left out, each once."""
        new_topics = [topic for topic, known in self._rejected_topics.items() if not known]
        self._rejected_topics.update(dict.fromkeys(new_topics, True))
        return new_topics


def _is_of_plant(heartbeat: bytes) -> bool:
    try:
        return bool(cdr.decode(topics.TOPICS[topics.ALIVE].type, heartbeat).role == "plant")
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
    known = gid.get("implementation_identifier", "").startswith(_FAST_DDS)
    return bytes(gid["data"][:_PREFIX]) if known else b""
