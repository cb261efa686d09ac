"""The log: written by us, read by others, and what happens to it on bad days."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.messages.schemas import type_hash
from flexslew_lab.log.recording.bag_writer import BagWriter, RecordingStopped
from flexslew_plant.errors import BadInput

Message = tuple[str, bytes, int]
Write = Callable[..., Path]


def mcap_file(folder: Path) -> Path:
    return next(folder.glob("*.mcap"))


def test_every_message_comes_back_as_it_went_in(bag: Path, messages: list[Message]) -> None:
    read = [(m.topic, m.data) for m in BagReader(bag).messages()]
    assert read == [(topic, data) for topic, data, _ in messages]


def test_log_times_are_unique_and_rise_from_the_stamps(bag: Path, messages: list[Message]) -> None:
    stamps = np.array([m.stamp for m in BagReader(bag).messages()])
    assert (np.diff(stamps) > 0).all()
    assert (stamps - np.array([stamp for _, _, stamp in messages]) < 20).all()


def test_a_time_that_falls_back_still_rises_in_the_log(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", {"trial": ""}) as writer:
        for stamp in (0, 0, 5_000, 1_000, 5_001, 6_000):
            writer.write(
                "/clock", TOPICS["/clock"].type, encode("rosgraph_msgs/msg/Clock", {}), stamp
            )
    assert [m.stamp for m in BagReader(tmp_path / "run").messages()] == [
        0, 1, 5_000, 5_001, 5_002, 6_000,
    ]  # fmt: skip


def test_rosbags_opens_the_folder(bag: Path, messages: list[Message]) -> None:
    with Reader(bag) as reader:
        assert reader.message_count == len(messages)
        assert set(reader.topics) == {topic for topic, _, _ in messages}
        for connection in reader.connections:
            assert connection.digest == type_hash(connection.msgtype)
        plans = [c for c in reader.connections if c.topic == "/plan"]
        assert isinstance(plans[0].ext, ConnectionExtRosbag2)
        assert plans[0].ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        store = get_typestore(Stores.ROS2_JAZZY)
        for connection in reader.connections:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection, _, data in reader.messages(
            [c for c in reader.connections if c.topic == "/truth"]
        ):
            last: Any = store.deserialize_cdr(data, connection.msgtype)
    assert last.tick == 500
    assert np.allclose(last.position[:2], [1.0, -0.5])


def test_mcap_and_its_ros2_decoder_open_the_file(bag: Path, messages: list[Message]) -> None:
    with mcap_file(bag).open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(messages)
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 1
        assert {m.name for m in reader.iter_metadata()} == {"flexslew", "flexslew_run", "rosbag2"}
        ticks = [
            decoded.tick for _, _, _, decoded in reader.iter_decoded_messages(topics=["/truth"])
        ]
        assert ticks == list(range(501))
        late = reader.iter_messages(topics=["/clock"], starting_at=4_000_000_000)
        assert len(list(late)) == 101


def test_the_folder_describes_itself_in_rosbag2s_version_nine(bag: Path) -> None:
    text = (bag / "metadata.yaml").read_text()
    assert "&id" not in text
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert (information["version"], information["storage_identifier"]) == (9, "mcap")
    assert information["relative_file_paths"] == ["run_0.mcap"]


def test_a_topic_comes_back_as_arrays_over_a_change_of_layout(bag: Path) -> None:
    columns = BagReader(bag).columns("/measurement")
    assert columns["joint_position"].shape == (501, 2)
    assert np.array_equal(columns["tick"], np.arange(501))
    assert list(columns["controller"][[299, 300]]) == ["pd_feedforward", "pi"]


def test_what_is_rare_comes_from_one_pass(bag: Path) -> None:
    overview = BagReader(bag).overview
    assert [e.kind for e in overview.events] == ["started", "switched", "missed", "interrupted"]
    assert overview.events[1].data == {"effort_step": [0.25, -0.5]}
    assert list(overview.testbed.joint_names) == ["base_yaw", "hub_pitch"]
    assert overview.plans[0].duration == 2.0
    assert overview.counts["/truth"] == 501
    assert overview.metadata["flexslew_run"]["wall_time"] == "1.25"
    assert overview.cut is None


def test_a_second_recorder_on_the_folder_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with (
        BagWriter(folder, {"trial": ""}),
        pytest.raises(BadInput, match="another recorder writes here"),
    ):
        BagWriter(folder, {"trial": ""})
    with pytest.raises(BadInput, match="holds a bag already"):
        BagWriter(folder, {"trial": ""})
    assert sorted(p.name for p in folder.iterdir()) == ["metadata.yaml", "run_0.mcap"]


def test_a_cut_file_is_read_up_to_the_cut(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    file = mcap_file(write_bag(tmp_path / "run"))
    whole = file.read_bytes()
    rng = np.random.default_rng(5)
    for size in rng.integers(3000, len(whole) - 1, 25):
        file.write_bytes(whole[:size])
        reader = BagReader(file)
        read = [(m.topic, m.data) for m in reader.messages()]
        assert read == [(topic, data) for topic, data, _ in messages[: len(read)]]
        assert reader.cut is not None
        assert reader.cut.offset + reader.cut.lost == size


def test_what_is_flushed_survives_a_writer_that_never_closes(
    tmp_path: Path, messages: list[Message]
) -> None:
    writer = BagWriter(tmp_path / "run", {"trial": ""})
    for topic, data, stamp in messages:
        writer.write(topic, TOPICS[topic].type, data, stamp)
    reader = BagReader(tmp_path / "run")
    kept = sum(1 for _ in reader.messages())
    lost = sum(len(data) + 31 for _, data, _ in messages[kept:])
    assert reader.cut is not None
    assert lost <= 64 * 1024 + 1000
    writer.close()


def test_a_full_disk_stops_the_recording_with_one_exception(
    tmp_path: Path, messages: list[Message], monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = BagWriter(tmp_path / "run", {"trial": ""})

    class Full:
        def __init__(self, stream: Any) -> None:
            self._stream = stream

        def write(self, data: bytes) -> int:
            if writer._file._at > 20_000:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return int(self._stream.write(data))

        def __getattr__(self, name: str) -> object:
            return getattr(self._stream, name)

    monkeypatch.setattr(writer._file, "_stream", Full(writer._file._stream))

    def write_all() -> None:
        for topic, data, stamp in messages:
            writer.write(topic, TOPICS[topic].type, data, stamp)

    with pytest.raises(RecordingStopped, match="No space left on device"):
        write_all()
    with pytest.raises(RecordingStopped):
        writer.close()
    reader = BagReader(tmp_path / "run")
    assert sum(1 for _ in reader.messages()) > 100
    assert reader.cut is not None


def foreign(path: Path, profile: str = "ros2", schema: bytes = b"uint8 data\n") -> Path:
    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile=profile)
        number = writer.register_schema("flexslew_msgs/msg/PlantState", "ros2msg", schema)
        channel = writer.register_channel("/truth", "cdr", number)
        writer.add_message(channel, 0, b"\x00\x01\x00\x00\x07", 0)
        writer.finish()
    return path


def test_a_foreign_bag_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"not a flexslew bag.*record with the bench's own"):
        BagReader(foreign(tmp_path / "a.mcap"))
    with pytest.raises(BadInput, match="profile 'ros1'"):
        BagReader(foreign(tmp_path / "b.mcap", profile="ros1"))
    (tmp_path / "c.mcap").write_bytes(b"something else entirely")
    with pytest.raises(BadInput, match="not an MCAP file"):
        BagReader(tmp_path / "c.mcap")
    with pytest.raises(BadInput, match="no such bag"):
        BagReader(tmp_path / "nothing")


def test_a_bag_that_is_cut_before_its_first_message_is_not_called_foreign(
    tmp_path: Path, bag: Path
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(next(bag.glob("*.mcap")).read_bytes()[:60])
    with pytest.raises(BadInput, match="a flexslew bag without a message"):
        BagReader(cut)


def test_chunks_that_another_program_has_packed_with_lz4_are_read(
    tmp_path: Path, bag: Path
) -> None:
    own = BagReader(bag)
    packed = tmp_path / "packed.mcap"
    with packed.open("wb") as file, next(bag.glob("*.mcap")).open("rb") as whole:
        reader: Any = make_reader(whole)
        writer: Any = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile="ros2")
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        numbers: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            if channel.id not in numbers:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, kind, channel.metadata
                )
            number, at = numbers[channel.id], message.log_time
            writer.add_message(number, at, message.data, at, message.sequence)
        writer.finish()
    assert list(BagReader(packed).messages()) == list(own.messages())


def test_another_message_definition_is_refused(tmp_path: Path) -> None:
    reader = BagReader(foreign(tmp_path / "a.mcap"), external=True)
    with pytest.raises(BadInput, match="another definition of flexslew_msgs/msg/PlantState"):
        list(reader.messages())


def test_another_format_of_the_record_is_refused(
    tmp_path: Path, write_bag: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexslew_lab.log.bag_layout.FORMAT", "2")
    folder = write_bag(tmp_path / "run")
    with pytest.raises(BadInput, match="written in format 2, this version reads 1"):
        BagReader(folder)
