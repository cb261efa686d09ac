"""Bags of earlier versions, whose messages lack fields that came later, are read all the same."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from tests.plant.test_message_codec import drawn

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.messages import cdr, older
from flexslew_lab.log.messages.schemas import schema_text, store, type_hash
from flexslew_lab.log.recording import bag_writer
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.message_types import fields

PLAN = "flexslew_msgs/msg/Plan"


def without(text: str, field: str) -> str:
    """Return a message definition that lacks a field."""
    shorter = re.sub(rf"^\S+ {field}\b.*\n", "", text, flags=re.M)
    assert shorter != text
    return shorter


OURS = sorted({topic.type for topic in TOPICS.values() if topic.type.startswith("flexslew_msgs/")})
CASES = [(kind, field.name) for kind in OURS for field in fields(kind)]


@pytest.mark.first(20)
@pytest.mark.parametrize(("kind", "missing"), CASES, ids=[f"{k[18:]}.{f}" for k, f in CASES])
def test_a_field_that_came_later_is_empty_and_all_others_keep_their_values(
    kind: str, missing: str
) -> None:
    text = without(schema_text(kind), missing)
    values = drawn(kind, np.random.default_rng(3))
    old = get_typestore(Stores.EMPTY)
    old.register(get_types_from_msg(text, kind))
    now = cdr.decode(kind, cdr.encode(kind, values))
    parts = {name: getattr(now, name) for name, _ in old.fielddefs[kind][1]}
    data = bytes(old.serialize_cdr(old.types[kind](**parts), kind))
    turn = older.upgrade(kind, text)
    assert turn is not None
    assert turn(data) == cdr.encode(kind, {k: v for k, v in values.items() if k != missing})


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("float64[] effort", "float32[] effort"),  # another type
        ("float64[] effort", "float64[] torque"),  # a name that is not known here
    ],
)
def test_what_is_not_an_older_definition_is_none(before: str, after: str) -> None:
    text = schema_text(PLAN)
    assert before in text
    assert older.upgrade(PLAN, text.replace(before, after)) is None


def test_a_run_of_an_earlier_version_is_read_checked_and_flown_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = without(schema_text(PLAN), "gains")
    old = get_typestore(Stores.EMPTY)
    old.register(get_types_from_msg(text, PLAN))

    def as_before(self: Any, topic: str, kind: str, data: bytes, *more: Any) -> Any:
        if kind == PLAN:
            now = cdr.decode(kind, data)
            parts = {name: getattr(now, name) for name, _ in old.fielddefs[kind][1]}
            data = bytes(old.serialize_cdr(old.types[kind](**parts), kind))
        return write(self, topic, kind, data, *more)

    write = bag_writer.BagWriter.write
    trial = parse_trial("{duration: 3.0, plan: {method: none, goal: {base_yaw: 0.1}}}", "test")
    with monkeypatch.context() as earlier:
        earlier.setattr(bag_writer.BagWriter, "write", as_before)
        real, real_hash = schema_text, type_hash
        earlier.setattr(
            bag_writer, "schema_text", lambda kind: text if kind == PLAN else real(kind)
        )
        earlier.setattr(
            bag_writer,
            "type_hash",
            lambda kind: old.hash_rihs01(PLAN) if kind == PLAN else real_hash(kind),
        )
        run_trial(trial, "test", tmp_path / "run", in_process=True, report=False)
    bag = BagReader(tmp_path / "run/bag")
    assert [len(plan.gains) for plan in bag.overview.plans] == [0]
    assert [finding for finding in check_log(bag.path) if not finding.ok] == []
    assert resim(bag.path).identical
    assert type_hash(PLAN) == store().hash_rihs01(PLAN) != old.hash_rihs01(PLAN)
