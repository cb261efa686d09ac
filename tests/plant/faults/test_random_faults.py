"""Random schedules of faults do what their page says, tick by tick: an own reading of the page."""

from typing import Any
from zlib import crc32

import numpy as np
import pytest

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.settings import validated

TICKS, LIMIT, GOAL = 100, 150.0, np.array([0.05, -0.03])
JOINTS, BEAMS = ("base_yaw", "hub_pitch"), ("beam_positive", "beam_negative")
CHANNELS = {
    "joint_position": JOINTS, "joint_velocity": JOINTS,
    "tip_deflection": BEAMS, "root_curvature": BEAMS,
}  # fmt: skip
KINDS = (
    "command_delay", "actuator_gain", "actuator_stuck", "command_lost", "command_late",
    "command_duplicated", "command_reordered", "sensor_bias", "sensor_dropout", "sensor_freeze",
)  # fmt: skip
LOSING = ("command_lost", "command_late", "command_reordered")


def a_fault(rng: np.random.Generator) -> dict[str, Any]:
    kind = str(rng.choice(KINDS))
    joint: dict[str, Any] = {"joint": str(rng.choice(JOINTS))}
    fault: dict[str, Any] = {"kind": kind}
    if kind == "command_delay":
        some = joint if rng.random() < 0.5 else {}
        return fault | {"ticks": float(rng.choice([0.5, 1.0, 2.0, 3.3, 7.0]))} | some
    if kind == "actuator_gain":
        return fault | joint | {"gain": float(rng.choice([-1.0, 0.0, 0.5, 3.0, 100.0]))}
    if kind == "actuator_stuck":
        some = {"effort": rng.uniform(-LIMIT, LIMIT)} if rng.random() < 0.5 else {}
        return fault | joint | some
    if kind.startswith("sensor"):
        fault["channel"] = str(rng.choice(list(CHANNELS)))
        if rng.random() < 0.5:
            fault["of"] = str(rng.choice(CHANNELS[fault["channel"]]))
    if kind == "sensor_bias":
        return fault | {"bias": float(rng.normal())}
    if kind == "sensor_freeze":
        return fault
    more = {"ticks": int(rng.integers(1, 5))} if kind == "command_late" else {}
    chance = float(rng.choice([0.0, 0.1, 0.3, 1.0]))
    return fault | {"probability": chance, "seed": int(rng.integers(3))} | more


def a_schedule(rng: np.random.Generator, period: float) -> list[dict[str, Any]]:
    """Return faults from tick 0 on and until the last one, some shorter than a tick."""
    entries = []
    for _ in range(rng.integers(1, 8)):
        first = int(rng.choice(np.array([0, int(rng.integers(0, TICKS)), TICKS - 1])))
        at = period * (first + rng.uniform(0.0, 0.4))
        entry = {"at": at, "fault": a_fault(rng)}
        if rng.random() < 0.7:
            lasts = rng.choice(np.array([0.2, 1.0, float(rng.integers(1, 60)), 1e6]))
            entry["until"] = at + period * float(lasts)
        entries.append(entry)
    return entries


