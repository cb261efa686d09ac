"""The simulated time of nodes that do not hear every tick."""

from math import inf, nan
from typing import Any

import pytest
from flexslew_msgs.msg import BenchState

from flexslew_control.ros import bench_clock
from flexslew_control.ros.bench_clock import BenchClock
from flexslew_plant.ros.messages import stamp


@pytest.fixture
def hearing(monkeypatch: pytest.MonkeyPatch) -> tuple[BenchClock, Any, list[int]]:
    """Return a clock, what it is told states by, and the resets that it tells of."""
    told: list[Any] = []
    monkeypatch.setattr(bench_clock, "subscription", lambda node, name, hear: told.append(hear))
    node: Any = None
    resets: list[int] = []
    clock = BenchClock(node, lambda: resets.append(clock.epoch))
    return clock, told[0], resets


def test_it_goes_on_at_the_rate_of_the_bench_and_tells_of_resets(
    hearing: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, tell, resets = hearing
    now = 50.0
    monkeypatch.setattr(bench_clock, "monotonic", lambda: now)
    tell(BenchState(state="running", stamp=stamp(3.0), tick=300, rate_factor=2.0))
    now += 0.5
    assert clock.now() == pytest.approx(4.0)
    tell(BenchState(state="paused", stamp=stamp(0.0), epoch=1))
    now += 0.5
    assert (clock.now(), resets) == (0.0, [1])


@pytest.mark.parametrize(
    "strange",
    [{"rate_factor": nan}, {"rate_factor": inf}, {"rate_factor": -1.0}, {"stamp": stamp(-1.0)}],
)
def test_a_state_that_no_bench_has_is_passed_over(hearing: Any, strange: dict[str, Any]) -> None:
    clock, tell, resets = hearing
    tell(BenchState(state="paused", stamp=stamp(3.0), tick=300))
    tell(BenchState(state="running", epoch=9, **strange))
    assert (clock.now(), clock.epoch, resets) == (3.0, 0, [])
