import itertools
from functools import cache
from typing import Any

import numpy as np
import pytest
from tests.plants import plant
from tests.representatives import representatives

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_lab.run.in_process import Observer, run_bench
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.settings import validated

JOINTS, LIMIT, AT, TICK = ("base_yaw", "hub_pitch"), (150.0, 150.0), 1.0, 100
FREE_STATE = ("proportional_integral", "collocated_pid", "disturbance_accommodating")
# planned_gains is not ready without a plan that has gains: test_retargeting_laws
LAWS = [law for law in CONTROLLERS if law != "planned_gains"]
PAIRS = list(itertools.permutations(LAWS, 2))
ROUND = list(itertools.pairwise([*LAWS, *list(LAWS)[:1]]))  # each law in from and out to one
# gains alone, of errors and their rates: without them these laws are the plan's effort, and zero
SETTINGS: dict[str, Any] = {
    "linear": {"system": {"d": [[460.0, 0.0, 920.0, 0.0], [0.0, 460.0, 0.0, 920.0]]}},
    "policy": {"base": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}},
}


class Seen(Observer):
    """Everything that went over the topics."""

    def __init__(self) -> None:
        self.measurements: list[Any] = []
        self.responses: list[Any] = []
        self.truth_log: list[Any] = []
        self.events: list[Any] = []

    def question(self, question: Any) -> None:
        self.measurements.append(question)

    def answer(self, answer: Any) -> None:
        self.responses.append(answer)

    def truth(self, truth: Any) -> None:
        self.truth_log.append(truth)

    def event(self, event: Any) -> None:
        self.events.append(event)

    def of(self, kind: Any) -> list[Any]:
        return [event for event in self.events if event.kind == kind]


def built(name: Any) -> Any:
    return build_controller(name, name, SETTINGS.get(name, {}), plant(0.01, LIMIT), "test")


@cache
def swap(outgoing: Any, incoming: Any) -> Any:
    values = {
        "testbed": {"modes": 1, "initial": {"hub_pitch": 0.1}},
        "duration": 2.5,
        "active": outgoing,
        "schedule": [
            {"at": 0.0, "disturbance": {"base_yaw": 12.0, "hub_pitch": -7.0}},
            {"at": AT, "switch": incoming},
        ],
    }
    bench = Bench(validated(BenchSettings, values, "test"))
    seen = Seen()
    run_bench(bench, {name: built(name) for name in (outgoing, incoming)}, seen)
    return seen


@pytest.mark.parametrize(("outgoing", "incoming"), representatives(PAIRS, *ROUND))
def test_a_swap_misses_no_tick_and_has_no_step(outgoing: Any, incoming: Any) -> None:
    seen = swap(outgoing, incoming)
    (swapped,) = seen.of("switched")
    assert swapped.tick == TICK
    assert (swapped.data["from"], swapped.data["to"]) == (outgoing, incoming)
    assert not seen.of("missed")
    assert [answer.command.tick for answer in seen.responses] == list(range(250))
    applied = np.array([truth.applied_effort for truth in seen.truth_log])
    assert np.abs(applied[TICK]).min() > 0.5  # there is an effort to take over
    rounding = 1e-12 * np.abs(applied[TICK]).max()
    assert np.abs(swapped.data["effort_step"]).max() <= rounding
    assert np.abs(applied[TICK + 1] - applied[TICK]).max() <= rounding
    changes = np.abs(np.diff(applied[TICK + 1 : TICK + 150], axis=0)).max(axis=1)
    # nothing jumps later, either: a fast law relaxes, less at every tick, from the first tick on
    # and again when the handover's ramp ends
    for relaxing in np.split(changes, [100]):
        large = np.flatnonzero(relaxing > 0.02 * min(LIMIT))
        assert np.array_equal(large, np.arange(large.size))
        assert (np.diff(relaxing[: large.size]) < 0.0).all()


@pytest.mark.parametrize("incoming", LAWS)
def test_only_a_law_without_a_free_state_is_blended_in(incoming: Any) -> None:
    outgoing = "lqr" if incoming == "pd_feedforward" else "pd_feedforward"
    answers = swap(outgoing, incoming).responses
    blends = [answer.terms.get("handover") for answer in answers]
    assert all(blend is None for blend in blends[:TICK] + blends[TICK + 100 :])
    sizes = [0.0 if b is None else float(np.abs(b).max()) for b in blends[TICK : TICK + 100]]
    if incoming in FREE_STATE:
        assert max(sizes) < 1e-12
    else:
        assert np.diff(sizes) == pytest.approx(-sizes[0] / 100, rel=1e-9)


@pytest.mark.parametrize("incoming", LAWS)
def test_a_standby_is_as_warm_as_if_it_had_been_in_charge_all_along(incoming: Any) -> None:
    outgoing = "lqr" if incoming == "pd_feedforward" else "pd_feedforward"
    seen = swap(outgoing, incoming)
    alone = built(incoming)
    for question in seen.measurements[: TICK + 1]:
        expected = alone.observe(question._replace(controller=incoming)).estimate
    found = seen.responses[TICK].estimate
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(one, other)
