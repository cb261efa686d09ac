"""A comparison of a part says which part, and is not taken for the whole."""

from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput

TRIAL = """
name: part
duration: 2.0
controllers: {pd_feedforward: {}}
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("part") / "run"
    run_trial(parse_trial(TRIAL, "test"), "test", folder, in_process=True, report=False)
    return folder / "bag"


def missing(bag: Path) -> str:
    """Return what both comparisons say, which is the same but for the last tick."""
    again, answers = resim(bag), check(bag, "pd_feedforward")
    assert again.identical
    assert answers.ok
    assert bool(again.missing) == bool(answers.missing)
    return again.missing


def test_a_whole_log_lacks_nothing(bag: Any) -> None:
    assert missing(bag) == ""


def test_a_cut_log_says_up_to_which_tick_and_of_how_many(bag: Any, tmp_path: Path) -> None:
    whole = next(bag.glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    last = BagReader(cut).columns("/truth")["tick"][-1]
    reader = BagReader(cut)
    assert reader.overview.cut is not None
    at = reader.overview.cut.offset
    expected = f"ticks 0 to {last} of 200 compared: the log is cut at byte {at}"
    assert missing(cut) == expected


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        (lambda tick: not 50 <= tick < 60, "200 of 200 compared: 10 ticks in between are missing"),
        (lambda tick: tick < 100, "99 of 200 compared: the log does not hold the end of the run"),
    ],
    ids=["gap", "end"],
)
def test_a_log_that_lacks_ticks_says_so(bag: Any, tmp_path: Path, kept: Any, words: str) -> None:
    reader = BagReader(bag)
    with BagWriter(tmp_path / "bag", reader.metadata) as writer:
        for topic, kind, stamp, _, data in reader.messages():
            if kept(stamp // 10_000_000) or topic in ("/testbed", "/plan", "/controller_status"):
                writer.write(topic, kind, data, stamp)
    assert f"ticks 0 to {words}" in resim(tmp_path / "bag").missing


def test_a_log_of_two_runs_is_not_compared_as_one(bag: Any, tmp_path: Path) -> None:
    reader, writer = BagReader(bag), BagWriter(tmp_path / "two", {"trial": TRIAL})
    for begin in (0, reader.overview.last):  # as a recorder does that outlives its plant
        for message in reader.messages():
            writer.write(message.topic, message.type, message.data, begin + message.stamp)
    writer.close()
    for compare in (resim, lambda path: check(path, "pd_feedforward")):
        with pytest.raises(BadInput, match="tick 0 of epoch 0: it holds more than one run"):
            compare(tmp_path / "two")
