"""The channels of a file, checked against the topics and types of this version."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel, Schema

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.files.mcap_scan import SCHEMA, McapRecord, RawMessage, read_record
from flexslew_lab.log.files.read_limits import CHANNELS, check_size
from flexslew_lab.log.messages.older import upgrade
from flexslew_lab.log.messages.schemas import MESSAGES, hash_of_schema, type_hash
from flexslew_plant.errors import BadInput


@dataclass
class Lookup:
    """The channels of a file while it is read."""

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    checked: dict[int, tuple[str, str]] = field(default_factory=dict)  # channel -> topic, type
    previous: dict[int, Callable[[bytes], bytes]] = field(default_factory=dict)  # by channel
    sequence: dict[int, int] = field(default_factory=dict)  # channel -> last one seen
    counted: bool = True  # the recorder has numbered the messages of each topic

    def take(self, record: McapRecord) -> None:
        """Take a schema or a channel."""
        check_size("a message definition", len(record.body), str(self.path))
        if max(len(self.schemas), len(self.channels)) > CHANNELS:
            raise BadInput(f"more than {CHANNELS} topics; no bag has so many", self.path)
        if record.opcode == SCHEMA:
            schema = read_record(Schema, record.body, self.path)
            self.schemas[schema.id] = schema
        else:
            channel = read_record(Channel, record.body, self.path)
            self.channels[channel.id] = channel

    def topic(self, number: int) -> tuple[str, str]:
        """Return topic and type of a channel, once its definition is known to be ours."""
        if number not in self.checked:
            self.checked[number] = self._check(number)
        return self.checked[number]

    def current(self, message: RawMessage) -> bytes:
        """Return the bytes of a message of a known topic, as this version defines its type."""
        convert = self.previous.get(message.channel)
        return message.data if convert is None else convert(message.data)

    def track(self, channel: int, first: int, last: int, count: int) -> None:
        """Take messages of a channel; refuse a file in which some are missing in between."""
        before = self.sequence.get(channel, 0)
        if self.counted and (first != before + 1 or last != before + count):
            raise BadInput(
                f"damaged: messages of {self.topic(channel)[0]} are missing after number "
                f"{before}; `log recover` keeps what is whole",
                self.path,
            )
        self.sequence[channel] = last

    def _check(self, number: int) -> tuple[str, str]:
        channel = self.channels.get(number)
        schema = self.schemas.get(channel.schema_id) if channel else None
        if channel is None or schema is None:
            raise BadInput(f"damaged: a message of an unknown channel {number}", self.path)
        where = f"{self.path}: {channel.topic}"
        if channel.message_encoding != "cdr" or schema.encoding != "ros2msg":
            raise BadInput(
                f"{channel.message_encoding!r} messages with a {schema.encoding!r} schema; only "
                "cdr with ros2msg is read",
                where,
            )
        known = TOPICS.get(channel.topic)
        if known and known.type != schema.name:
            raise BadInput(f"is a {schema.name}, not a {known.type}: a foreign bag", where)
        if schema.name.startswith(f"{MESSAGES}/"):
            text = schema.data.decode(errors="replace")
            recorded, current_hash = hash_of_schema(schema.name, text), type_hash(schema.name)
            declared_hash = channel.metadata.get("topic_type_hash", recorded)
            convert = (
                upgrade(schema.name, text) if recorded == declared_hash != current_hash else None
            )
            if convert is not None:
                self.previous[number] = convert
            elif recorded != current_hash or declared_hash != current_hash:
                raise BadInput(
                    f"recorded with another definition of {schema.name} ({recorded[:15]}, here "
                    f"{current_hash[:15]}); read it with the version that wrote it",
                    where,
                )
        return channel.topic, schema.name
