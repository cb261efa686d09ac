"""Bags with a motion that is known in closed form, and the command line as a function."""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from flexslew_lab.cli.main import main
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_writer import BagWriter

PERIOD = 0.01
GOAL = np.array([1.0, -0.5])
END = 2.0  # of the manoeuvre [s]
LIMIT = 40.0
TRIAL = {"name": "synthetic", "seed": 1, "testbed": {"kind": "csa", "modes": 2}}

Message = tuple[str, bytes, int]
Call = Callable[..., tuple[int, str, str]]


def state(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity: a cubic to the goal, and modes that ring on afterwards."""
    s = min(t / END, 1.0)
    shape, rate = 3 * s**2 - 2 * s**3, (6 * s - 6 * s**2) / END
    q = np.concatenate((GOAL * shape, [0.3 * np.sin(2.0 * t), 0.0]))
    return q, np.concatenate((GOAL * rate, [0.6 * np.cos(2.0 * t), 0.0]))


def effort(t: float) -> np.ndarray:
    return np.array([LIMIT if t <= 0.5 else 10.0, -20.0])


def plan() -> dict[str, Any]:
    ticks = round(END / PERIOD)
    t = np.arange(ticks + 1) * PERIOD
    rows = [state(x) for x in t]
    position = np.array([q[:2] for q, _ in rows])
    return {
        "stamp": 0, "method": "optimized_feedforward", "hash": "ab" * 32,
        "joint_names": ["base_yaw", "hub_pitch"], "start": 0.0, "duration": END,
        "period": PERIOD, "position": position.ravel(),
        "velocity": np.array([v[:2] for _, v in rows]).ravel(),
        "effort": np.tile([10.0, -20.0], (ticks, 1)).ravel(), "state": [],
        "request": yaml.safe_dump({"method": "optimized_feedforward", "duration": END}),
        "summary": yaml.safe_dump({"objective": 1.1e-3, "iterations": 3}),
        "versions": yaml.safe_dump({"flexslew": "0.1.0"}),
    }  # fmt: skip


def event(tick: int, kind: str, level: int, text: str, **data: Any) -> dict[str, Any]:
    return {
        "stamp": round(tick * PERIOD * 1e9), "tick": tick, "epoch": 0, "level": level,
        "source": "plant", "kind": kind, "message": text, "data": json.dumps(data),
    }  # fmt: skip


def synthetic_messages(ticks: int = 500, switch_at: int = 300) -> Iterator[Message]:
    """Yield (topic, bytes, stamp) of a run with one switch and one missed tick."""

    def put(topic: str, message: dict[str, Any], stamp: int) -> Message:
        return topic, encode(TOPICS[topic].type, message), stamp

    yield put("/testbed", {
        "stamp": 0, "kind": "csa", "joint_names": ["base_yaw", "hub_pitch"],
        "joint_units": ["rad", "rad"], "appendage_names": ["positive", "negative"], "modes": 2,
        "period": PERIOD, "effort_limit": [LIMIT, LIMIT], "settings": "kind: csa",
    }, 0)  # fmt: skip
    yield put("/plan", plan(), 0)
    yield put("/events", event(0, "started", 0, "run started"), 0)
    for k in range(ticks + 1):
        t = k * PERIOD
        stamp = round(t * 1e9)
        q, v = state(t)
        held = effort(t) if k else np.zeros(2)
        tip = np.array([q[2], -q[2]])
        name = "pd_feedforward" if k < switch_at else "pi"
        head = {"stamp": stamp}
        yield put("/clock", {"clock": stamp}, stamp)
        yield put("/truth", {
            "header": head, "tick": k, "position": q, "velocity": v, "applied_effort": held,
            "disturbance": [0.0, 0.0], "tip_deflection": tip, "energy": 1.0,
        }, stamp)  # fmt: skip
        yield put("/measurement", {
            "header": head, "tick": k, "controller": name, "joint_position": q[:2],
            "joint_velocity": v[:2], "tip_deflection": tip, "root_curvature": tip / 100,
            "applied_effort": held,
        }, stamp)  # fmt: skip
        answer = effort(t + PERIOD)
        yield put("/effort_command", {
            "stamp": stamp, "tick": k, "controller": name, "effort": answer,
        }, stamp)  # fmt: skip
        reference, rate = state(t)
        yield put("/controller_state", {
            "header": head, "tick": k, "controller": name, "reference_position": reference[:2],
            "reference_velocity": rate[:2], "feedforward": [10.0, -20.0],
            "estimate_position": q + 0.001, "estimate_velocity": v, "effort": answer,
            "term_names": ["feedforward", "proportional"],
            "terms": [10.0, -20.0, answer[0] - 10.0, 0.0],
        }, stamp)  # fmt: skip
        if k == switch_at:
            words = "pd_feedforward -> pi"
            step = [0.25, -0.5]
            yield put("/events", event(k, "switched", 0, words, effort_step=step), stamp)
        if k == switch_at + 10:
            yield put("/events", event(k, "missed", 1, "no valid answer from pi"), stamp)
    yield put("/events", event(ticks, "interrupted", 1, "stopped"), round(ticks * PERIOD * 1e9))


@pytest.fixture(scope="session")
def messages() -> list[Message]:
    return list(synthetic_messages())


@pytest.fixture(scope="session")
def write_bag(messages: list[Message]) -> Callable[..., Path]:
    """Return a function that writes the messages to a folder and closes the bag."""

    def write(folder: Path, some: list[Message] | None = None, close: bool = True) -> Path:
        writer = BagWriter(folder, {"trial": yaml.safe_dump(TRIAL), "trial_file": "synthetic.yaml"})
        for topic, data, stamp in messages if some is None else some:
            writer.write(topic, TOPICS[topic].type, data, stamp)
        if close:
            writer.close({"wall_time": "1.25"})
        return folder

    return write


@pytest.fixture(scope="session")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "run")


@pytest.fixture
def call(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return the command line as a function of words: exit code, output and messages."""

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["flexslew", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code is None or isinstance(end.value.code, int)
        return end.value.code or 0, *capfd.readouterr()

    monkeypatch.setenv("COLUMNS", "300")
    return run
