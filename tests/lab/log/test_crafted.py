"""Logs whose checksums are right and whose content is made up: a line, never a traceback."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.info import log_info
from flexslew_lab.log.messages.cdr import decode, encode, fields
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.messages.record_schema import RECORDS, check_record
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.check import check
from flexslew_lab.replay.logged_controllers import adoptions, logged_laws
from flexslew_lab.replay.player import Player, PlaySettings
from flexslew_lab.replay.resim import resim
from flexslew_lab.report.report import write_report
from flexslew_lab.report.run_data import read_run
from flexslew_lab.trial.run import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput, RunFault
from flexslew_plant.events import EVENTS

Message = tuple[str, bytes, int]
pytestmark = pytest.mark.timeout(900)  # 2,000 cases, where many share the processors

TRIAL = """
name: crafted
duration: 0.05
plan: {method: reference_only, goal: {base_yaw: 1.0e-5, hub_pitch: 0.0}, duration: 0.03}
controllers: {pd_feedforward: {}}
"""


def cases(count: int) -> settings:
    """Return the settings of a seeded campaign of so many cases."""
    checks = list(HealthCheck)
    return settings(
        derandomize=True, deadline=None, suppress_health_check=checks, max_examples=count
    )


numbers = st.one_of(
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.sampled_from([0, -1, 2**63, 2**64, 1e308, 1e-320]),
)
words = st.one_of(
    st.text(max_size=8),
    st.sampled_from(["2001-99-99", "[" * 40, "{a: &x 1, b: *x}", "a: [", "!!python/name:os.abort"]),
)
values = st.recursive(
    st.none() | st.booleans() | numbers | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=6,
)
keys: tuple[str, ...] = (
    "wall_time",
    "ticks",
    "rejected",
    "effort_step",
    "text",
    "start",
    "controller",
    "tick",
)
keys += ("max_effort_step", "strict", "from", "to", "hash", "in_a_row")
data = st.one_of(
    st.dictionaries(st.sampled_from(keys), values, max_size=6).map(json.dumps),
    values.map(json.dumps),
    words,
    st.integers(1, 5000).map(lambda n: "[" * n + "]" * n),
)
events = st.tuples(st.sampled_from([*EVENTS, "started", "", "x"]), data)
_LIMITS = {"B": (0, 255), "b": (-128, 127), "I": (0, 2**32 - 1), "i": (-(2**31), 2**31 - 1)}
_LIMITS |= {"Q": (0, 2**64 - 1), "q": (-(2**63), 2**63 - 1), "H": (0, 65535), "?": (0, 1)}


def allowed(code: str) -> st.SearchStrategy[Any]:
    """Return values that a field of this kind can carry at all."""
    if code == "d":
        return st.floats()
    return words.filter(lambda w: "\x00" not in w) if code == "s" else st.integers(*_LIMITS[code])


@st.composite
def changes(draw: Callable[..., Any], topic: str) -> dict[str, Any]:
    """Return new values for some fields of a message."""
    known = [f for f in fields(TOPICS[topic].type) if f.code]
    chosen = draw(st.lists(st.sampled_from(known), min_size=1, max_size=3))
    return {
        f.name: draw(st.lists(allowed(f.code), max_size=7) if f.array else allowed(f.code))
        for f in chosen
    }


def one_line(action: Callable[[], Any]) -> bool:
    """Return whether the action accepts its input; if it refuses, then in one line."""
    try:
        action()
    except (BadInput, RunFault) as error:
        said = str(error)
    else:
        return True
    assert len(said.splitlines()) == 1
    return False


def plain(message: Any) -> dict[str, Any]:
    return {
        name: plain(value) if hasattr(value, "__dict__") else value
        for name, value in vars(message).items()
    }


@cases(1090)
@given(events)
def test_an_event_is_read_or_refused_in_one_line(event: tuple[str, str]) -> None:
    kind, text = event
    message = {"kind": kind, "data": text.replace("\x00", "")}
    coded = encode(TOPICS["/events"].type, message)
    accepted = []
    if one_line(lambda: accepted.append(logged_event(decode(TOPICS["/events"].type, coded), "x"))):
        json.dumps(accepted[0].plain(), allow_nan=False)


@pytest.mark.parametrize("topic", RECORDS)
def test_a_record_is_read_or_refused_in_one_line(short: list[Message], topic: str) -> None:
    kind = TOPICS[topic].type
    base = next(plain(decode(kind, data)) for name, data, _ in short if name == topic)

    @cases(250)
    @given(changes(topic))
    def checked(changed: dict[str, Any]) -> None:
        message = decode(kind, encode(kind, base | changed))
        one_line(lambda: check_record(topic, message, "x"))

    checked()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> list[Message]:
    folder = tmp_path_factory.mktemp("crafted") / "run"
    run_trial(parse_trial(TRIAL, "test"), "test", folder, in_process=True, report=False)
    return [(m.topic, m.data, m.stamp) for m in BagReader(folder / "bag").messages()]


def written(folder: Path, messages: list[Message], metadata: dict[str, str]) -> Path:
    writer = BagWriter(folder, {"trial": TRIAL, "versions": "{}", **metadata})
    for topic, data, stamp in messages:
        writer.write(topic, TOPICS[topic].type, data, stamp)
    writer.close({"wall_time": "1.0"})
    return folder


ACTIONS: tuple[Callable[[Path], Any], ...] = (
    lambda bag: json.dumps(log_info(bag)),
    check_log,
    lambda bag: json.dumps(metrics_of(bag), allow_nan=False),
    read_run,
    lambda bag: logged_laws(BagReader(bag)),
    lambda bag: adoptions(BagReader(bag)),
    lambda bag: Player(PlaySettings(bag=str(bag))).step(0.02),
    resim,
    lambda bag: check(bag, "pd_feedforward"),
)


def try_all(bag: Path) -> None:
    for action in ACTIONS:
        one_line(lambda: action(bag))  # noqa: B023  # called at once


def test_no_crafted_log_breaks_any_reader(
    short: list[Message], tmp_path_factory: pytest.TempPathFactory
) -> None:
    topics = sorted({topic for topic, _, _ in short} - {"/events"})
    crafted = st.sampled_from(topics).flatmap(lambda t: st.tuples(st.just(t), changes(t)))
    crafted |= events.map(lambda e: ("/events", {"kind": e[0], "data": e[1].replace("\x00", "")}))
    root = tmp_path_factory.mktemp("fuzz")
    count = 0

    @cases(100)
    @given(crafted)
    def read(case: tuple[str, dict[str, Any]]) -> None:
        nonlocal count
        count += 1
        wanted, changed = case
        kind = TOPICS[wanted].type
        place = [k for k, (topic, _, _) in enumerate(short) if topic == wanted][-1]
        topic, data, stamp = short[place]
        other = encode(kind, plain(decode(kind, data)) | changed)
        messages = [*short[:place], (topic, other, stamp), *short[place + 1 :]]
        try_all(written(root / str(count), messages, {}))

    read()


TEXTS = st.one_of(
    words,
    st.tuples(
        st.sampled_from(["duration", "period", "testbed", "controllers", "plan"]), values
    ).map(lambda pair: json.dumps({"name": "x", pair[0]: pair[1]})),
)


def test_no_crafted_metadata_breaks_any_reader(
    short: list[Message], tmp_path_factory: pytest.TempPathFactory
) -> None:
    root = tmp_path_factory.mktemp("metadata")
    count = 0
    names = st.sampled_from(["trial", "versions", "own_code"])

    @cases(60)
    @given(names, TEXTS)
    def read(name: str, text: str) -> None:
        nonlocal count
        count += 1
        text = text.encode(errors="replace").decode()
        try_all(written(root / str(count), short, {name: text}))

    read()


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
