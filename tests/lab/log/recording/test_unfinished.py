"""A recorder that is started again goes on in the bag that it left when it was killed."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_writer import BagWriter, RecordingStopped
from flexslew_lab.log.recording.recording import Recording
from flexslew_lab.log.recording.recording_order import Ordered
from flexslew_lab.log.recording.unfinished import open_bag
from flexslew_plant.errors import BadInput

RUN = {"trial": "name: one"}
MEASUREMENT, NOTE = "/measurement", "/events"


def message(topic: str, tick: int, epoch: int = 0, **more: Any) -> Ordered:
    fields: Mapping[str, Any] = {"tick": tick, "epoch": epoch, **more}
    return Ordered(epoch, tick * 10**7, 0, topic, encode(TOPICS[topic].type, fields))


def note(tick: int, text: str) -> Ordered:
    return message(NOTE, tick, kind="remark", message=text, data="{}", source="x")


def recording(folder: Path, metadata: Mapping[str, str] = RUN) -> Recording:
    def failed(words: str) -> None:
        raise RecordingStopped(words)

    return Recording(open_bag(folder, metadata), failed)


def killed(folder: Path, ticks: range) -> None:
    """Leave a bag as a kill does: without its end, its lock dropped."""
    writer = BagWriter(folder, RUN)
    for each in (note(0, "begun"), *(message(MEASUREMENT, tick) for tick in ticks)):
        writer.write(each.topic, TOPICS[each.topic].type, each.data, each.at)
    writer.flush()
    os.close(writer._lock)
    writer._file.close()
    with writer.path.open("ab") as file:
        file.write(b"\x06\x00")  # of a chunk


def ticks(folder: Path) -> list[int]:
    return [m.tick for _, _, m in BagReader(folder).decode_messages([MEASUREMENT])]


def test_nothing_of_what_was_left_is_lost_and_nothing_stands_there_twice(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    killed(folder, range(50))
    again = recording(folder)
    for each in (note(0, "begun"), note(55, "missed"), message(MEASUREMENT, 60), note(61, "on")):
        again.write(each)
    again.close()
    assert ticks(folder) == [*range(50), 60]
    events = BagReader(folder).overview.events
    assert [event.message for event in events] == ["begun", "missed", "on"]
    assert BagReader(folder).overview.cut is None
    assert sorted(p.name for p in folder.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


def test_one_that_is_killed_while_it_takes_over_is_followed_by_another(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    killed(folder, range(50))
    (folder / "bag_0.mcap").rename(folder / "bag_0.mcap.left")
    (folder / "bag_0.mcap").write_bytes(b"half a copy")
    again = recording(folder)
    again.write(message(MEASUREMENT, 50))
    again.close()
    assert ticks(folder) == [*range(51)]


def test_another_run_is_not_mixed_in(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    killed(folder, range(50))
    again = recording(folder)
    again.write(note(0, "another"))
    with pytest.raises(RecordingStopped, match="was another one; choose another folder"):
        again.write(message(MEASUREMENT, 0))


@pytest.mark.parametrize("how", ["finished", "of another trial", "no bag"])
def test_any_other_bag_stays_as_it_is(how: str, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    killed(folder, range(50))
    if how == "finished":
        recording(folder).close()
    elif how == "no bag":
        (folder / "bag_0.mcap").write_bytes(b"something else")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(BadInput, match="holds a bag already"):
        open_bag(folder, {"trial": "name: two"} if how == "of another trial" else RUN)
    assert {path.name: path.read_bytes() for path in folder.glob("bag*")} == {
        name: data for name, data in before.items() if name.startswith("bag")
    }
