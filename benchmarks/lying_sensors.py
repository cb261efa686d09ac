"""A campaign: every kind of lying sensor against every law, and what the bench makes of it.

Run it to print the table that docs/verification.md summarises, and the number of false alarms
without a fault.
"""

import argparse
import sys
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Answer
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import (
    Trial,
    bench_settings,
    build_controllers,
    parse_trial,
    plan_of_trial,
)
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.events import Event
from flexslew_plant.measurement import Measurement

START = 10.0  # of the fault, in the middle of the slew [s]
TRIAL = """
name: lying_sensors
duration: 30.0
testbed: {modes: 1}
sensors: {joint_position: {noise: 1.0e-4}, joint_velocity: {noise: 1.0e-3}}
plan: {method: reference_only, goal: {base_yaw: 0.5, hub_pitch: 0.25}, duration: 20.0}
controllers: {pd_feedforward: {}, %(law)s: %(settings)s}
active: %(law)s
fallback: [pd_feedforward]
plausibility: %(plausibility)s
allow_faults: true
schedule: [%(entry)s]
"""
MONITOR = "monitor: {}"
LAWS = {
    "lqr": f"{{{MONITOR}}}",
    "proportional_integral": f"{{{MONITOR}}}",
    "output_feedback": f"{{rate_sigma: 1.0e-3, {MONITOR}}}",
    "collocated_pid": "{}",
}
LIES = {
    "rate sensor reads zero": "{kind: sensor_dropout, channel: joint_velocity, of: base_yaw}",
    "encoder reads zero": "{kind: sensor_dropout, channel: joint_position, of: base_yaw}",
    "rate biased by 0.02 rad/s": (
        "{kind: sensor_bias, channel: joint_velocity, of: base_yaw, bias: 0.02}"
    ),
    "encoder biased by 0.05 rad": (
        "{kind: sensor_bias, channel: joint_position, of: base_yaw, bias: 0.05}"
    ),
    "rate sensor frozen": "{kind: sensor_freeze, channel: joint_velocity, of: base_yaw}",
    "encoder frozen": "{kind: sensor_freeze, channel: joint_position, of: base_yaw}",
    "rate sensor reads NaN": "{kind: sensor_nan, channel: joint_velocity, of: base_yaw}",
}


class Outcome(NamedTuple):
    """What came of a lie."""

    detected: int | None  # ticks after it began; None: never
    by: str  # the kind of the event
    end: str  # who is in charge at the end
    rate: float  # largest rate of a joint in the last second [rad/s]


class _Watch:
    def __init__(self) -> None:
        self.events: list[Event] = []
        self.rates: list[float] = []

    def truth(self, truth: Truth) -> None:
        self.rates.append(float(np.abs(truth.velocity[:2]).max()))

    def question(self, question: Measurement) -> None:
        return

    def answer(self, answer: Answer) -> None:
        return

    def event(self, event: Event) -> None:
        self.events.append(event)


def trial_of(law: str, lie: str, guarded: bool = True, seed: int = 1) -> Trial:
    """Return the trial of a law and a fault (YAML; empty: none), with or without its guard."""
    settings = LAWS[law] if guarded else LAWS[law].replace(MONITOR, "")
    plausible = "{}" if guarded else "null"
    entry = f"{{at: {START}, fault: {lie}}}" if lie else ""
    words = {"law": law, "settings": settings, "plausibility": plausible, "entry": entry}
    return replace(parse_trial(TRIAL % words, "campaign"), seed=seed)


def flown(trial: Trial) -> Outcome:
    """Return what happens in a trial."""
    bench, watch = Bench(bench_settings(trial)), _Watch()
    controllers = build_controllers(trial, "campaign")
    plan = plan_of_trial(trial)
    for controller in controllers.values():
        if plan is not None:
            controller.adopt(plan)
    run_bench(bench, controllers, watch)
    start = round(START / trial.period)
    found = [e for e in watch.events if e.kind in ("doubted", "implausible", "not_ready")]
    alarm = found[0] if found else None
    return Outcome(
        None if alarm is None else alarm.tick - start,
        "" if alarm is None else alarm.kind,
        (bench.failure and "lost") or bench.drive.active or "the brake",
        max(watch.rates[-100:]),
    )


def table(laws: Iterable[str], lies: dict[str, str], guarded: bool) -> str:
    """Return the campaign as Markdown."""
    laws = list(laws)
    lines = ["| fault | " + " | ".join(laws) + " |", "|---|" + "---|" * len(laws)]
    for words, lie in lies.items():
        cells = []
        for law in laws:
            one = flown(trial_of(law, lie, guarded))
            seen = "never" if one.detected is None else f"{one.detected} ({one.by})"
            cells.append(f"{seen}; {one.end}; {one.rate:.2g}")
            print(words, law, one, file=sys.stderr)
        lines.append(f"| {words} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def false_alarms(seeds: int) -> dict[str, int]:
    """Return by law in how many flights without a fault something was seen."""
    return {
        law: sum(flown(trial_of(law, "", seed=seed)).detected is not None for seed in range(seeds))
        for law in LAWS
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50, help="flights without a fault")
    chosen = parser.parse_args()
    print("With the guards:\n\n" + table(LAWS, LIES, True))
    print("\nWithout:\n\n" + table(LAWS, LIES, False))
    print(f"\nFalse alarms in {chosen.seeds} flights of 30 s: {false_alarms(chosen.seeds)}")
