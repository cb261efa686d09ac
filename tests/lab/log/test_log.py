"""Logs on bad days: killed, full, cut, flipped; and what can be asked of them."""

import json
import multiprocessing
import os
import resource
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from rosbags.rosbag2 import Reader

from flexslew_lab.log import export as log_export
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.export import export_log, units_of
from flexslew_lab.log.info import log_info
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_writer import CHUNK_SIZE, BagWriter, RecordingStopped
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.notebook import trial
from flexslew_lab.run.run_trial import run_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import flat

Message = tuple[str, bytes, int]
Write = Callable[..., Path]


def mcap_file(folder: Path) -> Path:
    return next(folder.glob("*.mcap"))


def bad(folder: Path) -> list[str]:
    return [f.what for f in check_log(folder) if not f.ok]


def write_forever(folder: Path, messages: list[Message], pipe: Any) -> None:
    writer = BagWriter(folder, {"trial": ""})
    count = 0
    while True:
        for topic, data, stamp in messages:
            writer.write(topic, TOPICS[topic].type, data, stamp)
            count += 1
            if count % 100 == 0:
                pipe.send(count)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_killed_recorder_costs_one_chunk_at_most(tmp_path: Path, messages: list[Message]) -> None:
    rng = np.random.default_rng(7)
    context = multiprocessing.get_context("fork")
    largest = max(len(data) for _, data, _ in messages) + 31
    for number in range(50):
        folder = tmp_path / str(number)
        reader, writer = context.Pipe(duplex=False)
        child = context.Process(target=write_forever, args=(folder, messages, writer))
        child.start()
        writer.close()  # so that a child that fails is heard
        requested = int(rng.integers(1, 40))
        written = [reader.recv() for _ in range(requested)][-1]
        assert child.pid is not None
        os.kill(child.pid, signal.SIGKILL)
        child.join()
        if not mcap_file(folder).stat().st_size > 3 * CHUNK_SIZE // 10:
            continue  # not one chunk was full yet
        recovery = recover(folder)
        kept = sum(recovery.kept.values())
        rows = [messages[k % len(messages)][1] for k in range(kept, written)]
        assert sum(len(data) + 31 for data in rows) <= CHUNK_SIZE + largest
        assert recovery.lost == {}
        with Reader(folder) as opened:
            assert opened.message_count == kept


def fill(folder: Path, messages: list[Message], pipe: Any) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
    writer = BagWriter(folder, {"trial": ""})
    try:
        for topic, data, stamp in messages * 4:
            writer.write(topic, TOPICS[topic].type, data, stamp)
    except RecordingStopped as stopped:
        pipe.send(str(stopped))
    try:
        writer.close()
    except RecordingStopped:
        pipe.send("closed")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_system_that_takes_no_more_bytes_leaves_whole_chunks(
    tmp_path: Path, messages: list[Message]
) -> None:
    context = multiprocessing.get_context("fork")
    reader, writer = context.Pipe(duplex=False)
    child = context.Process(target=fill, args=(tmp_path / "run", messages, writer))
    child.start()
    writer.close()
    assert "recording stopped: File too large" in reader.recv()
    assert reader.recv() == "closed"
    child.join()
    assert child.exitcode == 0
    bag = BagReader(tmp_path / "run")
    kept = [(m.topic, m.data) for m in bag.messages()]
    assert len(kept) > 500
    assert kept == [(topic, data) for topic, data, _ in messages[: len(kept)]]
    assert bag.cut is not None
    assert bag.cut.lost == 0


