"""Questions of somebody else's bench, of a bag played on its topics, or typed by hand."""

import numpy as np
import pytest
from tests.wire_bench import WireBench

from flexslew_lab.trial.trial import Trial
from flexslew_plant.measurement import Measurement

LAWS = ("lqr", "pd_feedforward", "output_feedback")


def question(tick: int, value: float, epoch: int = 0) -> Measurement:
    """Return a question that the bench has not asked."""
    two = np.full(2, value)
    return Measurement(tick, epoch, tick * 0.01, "lqr", two, two, two, two, two)


@pytest.mark.parametrize(
    "stray",
    [question(3010, 0.1), question(1 << 60, float("nan")), question(3, 0.5), question(5, 0.1, 77)],
)
def test_one_stray_question_changes_nothing_and_is_told_of_once(stray: Measurement) -> None:
    flights = []
    for heard in (False, True):
        bench = WireBench(Trial(controllers={law: {} for law in LAWS}, active="lqr", duration=10.0))
        bench.fly(20)
        for _ in range(2 if heard else 0):
            for host in bench.hosts.values():
                assert host.observe(stray) is None
            bench.fly(bench.bench.tick + 20)
        bench.fly(60)
        flights.append(bench)
    clean, strayed = flights
    assert strayed.bench.drive.missed == 0
    assert all(host.reason is None for host in strayed.hosts.values())
    told = strayed.of_kind("stray")
    assert sorted(event.source for event in told) == sorted(LAWS)
    assert "measurement" in told[0].message
    for before, after in zip(clean.truth_log, strayed.truth_log, strict=False):
        np.testing.assert_array_equal(before.position, after.position)


def test_a_bag_played_beside_the_bench_changes_nothing() -> None:
    bench = WireBench(Trial(controllers={"lqr": {}}, active="lqr", duration=10.0))
    (host,) = bench.hosts.values()
    for tick in range(1, 60):
        bench.fly(tick)
        assert host.observe(question(2000 + tick, 0.3)) is None
    assert (bench.bench.drive.missed, bench.bench.tick) == (0, 59)
