"""The log while it is written: an MCAP file in a rosbag2 folder, whole up to its last chunk."""

import os
import struct
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

import zstandard
from mcap.records import Channel, McapRecord, Schema

from flexslew_lab.log.bag_layout import (
    METADATA_FILE,
    ROSBAG_RECORD,
    RUN_RECORD,
    TRIAL_RECORD,
    qos_profile,
    with_checksum,
)
from flexslew_lab.log.files.bag_lock import lock_folder, release_folder
from flexslew_lab.log.files.mcap_file import Chunk, McapFile, RecordingStopped, record_bytes
from flexslew_lab.log.files.rosbag2_folder import TopicCount, information, write_description
from flexslew_lab.log.messages.schemas import schema_text, type_hash
from flexslew_plant.errors import BadInput
from flexslew_plant.processes.atomic import atomic
from flexslew_plant.yaml_data import yaml_text

__all__ = ["CHUNK_SIZE", "BagWriter", "RecordingStopped"]

CHUNK_SIZE = 64 * 1024  # uncompressed [B]; what a kill -9 may cost
_MESSAGE = struct.Struct("<BQHIQQ")
_ENTRY = struct.Struct("<QQ")


class _Track:
    """A topic while it is written."""

    __slots__ = ("channel", "count", "entries", "type")

    def __init__(self, channel: int, type_name: str) -> None:
        self.channel, self.type = channel, type_name
        self.count = 0
        self.entries = bytearray()  # message index of the chunk in progress


class BagWriter:
    """Writes messages that are already CDR bytes. Memory does not grow with the log.

    An interrupt leaves a whole message, chunk and file.

    Args:
        folder: becomes the rosbag2 folder; made where it is missing.
        metadata: of the run, all text: trial, trial_file, versions, ...
        chunk_size: bytes of messages before they are compressed and handed to the system [B].
        distribution: of ROS, for metadata.yaml; default: the one that is sourced.

    Raises:
        BadInput: another recorder writes to this folder, or it holds a bag already.
        RecordingStopped: the folder cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        metadata: Mapping[str, str],
        chunk_size: int = CHUNK_SIZE,
        distribution: str = "",
    ) -> None:
        self.folder = Path(folder)
        self.path = self.folder / f"{self.folder.resolve().name}_0.mcap"
        self.last = -1  # log time of the last message [ns]
        self._distribution = distribution or os.environ.get("ROS_DISTRO", "unknown")
        self._chunk_size = chunk_size
        self._compressor = zstandard.ZstdCompressor()
        self._tracks: dict[str, _Track] = {}
        self._records: list[McapRecord] = []  # schemas and channels, again in the summary
        self._schemas: dict[str, int] = {}
        self._buffer = bytearray()
        self._first = -1  # log time of the first message [ns]
        self._chunk_start = -1  # of the first message in the buffer [ns]
        self._closed = False
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = lock_folder(self.folder)
            if self.path.exists() or (self.folder / METADATA_FILE).exists():
                release_folder(self._lock, self.folder)
                raise BadInput("holds a bag already; choose another folder", self.folder)
            self._file = McapFile(self.path)
        except OSError as error:
            raise RecordingStopped(f"{self.folder}: cannot be written: {error.strerror}") from None
        self._file.add_metadata(TRIAL_RECORD, with_checksum(metadata))

    @property
    def messages(self) -> int:
        """How many messages were taken so far."""
        return sum(track.count for track in self._tracks.values())

    def write(self, topic: str, type_name: str, data: bytes, stamp: int) -> None:
        """Append one message.

        Args:
            topic: absolute name.
            type_name: `package/msg/Type`.
            data: CDR bytes.
            stamp: simulated time [ns]; the log time is this, or one more than the last one where
                that is later, so log times are unique and rise.

        Raises:
            RecordingStopped: the disk is full, or another failure of the system; the same again
                at every later chunk.
        """
        with atomic:
            track = self._tracks.get(topic)
            if track is None:
                track = self._new_track(topic, type_name)
            if stamp <= self.last:
                stamp = self.last + 1
            self.last = stamp
            buffer = self._buffer
            if self._chunk_start < 0:
                self._chunk_start = stamp
            track.count += 1
            track.entries += _ENTRY.pack(stamp, len(buffer))
            buffer += _MESSAGE.pack(5, 22 + len(data), track.channel, track.count, stamp, stamp)
            buffer += data
            if len(buffer) > self._chunk_size:
                self.flush()

    def flush(self) -> None:
        """Hand the chunk in progress to the system, so that no end of this process loses it.

        Raises:
            RecordingStopped: as `write`.
        """
        if self._file.failed:
            raise self._file.failed
        if self._chunk_start < 0:
            return
        with atomic:
            raw = bytes(self._buffer)
            tracks = [track for track in self._tracks.values() if track.entries]
            entries = {track.channel: bytes(track.entries) for track in tracks}
            data = self._compressor.compress(raw)
            self._file.add_chunk(Chunk(self._chunk_start, self.last, raw, data, entries))
            self._first = self._chunk_start if self._first < 0 else self._first
            self._chunk_start = -1
            self._buffer.clear()
            for track in tracks:
                track.entries.clear()

    def close(self, run: Mapping[str, str] | None = None) -> None:
        """Finish the file: index, statistics, metadata.yaml. A second call does nothing.

        Args:
            run: how the run ended, all text: wall_time, exit_code, ...

        Raises:
            RecordingStopped: the end could not be written; `recover` makes the bag whole.
        """
        if self._closed:
            return
        with atomic:
            self._closed = True
            try:
                self._finish(run)
            finally:
                self._file.close()
                release_folder(self._lock, self.folder)

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _finish(self, run: Mapping[str, str] | None) -> None:
        self.flush()
        if run is not None:
            self._file.add_metadata(RUN_RECORD, with_checksum(run))
        start, end = max(self._first, 0), max(self.last, 0)
        topics = [TopicCount(t, track.type, track.count) for t, track in self._tracks.items()]
        content = information(self.path.name, start, end, topics, self._distribution)
        self._file.add_metadata(ROSBAG_RECORD, {"serialized_metadata": yaml_text(content, False)})
        counts = {track.channel: track.count for track in self._tracks.values() if track.count}
        self._file.finish(self._records, counts, start, end)
        self._file.call_system(self._file.check_path)
        self._file.call_system(write_description, self.folder / METADATA_FILE, content)

    def _new_track(self, topic: str, type_name: str) -> _Track:
        """Announce a topic; a message follows, so no announcement waits for a chunk in vain."""
        if type_name not in self._schemas:
            self._schemas[type_name] = len(self._schemas) + 1
            text = schema_text(type_name).encode()
            number = self._schemas[type_name]
            self._write_definition(Schema(id=number, name=type_name, encoding="ros2msg", data=text))
        track = _Track(len(self._tracks) + 1, type_name)
        qos = {
            "offered_qos_profiles": yaml_text([qos_profile(topic)], False),
            "topic_type_hash": type_hash(type_name),
        }
        self._write_definition(
            Channel(
                id=track.channel,
                topic=topic,
                message_encoding="cdr",
                metadata=qos,
                schema_id=self._schemas[type_name],
            )
        )
        self._tracks[topic] = track
        return track

    def _write_definition(self, record: McapRecord) -> None:
        self._records.append(record)
        self._buffer += record_bytes(record)