class Page:
    """The effects of the faults of a schedule in one epoch, as in docs/faults/kinds.md."""

    def __init__(self, entries: list[dict[str, Any]], period: float, seed: tuple[int, int]) -> None:
        self.period, self.seed = period, seed
        self.faults: list[dict[str, Any]] = []
        for entry in entries:
            start = round(entry["at"] / period)
            end = 1e9
            if "until" in entry:
                end = max(round(entry["until"] / period), start + 1)
            self.faults.append(entry["fault"] | {"start": start, "end": end, "kept": []})
        self.faults.sort(key=lambda fault: fault["start"])
        self.held = self.last = self.given = np.zeros(2)

    def acting(self, tick: int, *kinds: str) -> list[dict[str, Any]]:
        now = [f for f in self.faults if f["start"] <= tick < f["end"]]
        return [f for f in now if f["kind"].startswith(kinds)]

    def is_active(self, fault: dict[str, Any], tick: int) -> bool:
        key = *self.seed, fault["start"], crc32(fault["kind"].encode()), fault["seed"], tick
        return bool(np.random.default_rng(key).random() < fault["probability"])

    def outputs(self, tick: int, truth: dict[str, Vector]) -> dict[str, Vector]:
        read = {name: value.copy() for name, value in truth.items()}
        for fault in self.acting(tick, "sensor"):
            value, names = read[fault["channel"]], CHANNELS[fault["channel"]]
            some = [fault.get("of") in (None, name) for name in names]
            if tick == fault["start"]:
                fault["kept"] = value.copy()
            if fault["kind"] == "sensor_bias":
                value[some] += fault["bias"]
            elif fault["kind"] == "sensor_freeze":
                value[some] = fault["kept"][some]
            elif self.is_active(fault, tick):
                value[some] = 0.0
        return read

    def effort(self, tick: int, answer: Vector) -> Vector:
        if not any(self.is_active(fault, tick) for fault in self.acting(tick, *LOSING)):
            self.held = answer
        arrives = self.held.copy()
        for fault in reversed(self.acting(tick, "command_delay")):
            if tick == fault["start"]:  # before it nothing was late: it begins with what was held
                fault["kept"] = [self.last] * (int(np.ceil(fault["ticks"])) + 1)
            fault["kept"].append(arrives.copy())
            whole, part = divmod(fault["ticks"], 1.0)
            sooner, later = (fault["kept"][-1 - int(whole) - n] for n in (0, 1))
            late = (1.0 - part) * sooner + part * later if part else sooner
            some = [fault.get("joint") in (None, name) for name in JOINTS]
            arrives[some] = late[some]
        self.last = self.held
        for fault in self.acting(tick, "actuator_gain"):
            arrives[JOINTS.index(fault["joint"])] *= fault["gain"]
        given = np.clip(arrives, -LIMIT, LIMIT)
        for fault in self.acting(tick, "actuator_stuck"):
            k = JOINTS.index(fault["joint"])
            if tick == fault["start"]:
                fault["kept"] = fault.get("effort", self.given[k])
            given[k] = fault["kept"]
        self.given = given
        return given


@pytest.mark.first(15)
@pytest.mark.parametrize("seed", range(40))
def test_a_random_schedule_of_faults_does_what_the_page_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    period = float(rng.choice([0.01, 0.03, 0.007, 0.1 / 3.0]))
    entries, own = a_schedule(rng, period), int(rng.integers(50))
    keys = {
        "testbed": {"modes": 1}, "period": period, "duration": TICKS * period, "seed": own,
        "active": "it", "max_missed": 1000, "allow_faults": True, "schedule": entries,
    }  # fmt: skip
    bench = Bench(validated(BenchSettings, keys, "test"))
    for epoch in range(2):
        page = Page(entries, period, (own, epoch))
        for tick in range(TICKS):
            truth, asked = bench.truth(), bench.question
            expected = page.outputs(
                tick,
                {
                    "joint_position": truth.position[:2],
                    "joint_velocity": truth.velocity[:2],
                    "tip_deflection": truth.tip_deflection,
                    "root_curvature": bench.appendages.curvature @ truth.position[2:],
                },
            )
            for name, value in expected.items():
                np.testing.assert_array_equal(getattr(asked, name), value)
            answer = 300.0 * (GOAL - asked.joint_position) - 600.0 * asked.joint_velocity
            bench.offer(EffortCommand(tick, epoch, "it", answer))
            bench.advance()
            given = page.effort(tick, answer)
            np.testing.assert_allclose(bench.truth().applied_effort, given, 1e-12, 1e-12)
        told = sorted((e.tick, e.data["on"]) for e in bench.events if e.kind == "fault")
        begun = [(fault["start"], True) for fault in page.faults]
        ended = [(fault["end"], False) for fault in page.faults if fault["end"] <= TICKS]
        assert told == sorted(begun + ended)
        bench.events.clear()
        bench.reset()
