"""The recorder's ends of its lines: copies of what others publish, past DDS."""

import struct
from collections.abc import Iterable, Iterator, Mapping
from struct import Struct

from flexslew_plant.direct.line import DirectLine
from flexslew_plant.direct.reception import ListenerSocket
from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.message_codec import HEAD

TOPICS = "topics"  # fact that a caller sends: absolute names of the topics that it publishes
# facts that the recorder sends: its node that listens over DDS, and the topics that it records
NODE, NAMESPACE, RECEIVED = "node", "namespace", "heard"
PART = Struct("<BI")  # number of the topic, and how many bytes of CDR follow
DDS_FLAG = 0x80  # added to the number of a topic: the message goes over DDS, too


class RecorderInput:
    """Takes calls of publishers and their messages: several parts at once, each PART and CDR.

    The recorder receives all of it over DDS, too, as far as it is published there. Of a message
    that goes both ways the first copy is yielded.

    Args:
        address: socket address to listen on.
        topics: the recorder's names of its topics, by their absolute names.
        node: name and namespace of the node that listens over DDS.
    """

    def __init__(self, address: bytes, topics: Mapping[str, str], node: tuple[str, str]) -> None:
        self._listener, self._topics = ListenerSocket(address), topics
        self._node = dict(zip((NODE, NAMESPACE), node, strict=True))
        self._lines: dict[DirectLine, list[str]] = {}  # the recorder's names of their topics
        self._shared: set[str] = set()  # topics of any line
        # what came one way and is still to come the other: how often on a line less over DDS
        self._once: dict[tuple[str, bytes], int] = {}

    def take(self, over_dds: Iterable[tuple[str, bytes]]) -> Iterator[tuple[str, bytes]]:
        """Yield what waits: topic, as the recorder calls it, and CDR.

        Args:
            over_dds: the same of what was taken from DDS before this.
        """
        for line, request in self._listener.callers():
            self._accept(line, request.get(TOPICS))
        for line, names in list(self._lines.items()):
            while (parts := line.receive()) is not None:
                try:
                    for number, data in split(parts):
                        topic = names[number % DDS_FLAG]
                        if number < DDS_FLAG or self._first(topic, data, 1):
                            yield topic, data
                except (struct.error, IndexError):  # no message of a publisher
                    line.close()
            if line.closed:
                del self._lines[line]
        for topic, data in over_dds:
            if topic not in self._shared or self._first(topic, data, -1):
                yield topic, data

    def _first(self, topic: str, data: bytes, way: int) -> bool:
        """Return whether this is not the other copy of what came before; +1: line, -1: DDS."""
        key = topic, data
        before = self._once.pop(key, 0)
        if before + way:
            self._once[key] = before + way
        if len(self._once) > 2 * LOOP_DEPTH * len(self._shared):  # both ends of DDS keep so many
            del self._once[next(iter(self._once))]
        return before * way >= 0

    def _accept(self, line: DirectLine, names: object) -> None:
        """Send the names of those published topics that the recorder takes."""
        if not isinstance(names, list) or len(names) > DDS_FLAG:
            line.close()
            return
        topics = [name for name in names if isinstance(name, str) and name in self._topics]
        line.notify({**self._node, RECEIVED: topics})
        self._lines[line] = [self._topics[name] for name in topics]
        self._shared.update(self._lines[line])


def split(parts: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and CDR of the parts of a message.

    Raises:
        struct.error: it ends within a part, or a part is no CDR.
    """
    at = 0
    while at < len(parts):
        number, size = PART.unpack_from(parts, at)
        at += PART.size + size
        if at > len(parts) or not parts.startswith(HEAD, at - size):
            raise struct.error
        yield number, parts[at - size : at]
