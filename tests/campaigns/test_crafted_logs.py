"""Logs whose checksums are right and whose content is made up: a line, never a traceback."""

import json
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, seed, settings
from hypothesis import strategies as st

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.info import log_info
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.messages.record_schema import RECORDS, check_record
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.check import check
from flexslew_lab.replay.logged_controllers import logged_laws, plan_changes
from flexslew_lab.replay.player import Player, PlaySettings
from flexslew_lab.replay.resim import resim
from flexslew_lab.report.run_data import read_run
from flexslew_plant.events import EVENTS
from flexslew_plant.message_types import fields
from tests.lab.log.crafted import Message, flown, one_line, plain, written


def campaign(case: np.random.Generator, examples: int) -> Callable[[Any], Any]:
    """Return what draws so many examples for a test, from the seed of its case."""
    strategy = settings(
        database=None, max_examples=examples,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    return lambda test: seed(int(case.integers(2**32)))(strategy(test))


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


@pytest.mark.slow
def test_an_event_is_read_or_refused_in_one_line(case: np.random.Generator) -> None:
    topic = TOPICS["/events"].type

    @campaign(case, 100)
    @given(events)
    def checked(event: tuple[str, str]) -> None:
        kind, text = event
        coded = encode(topic, {"kind": kind, "data": text.replace("\x00", "")})
        accepted = []
        if one_line(lambda: accepted.append(logged_event(decode(topic, coded), "x"))):
            json.dumps(accepted[0].plain(), allow_nan=False)

    checked()


def test_a_record_is_read_or_refused_in_one_line(
    short: list[Message], case: np.random.Generator
) -> None:
    topic = str(case.choice([*RECORDS]))
    kind = TOPICS[topic].type
    base = next(plain(decode(kind, data)) for name, data, _ in short if name == topic)

    @campaign(case, 100)
    @given(changes(topic))
    def checked(changed: dict[str, Any]) -> None:
        message = decode(kind, encode(kind, base | changed))
        one_line(lambda: check_record(topic, message, "x"))

    checked()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> list[Message]:
    return flown(tmp_path_factory.mktemp("crafted") / "run")


ACTIONS: tuple[Callable[[Path], Any], ...] = (
    lambda bag: json.dumps(log_info(bag)),
    check_log,
    lambda bag: json.dumps(metrics_of(bag), allow_nan=False),
    read_run,
    lambda bag: logged_laws(BagReader(bag)),
    lambda bag: plan_changes(BagReader(bag)),
    lambda bag: Player(PlaySettings(bag=str(bag))).step(0.02),
    resim,
    lambda bag: check(bag, "pd_feedforward"),
)


def try_all(bag: Path) -> None:
    for action in ACTIONS:
        one_line(lambda: action(bag))  # noqa: B023  # called at once


def test_no_crafted_log_breaks_any_reader(
    short: list[Message], tmp_path: Path, case: np.random.Generator
) -> None:
    topics = sorted({topic for topic, _, _ in short} - {"/events"})
    crafted = st.sampled_from(topics).flatmap(lambda t: st.tuples(st.just(t), changes(t)))
    crafted |= events.map(lambda e: ("/events", {"kind": e[0], "data": e[1].replace("\x00", "")}))
    bags = (tmp_path / str(k) for k in count())

    @campaign(case, 10)
    @given(crafted)
    @example(("/controller_state", {"reference_position": []}))  # of one answer alone
    def read(change: tuple[str, dict[str, Any]]) -> None:
        where, changed = change
        kind = TOPICS[where].type
        place = [k for k, (topic, _, _) in enumerate(short) if topic == where][-1]
        topic, data, stamp = short[place]
        other = encode(kind, plain(decode(kind, data)) | changed)
        messages = [*short[:place], (topic, other, stamp), *short[place + 1 :]]
        try_all(written(next(bags), messages, {}))

    read()


TEXTS = st.one_of(
    words,
    st.tuples(
        st.sampled_from(["duration", "period", "testbed", "controllers", "plan"]), values
    ).map(lambda pair: json.dumps({"name": "x", pair[0]: pair[1]})),
)


@pytest.mark.slow
def test_no_crafted_metadata_breaks_any_reader(
    short: list[Message], tmp_path: Path, case: np.random.Generator
) -> None:
    bags = (tmp_path / str(k) for k in count())

    @campaign(case, 6)
    @given(st.sampled_from(["trial", "versions", "own_code"]), TEXTS)
    def read(name: str, text: str) -> None:
        text = text.encode(errors="replace").decode()
        try_all(written(next(bags), short, {name: text}))

    read()
