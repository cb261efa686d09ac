"""Logs whose checksums are right and whose content is made up: a line, never a traceback."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.lab.log.crafted import Message, flown, one_line, plain, written

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.resim import resim
from flexslew_lab.report.report import write_report
from flexslew_lab.report.run_data import read_run
from flexslew_plant.errors import BadInput


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> list[Message]:
    return flown(tmp_path_factory.mktemp("crafted") / "run")


def last_truth(short: list[Message], **changed: Any) -> list[Message]:
    place = [k for k, (topic, _, _) in enumerate(short) if topic == "/truth"][-1]
    kind = TOPICS["/truth"].type
    topic, data, stamp = short[place]
    other = encode(kind, plain(decode(kind, data)) | changed)
    return [*short[:place], (topic, other, stamp), *short[place + 1 :]]


def test_a_truth_that_is_not_finite_is_refused_with_its_tick(
    short: list[Message], tmp_path: Path
) -> None:
    bag = written(tmp_path / "bag", last_truth(short, position=np.array([np.nan] * 5)), {})
    for action in (metrics_of, read_run, resim, lambda b: write_report([b], tmp_path / "r.html")):
        with pytest.raises(BadInput, match="/truth: position is not finite at tick 5"):
            action(bag)
    assert not (tmp_path / "r.html").exists()


def test_a_folder_in_the_place_of_metadata_is_said(short: list[Message], tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", short, {})
    (bag / "metadata.yaml").unlink()
    (bag / "metadata.yaml").mkdir()
    assert [f.what for f in check_log(bag) if not f.ok] == ["metadata.yaml"]
    with pytest.raises(BadInput, match=r"metadata\.yaml: is a folder"):
        recover(bag)


@pytest.mark.parametrize("name", ["metadata.yaml", ".recovering", ".recording", "metadata.tmp"])
def test_links_in_a_bag_steer_no_write_to_another_place(
    short: list[Message], tmp_path: Path, name: str
) -> None:
    bag = written(tmp_path / "bag", short, {})
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "precious").write_text("precious")
    (bag / name).unlink(missing_ok=True)
    (bag / name).symlink_to(outside if name == ".recovering" else outside / "precious")
    one_line(lambda: recover(bag))
    assert [(p.name, p.read_text()) for p in outside.iterdir()] == [("precious", "precious")]


@pytest.mark.parametrize(
    ("kind", "text", "words"),
    [
        ("finished", '{"wall_time": "long"}', "wall_time: 'long' is not allowed"),
        ("finished", '{"ticks": {}}', "ticks: {} is not allowed"),
        ("switched", '{"effort_step": ["x"]}', "effort_step"),
        ("missed", '{"ticks": []}', "ticks"),
        ("injected", '{"start": 1}', "text"),
        ("injected", '{"start": 1, "text": "{a: &x 1, b: *x}"}', "anchor"),
        ("switch_requested", '{"controller": 1}', "controller: 1 is not allowed"),
        ("anything", "[" * 100_000, "is not JSON"),
        ("anything", '{"a": 1e999}', "inf is not a number"),
        ("anything", "7", "is a int, not an object"),
    ],
)
def test_a_wrong_event_is_named_with_its_kind_key_and_value(
    kind: str, text: str, words: str
) -> None:
    message = decode(TOPICS["/events"].type, encode(TOPICS["/events"].type, {
        "kind": kind, "tick": 7, "data": text,
    }))  # fmt: skip
    with pytest.raises(BadInput, match=f"x: event '{kind}' at tick 7: data.*{words}"):
        logged_event(message, "x")
