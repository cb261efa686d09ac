"""Texts of people: a trial, a fault, a target, a request of a page. One line, never a traceback."""

from collections.abc import Iterator
from http.client import HTTPConnection, HTTPException
from typing import Any

import numpy as np
import pytest

from flexslew_lab.console.server import ConsoleServer
from flexslew_lab.trial.sources import example_trials
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import load_yaml, yaml_text

ODD: list[Any] = [
    None, True, 0, -1, 2**63, 10**30, 1e308, -1e-320, float("nan"), float("inf"), "", "x" * 3000,
    "\x00", "\x1b]0;t\x07", "\u202e", "2001-99-99", "!!python/name:os.abort", [], {}, [[]], [1] * 9,
    {"a": {"b": []}}, "base_yaw", "{", "&a [*a]", "1e400", "lqr",
]  # fmt: skip
FAULTS = [
    {"kind": "actuator_stuck", "joint": "hub_pitch", "effort": 2.0},
    {"kind": "command_delay", "ticks": 2.5},
    {"kind": "sensor_bias", "channel": "joint_position", "of": "base_yaw", "bias": 0.1},
    {"disturbance": {"base_yaw": {"sine": {"amplitude": 1.0, "frequency": 2.0}}}, "until": 3.0},
]


def odd(case: np.random.Generator) -> Any:
    return ODD[case.integers(len(ODD))]


def changed(value: Any, case: np.random.Generator) -> Any:
    """Return plain data with one place of it changed, left out or added to."""
    if isinstance(value, dict) and value and case.random() < 0.9:
        key = list(value)[case.integers(len(value))]
        rest = {k: v for k, v in value.items() if k != key}
        match case.integers(5):
            case 0:
                return rest
            case 1:
                return {**value, str(odd(case)): odd(case)}
            case _:
                return {**value, key: changed(value[key], case)}
    if isinstance(value, list) and value and case.random() < 0.7:
        k = case.integers(len(value))
        return [*value[:k], changed(value[k], case), *value[k + 1 :]]
    return odd(case)


def test_a_trial_is_read_or_refused_in_one_line(case: np.random.Generator) -> None:
    shipped = example_trials()
    values = load_yaml(shipped[case.integers(len(shipped))].path.read_text(), "test")
    for _ in range(case.integers(1, 4)):
        values = changed(values, case)
    text = yaml_text(values)
    if case.random() < 0.3:  # no YAML any more
        at = int(case.integers(len(text)))
        text = text[:at] + str(odd(case)) + text[at + 1 :]
    try:
        parse_trial(text, "test")
    except BadInput as error:
        assert str(error).isprintable()  # noqa: PT017


@pytest.mark.parametrize("name", [{"a": {"b": []}}, {}, [], [[1]], 3, True])
@pytest.mark.parametrize(
    "section",
    [
        lambda name: {"plan": {"method": name}},
        lambda name: {"plan": {"method": "none", "model": {"kind": name}}},
        lambda name: {"testbed": {"kind": name}},
        lambda name: {"active": name},
        lambda name: {"fallback": [name]},
        lambda name: {"metrics": [name]},
        lambda name: {"schedule": [{"kind": name, "at": 1.0}]},
        lambda name: {"controllers": {"lqr": {"law": name}}},
    ],
)
def test_a_name_that_is_no_text_is_refused_in_one_line(section: Any, name: Any) -> None:
    with pytest.raises(BadInput) as refusal:
        parse_trial(yaml_text({"controllers": {"lqr": {}}, **section(name)}), "test")
    assert str(refusal.value).isprintable()


def test_a_request_of_an_operator_is_done_or_refused_in_one_line(case: np.random.Generator) -> None:
    bench = Bench(BenchSettings(allow_faults=True))
    for _ in range(5):
        fault = FAULTS[case.integers(len(FAULTS))]
        text = yaml_text(changed(fault, case), flow=True)
        if case.random() < 0.3:
            text = str(odd(case))
        tick = int(case.integers(0, 8))
        ask = bench.inject if case.random() < 0.8 else bench.retarget
        for done in (ask(text, tick, str(odd(case))), bench.end_fault(int(case.integers(9)))):
            assert done.ok or done.message.isprintable()
        bench.advance()
    assert np.isfinite(bench.truth().position).all()
    assert (np.abs(bench.actuator.effort) <= bench.limit).all()


@pytest.fixture(scope="module")
def server() -> Iterator[ConsoleServer]:
    found = ConsoleServer("127.0.0.1", 0, lambda words: None)
    yield found
    found.close()


def test_a_page_is_let_in_with_its_token_alone(
    server: ConsoleServer, case: np.random.Generator
) -> None:
    """Requests with parts of the right token, of other hosts and origins, cut and too long."""
    token = server.gate.token
    words = ["/", "run", "report.html", "?token=", token[:-1], "&", "%00", "%2e%2e", "//[", "#",
             "x" * 4000, "index.html", "=", "token", token.swapcase()]  # fmt: skip
    path = "/" + "".join(words[k] for k in case.integers(len(words), size=case.integers(1, 6)))
    names = ("Host", "Origin", "Cookie", "Upgrade", "Connection", "Sec-WebSocket-Version")
    values = ["evil.example", "http://[", f"flexslew_{server.port}={token[1:]}", "websocket", "13",
              "upgrade", "null", f"http://127.0.0.1:{server.port}", '"', "="]  # fmt: skip
    headers = {
        names[k]: values[case.integers(len(values))]
        for k in case.integers(len(names), size=case.integers(0, 4))
    }
    connection = HTTPConnection("127.0.0.1", server.port, timeout=20)
    try:
        connection.request("GET", path, headers=headers)
        status = connection.getresponse().status
    except (HTTPException, OSError):  # cut: what is no request is not answered
        return
    assert 400 <= status < 500
