"""Loops whose law reads star tracker and gyro have margins, and the bench flies them."""

from typing import Any

import numpy as np
import pytest

from flexslew_lab.analysis.analysis import Analysis, loop_analysis
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import Trial, parse_trial, set_up
from flexslew_plant.bench.bench import Truth
from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import yaml_text

AXES = ("roll", "pitch", "yaw")
SMALL, TURNED = (1e-4, -1e-4, 0.0), (0.5, -0.3, 1.0)  # attitudes [rad]
GYRO = {"kind": "gyro", "angle_random_walk": 1e-6, "rate_random_walk": 1e-7}
TRACKER = {"kind": "star_tracker", "across": 1e-5, "about": 1e-5}


def craft(
    tracker: dict[str, Any], law: dict[str, Any], turn: tuple[float, ...] = SMALL, **more: Any
) -> Trial:
    """Return a rigid craft with three torque drives, a gyro and a star tracker."""
    drives = {
        name: {"kind": "torque", "direction": row, "limit": 1e4}
        for name, row in zip(AXES, np.eye(3).tolist(), strict=True)
    }
    body = {"mass": 200.0, "inertia": {"xx": 35.0, "yy": 30.0, "zz": 32.0}}
    values = {
        "duration": 40.0,
        "period": 0.1,
        "testbed": {
            "kind": "spacecraft",
            "platform": body,
            "actuators": drives,
            "sensors": {"gyro": GYRO, "tracker": {**TRACKER, **tracker}},
            "initial": dict(zip(AXES, turn, strict=True)),
        },
        "controllers": {"pd_feedforward": {"kp": [4.0], "kd": [24.0], **law}},
        "allow_faults": True,
    }
    return parse_trial(yaml_text({**values, **more}), "here")


def of(what: Trial) -> Analysis:
    return loop_analysis(what, "here", joints=dict.fromkeys(AXES, 0.0))


class Errors:
    """Sizes of the body rate over a flight."""

    def __init__(self) -> None:
        self.sizes: list[float] = []

    def truth(self, truth: Truth) -> None:
        self.sizes.append(float(np.linalg.norm(truth.velocity)))

    def question(self, question: Any) -> None: ...
    def answer(self, answer: Any) -> None: ...
    def event(self, event: Any) -> None: ...


def growth(tracker: dict[str, Any], gain: float, turn: tuple[float, ...] = SMALL) -> float:
    """Return by what factor rates grow from the first third of a flight to the last."""
    faults = [
        {"at": 0.0, "fault": {"kind": "actuator_gain", "joint": name, "gain": gain}}
        for name in AXES
    ]
    seen = Errors()
    run_bench(*set_up(craft(tracker, {"attitude": {}}, turn, schedule=faults), "here"), seen)
    sizes = np.array(seen.sizes)
    third = len(sizes) // 3
    return float(sizes[-third:].max() / sizes[:third].max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tracker", "turn"),
    [({}, SMALL), ({"delay": 0.3, "interval": 0.5, "rate_noise": 1e-3}, SMALL), ({}, TURNED)],
)
def test_the_gain_margin_of_a_law_with_instruments_is_that_of_the_flight(
    tracker: dict[str, Any], turn: tuple[float, ...]
) -> None:
    found = of(craft(tracker, {"attitude": {}}))
    assert found.stable
    up = min(margins.gain_up for margins in found.efforts)
    assert 1.0 < up < of(craft({}, {})).efforts[0].gain_up  # the mean of a tick is half a tick late
    assert growth(tracker, 0.9 * up, turn) < 1.0  # it settles to what noise excites at this gain
    assert growth(tracker, 1.1 * up, turn) > 2.0


def test_a_law_with_instruments_has_its_margins_in_every_attitude() -> None:
    """Its positions are about the reference, of which the instruments read the true attitude."""
    law = {"attitude": {}, "kp": [4.0, 3.0, 6.0], "kd": [24.0, 30.0, 20.0]}
    what, found = craft({"delay": 0.2}, law), []
    for turn in ((0.0, 0.0, 0.0), TURNED, (0.0, 0.0, 2.5)):
        result = loop_analysis(what, "here", joints=dict(zip(AXES, turn, strict=True)))
        disks = [disk.alpha for disk in result.disks.values()]
        found.append([(m.gain_up, m.phase, m.delay) for m in result.efforts] + [tuple(disks)])
    for other in found[1:]:
        for numbers, first in zip(other, found[0], strict=True):
            assert numbers == pytest.approx(first, rel=1e-6)


@pytest.mark.slow
def test_slow_corrections_leave_the_margins_of_gyro_and_joints() -> None:
    """Corrections within minutes do not act at a crossover of seconds."""
    found = of(craft({"across": 1.0, "about": 1.0}, {"attitude": {}}))
    bare = of(craft({}, {}))
    assert found.stable
    for ours, theirs in zip(found.efforts, bare.efforts, strict=True):
        assert ours.delay == pytest.approx(theirs.delay, abs=0.06)  # half a tick, of 0.1 s
        assert ours.delay < theirs.delay


@pytest.mark.slow
def test_a_loop_is_analysed_after_its_manoeuvre() -> None:
    what = parse_trial(
        "{duration: 40.0, testbed: {kind: floating_oscillator},"
        " plan: {method: reference_only, goal: {mass: 0.4}, duration: 20.0},"
        " controllers: {pd_feedforward: {kp: [0.05], kd: [0.3]}, collocated_pid: {kp: [0.05],"
        " kd: [0.3], ki: [0.0]}}, active: pd_feedforward,"
        " schedule: [{at: 10.0, switch: collocated_pid}]}",
        "here",
    )
    found = loop_analysis(what, "here")
    assert found.controller == "collocated_pid"
    assert found.point.rest.time == pytest.approx(20.0)
    assert found.plain()["rest"]["mass"] == pytest.approx(0.4)
    assert loop_analysis(what, "here", at=0.0).controller == "pd_feedforward"
    with pytest.raises(BadInput, match="nobody is not in controllers"):
        loop_analysis(what, "here", "nobody")