def test_recovery_says_what_is_missing(tmp_path: Path, write_bag: Write) -> None:
    folder = write_bag(tmp_path / "run")
    file = mcap_file(folder)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    (folder / "metadata.yaml").unlink()
    before = [(m.topic, m.stamp, m.data) for m in BagReader(file).messages()]
    recovery = recover(folder)
    assert [(m.topic, m.stamp, m.data) for m in BagReader(folder).messages()] == before
    assert f"up to tick {recovery.last_tick}" in recovery.statement
    assert "bytes not readable" in recovery.statement
    assert bad(folder) == ["end of the run"]
    assert (folder / "run_0.mcap.damaged").read_bytes() == whole[: len(whole) // 2]
    assert metrics_of(folder)["log_complete"] is True


def test_a_damaged_chunk_is_left_out_and_counted(tmp_path: Path, write_bag: Write) -> None:
    folder = write_bag(tmp_path / "run")
    file = mcap_file(folder)
    data = bytearray(file.read_bytes())
    chunks = _offsets(bytes(data))
    data[chunks[2] + 200] ^= 0xFF
    file.write_bytes(data)
    with pytest.raises(BadInput, match="damaged chunk"):
        metrics_of(folder)
    assert bad(folder) == ["checksums, schemas and sequence"]
    recovery = recover(folder, tmp_path / "new")
    assert recovery.chunks_lost == 1
    assert recovery.missing_ticks > 10
    assert recovery.lost["/truth"] == recovery.missing_ticks
    assert metrics_of(tmp_path / "new")["missing_ticks"] == recovery.missing_ticks
    assert "/truth" in bad(tmp_path / "new")


def test_recovery_tells_what_is_missing_before_the_first_tick(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    folder = write_bag(tmp_path / "run", [m for m in messages if m[2] >= 2_000_000_000])
    recovery = recover(folder, tmp_path / "new")
    assert recovery.missing_ticks == 200
    assert "every record was whole; 200 ticks missing before the last" in recovery.statement


def test_two_runs_in_one_log_are_not_measured_as_one(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    again = [(topic, data, stamp + messages[-1][2]) for topic, data, stamp in messages]
    folder = write_bag(tmp_path / "run", [*messages, *again])
    with pytest.raises(BadInput, match="tick 0 of epoch 0: it holds more than one run"):
        metrics_of(folder)
    assert "/truth" in bad(folder)


def _offsets(data: bytes) -> list[int]:
    found, at = [], 8
    while at < len(data) - 8:
        if data[at] == 6:
            found.append(at)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return found


def test_a_folder_that_is_being_recorded_is_not_touched(tmp_path: Path) -> None:
    with (
        BagWriter(tmp_path / "run", {"trial": ""}),
        pytest.raises(BadInput, match="another recorder writes here"),
    ):
        recover(tmp_path / "run")


def answer_of(action: Callable[[Path], Any], path: Path) -> Any:
    """Return what the action says, or None where it refuses in one line."""
    try:
        return action(path)
    except BadInput as error:
        (line,) = str(error).splitlines()
        assert line
        return None


@pytest.fixture(scope="module")
def small(
    tmp_path_factory: pytest.TempPathFactory, write_bag: Write, messages: list[Message]
) -> Path:
    return write_bag(tmp_path_factory.mktemp("small") / "run", messages[:700])


@pytest.mark.parametrize("cut", [False, True], ids=["finished", "never finished"])
def test_a_flipped_byte_is_an_error_or_changes_no_number(
    tmp_path: Path, small: Path, cut: bool
) -> None:
    whole = mcap_file(small).read_bytes()
    if cut:
        whole = whole[: _offsets(whole)[-1] + 400]
    path = tmp_path / "flipped.mcap"
    path.write_bytes(whole)
    expected = metrics_of(path)
    rng = np.random.default_rng(11)
    refused = 0
    for _ in range(200):
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        metrics = answer_of(metrics_of, path)
        if metrics is None:
            refused += 1
            continue
        if not metrics["log_complete"]:  # then it says so, and is right about what it has
            assert metrics["missing_ticks"] == 0
            assert metrics["ticks"] <= expected["ticks"]
            if metrics["ticks"] < expected["ticks"] or not cut:
                continue
        assert metrics == expected
    assert refused > 100


def test_a_sound_log_has_only_good_findings(bag: Path) -> None:
    assert bad(bag) == []


def test_gaps_are_named_by_their_ticks(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    kind = TOPICS["/measurement"].type
    some = [
        m
        for m in messages
        if not (m[0] == "/measurement" and decode(kind, m[1]).tick in (17, 18, 90))
    ]
    (finding,) = [f for f in check_log(write_bag(tmp_path / "run", some)) if not f.ok]
    assert finding.what == "/measurement"
    assert finding.detail == "3 ticks missing in 2 gaps, first between tick 16 and 19"


def about_tick(messages: list[Message], topic: str, tick: int, **other: Any) -> Message:
    """Return the message of a tick with another content."""
    kind = TOPICS[topic].type
    return next(
        (t, encode(kind, as_dict(decode(kind, data)) | other), at)
        for t, data, at in messages
        if t == topic and decode(kind, data).tick == tick
    )


def as_dict(message: Any) -> dict[str, Any]:
    return {
        name: as_dict(value) if hasattr(value, "__dict__") else value
        for name, value in vars(message).items()
    }


ASKED = ("/measurement", "/effort_command", "/controller_state")


def test_a_repeated_question_and_the_same_answer_are_said_and_not_wrong(
    tmp_path: Path, write_bag: Write, messages: list[Message], bag: Path
) -> None:
    some = [m for m in messages for _ in range(4 if m[0] in ASKED and m[2] % 10**9 == 0 else 1)]
    folder = write_bag(tmp_path / "run", some)
    assert bad(folder) == []
    found = {f.what: f.detail for f in check_log(folder)}
    words = "501 ticks without a gap; 18 repetitions, the same to the bit"
    assert [found[topic] for topic in ASKED] == [words] * 3
    again, once = flat(metrics_of(folder)), flat(metrics_of(bag))
    assert list(again) == list(once)
    for key, value in once.items():  # sums are taken in other blocks
        assert again[key] == (pytest.approx(value, rel=1e-12) if type(value) is float else value)


@pytest.mark.parametrize("topic", ["/measurement", "/effort_command", "/controller_state"])
def test_a_second_word_about_a_tick_is_found(
    tmp_path: Path, write_bag: Write, messages: list[Message], topic: str
) -> None:
    name = "applied_effort" if topic == "/measurement" else "effort"
    other = about_tick(messages, topic, 77, **{name: [1.0, 2.0]})
    place = next(k for k, m in enumerate(messages) if m[2] > other[2])
    some = [*messages[:place], other, *messages[place:]]
    (finding,) = [f for f in check_log(write_bag(tmp_path / "run", some)) if not f.ok]
    assert finding.what == topic
    assert finding.detail == "1 tick twice, and not the same"


def test_the_truth_is_told_once(tmp_path: Path, write_bag: Write, messages: list[Message]) -> None:
    some = [m for m in messages for _ in range(2 if m[0] == "/truth" and m[2] == 0 else 1)]
    assert bad(write_bag(tmp_path / "run", some)) == ["/truth"]


def test_two_are_asked_at_a_tick_only_after_a_refused_switch(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    other = about_tick(messages, "/measurement", 300, controller="pd_feedforward")
    place = next(k for k, m in enumerate(messages) if m[2] > other[2])
    some = [*messages[:place], other, *messages[place:]]
    assert bad(write_bag(tmp_path / "unsaid", some)) == ["/measurement"]
    said = {
        "stamp": other[2], "tick": 300, "epoch": 0, "level": 1, "source": "plant",
        "kind": "switch_refused", "message": "too large a step", "data": "{}",
    }  # fmt: skip
    event = "/events", encode(TOPICS["/events"].type, said), other[2]
    assert bad(write_bag(tmp_path / "said", [*some[:place], event, *some[place:]])) == []


def test_late_answers_of_one_among_those_of_its_successor_are_not_wrong(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    late = [about_tick(messages, "/effort_command", tick) for tick in range(290, 300)]
    rest = [m for m in messages if m not in late]
    place = next(k for k, m in enumerate(rest) if m[2] > 3_100_000_000)
    folder = write_bag(tmp_path / "run", [*rest[:place], *late, *rest[place:]])
    assert bad(folder) == []


def test_a_clock_that_steps_back_is_found(
    tmp_path: Path, write_bag: Write, messages: list[Message]
) -> None:
    clocks = [m for m in messages if m[0] == "/clock"]
    assert "/clock" in bad(write_bag(tmp_path / "run", [*messages, clocks[5]]))


def test_a_damaged_index_and_a_missing_description_are_found(
    tmp_path: Path, write_bag: Write
) -> None:
    folder = write_bag(tmp_path / "run")
    file = mcap_file(folder)
    data = bytearray(file.read_bytes())
    data[-60] ^= 1
    file.write_bytes(data)
    (folder / "metadata.yaml").unlink()
    assert bad(folder) == ["index", "metadata.yaml"]


def test_info_is_ready_for_json(bag: Path, messages: list[Message]) -> None:
    info = json.loads(json.dumps(log_info(bag)))
    assert info["messages"] == len(messages)
    assert info["testbed"]["joints"] == ["base_yaw", "hub_pitch"]
    assert info["recorded"]["trial_file"] == "synthetic.yaml"
    assert info["ended"] == {"wall_time": "1.25"}


def test_parquet_holds_every_number_with_its_unit(bag: Path, tmp_path: Path) -> None:
    exported = export_log(bag, tmp_path)
    table = pyarrow.parquet.read_table(exported.files["/truth"])
    expected = BagReader(bag).columns("/truth")
    assert table.num_rows == exported.rows["/truth"] == 501
    names = ["base_yaw", "hub_pitch", "mode_1", "mode_2"]
    for k, name in enumerate(names):
        assert np.array_equal(table[f"position.{name}"].to_numpy(), expected["position"][:, k])
    assert np.allclose(table["time"].to_numpy(), np.arange(501) * 0.01, rtol=0.0, atol=1e-12)
    units = {f.name: f.metadata[b"unit"].decode() for f in table.schema}
    assert [units[f"position.{name}"] for name in names] == ["rad", "rad", "m", "m"]
    assert [units[f"velocity.{name}"] for name in names] == ["rad/s", "rad/s", "m/s", "m/s"]
    assert (units["energy"], units["applied_effort.base_yaw"], units["time"]) == ("J", "N m", "s")
    assert table.schema.metadata[b"type"] == b"flexslew_msgs/msg/PlantState"
    plans = pyarrow.parquet.read_table(exported.files["/plan"])
    assert len(plans["position"][0].as_py()) == 2 * 201


def test_a_state_that_joints_are_read_from_has_no_names_of_joints(tmp_path: Path) -> None:
    keys = {"duration": 0.1, "testbed": {"kind": "spacecraft"}}
    run_trial(trial(keys), "test", tmp_path / "run", in_process=True, report=False)
    exported = export_log(tmp_path / "run/bag", tmp_path / "out")
    truth = pyarrow.parquet.read_table(exported.files["/truth"]).schema
    assert {"position.place_x", "velocity.body_x", "applied_effort.roll"} <= {*truth.names}
    assert "position.roll" not in truth.names
    assert truth.field("position.quaternion_x").metadata[b"unit"] == b""
    read = pyarrow.parquet.read_table(exported.files["/measurement"]).schema
    assert "joint_position.roll" in read.names


def test_csv_holds_the_same(bag: Path, tmp_path: Path) -> None:
    exported = export_log(bag, tmp_path, "csv", ["/truth", "/events", "/plan"])
    table = pyarrow.csv.read_csv(exported.files["/truth"])
    expected = BagReader(bag).columns("/truth")
    assert np.array_equal(table["position.mode_1"].to_numpy(), expected["position"][:, 2])
    columns = json.loads((tmp_path / "columns.json").read_text())
    assert columns["truth.csv"]["tip_deflection.negative"]["unit"] == "m"
    kinds = pyarrow.csv.read_csv(exported.files["/events"])["kind"].to_pylist()
    assert kinds == ["started", "switched", "missed", "interrupted"]


def test_long_rows_are_written_in_more_groups_and_are_the_same(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = export_log(bag, tmp_path / "whole").files["/controller_state"]
    monkeypatch.setattr(log_export, "BYTES", 20_000)
    parts = export_log(bag, tmp_path / "parts").files["/controller_state"]
    assert pyarrow.parquet.ParquetFile(whole).num_row_groups == 1
    assert pyarrow.parquet.ParquetFile(parts).num_row_groups > 3
    assert pyarrow.parquet.read_table(parts).equals(pyarrow.parquet.read_table(whole))


def test_an_export_of_an_unknown_topic_names_those_there(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no topic /nothing; it has /clock, "):
        export_log(bag, tmp_path, topics=["/nothing"])


def test_units_are_read_from_the_comments() -> None:
    assert units_of("flexslew_msgs/msg/PlantState", "energy") == ("J",)


@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_an_export_replaces_a_link_and_does_not_write_through_it(
    bag: Path, tmp_path: Path, kind: Literal["parquet", "csv"]
) -> None:
    outside, out = tmp_path / "outside", tmp_path / "out"
    outside.write_text("mine")
    out.mkdir()
    for name in (f"truth.{kind}", "columns.json"):
        (out / name).symlink_to(outside)
    export_log(bag, out, kind, topics=["/truth"])
    assert outside.read_text() == "mine"
    assert (out / f"truth.{kind}").stat().st_size > 1000
