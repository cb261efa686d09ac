"""Every pair of what an operator may ask, at one tick: nobody dies, and the bench flies on."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest
from tests.representatives import products
from tests.wire_bench import WireBench

from flexslew_control.plan import Plan
from flexslew_lab.trial.trial import Trial
from flexslew_plant.bench.records import SwitchRequest

KALMAN = ("lqr", "proportional_integral", "output_feedback")
TUNED: dict[str, list[dict[str, Any]]] = {
    "lqr": [{"filter": {"angle_sigma": 2e-4}}, {"weights": {"joint": 50.0}}],
    "proportional_integral": [{"filter": {"rate_sigma": 2e-3}}, {"tracking_time": 5.0}],
    "output_feedback": [{"reaching_rate": 1.5}, {"attitude_gain": 0.1}],
}
LATER = 8  # ticks that are flown afterwards


class Operated(WireBench):
    """A bench whose controller in charge runs a law, with another one beside it."""

    def __init__(self, law: str) -> None:
        super().__init__(
            Trial(controllers={law: {}, "pd_feedforward": {}}, active=law, duration=100.0)
        )
        self.law, self.tunings = law, 0

    def tune(self) -> None:
        changes = TUNED[self.law][self.tunings % 2]
        self.tunings += 1
        assert self.hosts[self.law].tune(changes).ok

    def plan(self) -> None:
        start = (self.bench.tick + 2) * self.bench.settings.period
        for host in self.hosts.values():
            here = host.controller.reference(self.bench.tick) if host.controller else None
            assert here is not None
            assert host.adopt(move(here.position, start, self.plant.joint_names)) is None

    def switch(self) -> None:
        other = "pd_feedforward" if self.bench.drive.active == self.law else self.law
        self.session.switch(SwitchRequest(other, 0), self.now)

    def retarget(self) -> None:
        assert not self.bench.retarget("{appendage: none, to: 0.1, duration: 1.0}").ok

    def brake(self) -> None:
        self.session.brake(not self.bench.handover.latched)

    def note(self) -> None:
        assert self.session.note("here").ok

    def pause(self) -> None:
        self.session.pause(self.now)

    def reset(self) -> None:
        self.session.reset()
        self._waiting.clear()
        for host in self.hosts.values():  # which hear of it with the state of the bench
            host.begin_epoch(self.bench.epoch)

    def set_rate(self) -> None:
        assert self.session.set_rate(0.0, self.now).ok


OPERATIONS: tuple[Callable[[Operated], None], ...] = (
    Operated.tune,
    Operated.plan,
    Operated.switch,
    Operated.retarget,
    Operated.brake,
    Operated.note,
    Operated.pause,
    Operated.reset,
    Operated.set_rate,
)


def move(position: Any, start: float, joints: tuple[str, ...]) -> Plan:
    """Return a plan that stays where it is for five ticks."""
    places = np.tile(position, (6, 1))
    still = np.zeros_like(places)
    return Plan("none", joints, start, 0.01, places, still, still[1:], np.zeros((6, 0)), 0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "moment"), products(KALMAN, ["before the first measurement", "tick 0", "in flight"])
)
def test_any_two_requests_at_one_tick_leave_a_bench_that_flies(law: str, moment: str) -> None:
    for first, second in product(OPERATIONS, repeat=2):
        bench = Operated(law)
        if moment != "before the first measurement":
            bench.fly(0 if moment == "tick 0" else 6)
        first(bench)
        second(bench)
        words = f"{first.__name__}, {second.__name__}"
        if bench.session.run.state == "paused":
            assert bench.session.start().ok, words
        bench.fly(bench.bench.tick + LATER)
        for name, host in bench.hosts.items():
            assert host.reason is None, (words, name, host.reason)
            assert host.last_tick >= bench.bench.tick - 1, (words, name)
        if not bench.bench.handover.latched and bench.bench.drive.active == "":
            bench.session.switch(SwitchRequest(law, 0), bench.now)  # after a release
            bench.fly(bench.bench.tick + LATER)
            assert bench.bench.drive.active == law, words
        assert not bench.bench.faulted, (words, bench.events)
        assert bench.bench.drive.missed == 0, (words, bench.events)
