"""The JSON schema of a trial takes what the bench takes, and refuses what it refuses."""

import random
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.trial.schema import trial_schema
from flexslew_lab.trial.sources import example_trials
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.yaml_data import load_yaml, yaml_text

schema = cache(trial_schema)  # made once, by the first test
TYPES: dict[str, Any] = {
    "object": dict, "array": list, "string": str, "boolean": bool, "null": type(None),
    "number": (int, float), "integer": int,
}  # fmt: skip


def holds(value: Any, schema: Any) -> bool:
    """Return whether a value is as a schema says: what JSON Schema 2020-12 means by our words."""
    if isinstance(schema, bool):
        return schema
    checks = [check(value, schema) for check in (refers, is_of, numbers, texts, entries, keys)]
    return all(checks) and logic(value, schema)


def refers(value: Any, s: Any) -> bool:
    return "$ref" not in s or holds(value, schema()["$defs"][s["$ref"].rpartition("/")[2]])


def is_of(value: Any, s: Any) -> bool:
    kind = s.get("type")
    if kind and (not isinstance(value, TYPES[kind]) or (kind != "boolean" and value is True)):
        return False
    return ("const" not in s or value == s["const"]) and ("enum" not in s or value in s["enum"])


def numbers(value: Any, s: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return True
    low, high = s.get("minimum", -1e999), s.get("maximum", 1e999)
    above, below = s.get("exclusiveMinimum", -1e999), s.get("exclusiveMaximum", 1e999)
    return bool(low <= value <= high and (above < value or above == -1e999) and value < below)


def texts(value: Any, s: Any) -> bool:
    return not isinstance(value, str) or re.search(s.get("pattern", ""), value) is not None


def entries(value: Any, s: Any) -> bool:
    if not isinstance(value, list):
        return True
    first = s.get("prefixItems", [])
    fits = s.get("minItems", 0) <= len(value) <= s.get("maxItems", len(value))
    rest = all(holds(one, s.get("items", True)) for one in value[len(first) :])
    return fits and rest and all(map(holds, value, first))


def keys(value: Any, s: Any) -> bool:
    if not isinstance(value, dict):
        return True
    known, other = s.get("properties", {}), s.get("additionalProperties", True)
    return all(k in value for k in s.get("required", ())) and all(
        holds(one, known.get(key, other)) for key, one in value.items()
    )


def logic(value: Any, s: Any) -> bool:
    if "if" in s and not holds(value, s.get("then" if holds(value, s["if"]) else "else", True)):
        return False
    every = all(holds(value, one) for one in s.get("allOf", ()))
    return every and ("anyOf" not in s or any(holds(value, one) for one in s["anyOf"]))


def taken(values: Any) -> bool:
    try:
        parse_trial(yaml_text(values), "here", ANY_CODE)
    except BadInput:
        return False
    return True


VALUES = {t.name: load_yaml(t.path.read_text(), t.name) for t in example_trials()}


@pytest.mark.parametrize("name", VALUES)
def test_every_shipped_trial_fits(name: str) -> None:
    assert holds(VALUES[name], schema())


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_defaults_of_every_law_fit_and_an_unknown_key_does_not(name: str) -> None:
    named: dict[str, Any] = {"controllers": {name: {}, "mine": {"law": name}, "other": None}}
    assert holds(named, schema())
    for entry in (name, "mine"):
        own = {**named["controllers"], entry: {**named["controllers"][entry], "kpp": 1.0}}
        assert not holds({"controllers": own}, schema())


@pytest.mark.parametrize(
    ("values", "fits"),
    [
        ({"duration": "2 min"}, True),
        ({"duration": "2 kg"}, False),
        ({"duration": 0.0}, False),
        ({"testbed": {"kind": "csa", "initial": {"base_yaw": "57 deg"}}}, True),
        ({"sensors": {"joint_position": {"noise": "0.1 mrad"}}}, True),
        ({"sensors": {"joint_position": {"noise": "0.1 miles"}}}, False),
        ({"controllers": {"pd_feedforward": {"kp": "460 N m/rad"}}}, True),
        ({"testbed": {"kind": "csa", "mode": 2}}, False),
        ({"testbed": {"kind": "my_testbed.py:Mine", "anything": 1}}, True),
        ({"testbed": {"kind": "cs"}}, False),
        ({"plan": {"file": "my.plan"}}, True),
        ({"plan": {"method": "my_planner.py:Mine", "x": 1}}, True),
        ({"plan": {"method": "none", "x": 1}}, False),
        ({"controllers": {"pd_feedforward": {"kp": 460.0}}}, True),
        ({"controllers": {"mine": {"law": "my_law.py:Law", "gain": 1.0}}}, True),
    ],
)
def test_what_an_editor_is_told(values: dict[str, Any], fits: bool) -> None:
    assert holds(values, schema()) == fits


def leaves(values: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the places of all values that hold no other."""
    pairs = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in pairs:
        if isinstance(value, dict | list) and value:
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key)


def changed(values: Any, path: tuple[Any, ...], value: Any) -> Any:
    if not path:
        return value
    copy = dict(values) if isinstance(values, dict) else list(values)
    copy[path[0]] = changed(copy[path[0]], path[1:], value)
    return copy


@pytest.mark.parametrize("seed", range(4))
def test_what_the_bench_takes_the_schema_takes(seed: int) -> None:
    """But for controllers, whose keys the bench checks when it builds them."""
    draw = random.Random(seed)
    both = 0
    for _ in range(60):
        values = VALUES[draw.choice(sorted(VALUES))]
        place = draw.choice([p for p in leaves(values) if p[0] != "controllers"])
        value = draw.choice([0, -1.0, 0.5, 3, 1e9, None, "x", [], [1.0], {}, {"x": 1}])
        other = changed(values, place, value)
        if taken(other):
            both += 1
            assert holds(other, schema()), (place, value)
    assert both > 5


def test_every_key_of_the_schema_is_described() -> None:
    bare = [
        f"{name}.{key}"
        for name, one in {"Trial": schema(), **schema()["$defs"]}.items()
        for key, node in one.get("properties", {}).items()
        if not node.get("description") and "const" not in node and key not in ("law", "file")
    ]
    assert not bare
