"""Who may speak on the topics of a plant: the plant of this bench."""

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
    """Lets in what the plant says, and what others say on other topics.

    A plant is known by its signs of life. One that was started again may be heard before its first
    one: what it says waits for that. Before any plant was heard, and where the middleware does not
    say who publishes, everything is let in.
    """

    def __init__(self) -> None:
        self._strangers: dict[str, bool] = {}  # topics that others spoke on, and whether it is told
        self._plants: set[bytes] = set()  # participants of all that were heard
        self._undecided: defaultdict[bytes, deque[tuple[float, str, bytes]]] = defaultdict(deque)

    def admit(
        self, taken: Iterable[tuple[str, bytes, Mapping[str, Any]]], now: float
    ) -> Iterator[tuple[str, bytes]]:
        """Yield topic and CDR of what is let in.

        Args:
            taken: topic, CDR, and what DDS says of a message; also of SIGN_OF_LIFE.
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
    """Return who of DDS published a message, which is one for all nodes of a process.

    Args:
        info: of the message, as rclpy gives it.

    Returns:
        Empty where rclpy or its middleware does not say.
    """
    gid = info.get("publisher_gid") or {}
    told = gid.get("implementation_identifier", "").startswith(_FAST_DDS)
    return bytes(gid["data"][:_PREFIX]) if told else b""
