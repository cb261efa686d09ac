"""What a newcomer hears of the plans of a flight."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import rclpy
from flexslew_msgs.msg import BenchState, ControllerStatus, Event, Plan

from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.plans.plan_file import plan_hash
from flexslew_control.ros.plan_release import NodePlanRelease
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.trial.trial import Trial, plant_of
from flexslew_plant.events import PlanRejected, event_of
from flexslew_plant.graph import topics
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.offers import publisher, qos

from .test_restart import announcement

LOOKS = 4000  # until DDS has told, 10 ms each
AT = 4.5  # where the bench is [s]


@pytest.fixture
def loop() -> Iterator[Loop]:
    with locked_domain() as domain:
        rclpy.init(domain_id=domain)
        one = Loop()
        yield one
        one.close(0.0)
        one.leave(0, lambda: None)
        rclpy.shutdown()


def plan(start: float, begin: float, end: float) -> Any:
    values = {"method": "reference_only", "goal": {"base_yaw": end}, "duration": 4.0}
    values |= {"start": start, "initial": {"base_yaw": begin}}
    return make_plan(plan_settings(values, "test"), plant_of(Trial(duration=60.0)))


@pytest.mark.parametrize(("at", "told"), [(0.0, "planned"), (AT, "plan_refused")])
def test_the_plan_of_tick_0_waits_until_it_is_known_where_the_bench_is(
    loop: Loop, at: float, told: str
) -> None:
    node, bench = rclpy.create_node("planner"), rclpy.create_node("plant")
    release = NodePlanRelease(node, loop, loop.live(node, "planner"), ())
    loop.add(bench)
    heard: list[str] = []
    events = qos(topics.TOPICS[topics.EVENTS])
    bench.create_subscription(Event, topics.EVENTS, lambda event: heard.append(event.kind), events)
    assert release.notify(announcement())
    release.begin_with(plan(0.0, 0.0, 0.03))
    for _ in range(20):
        loop._spin_once(0.01)
        release.begin()
    assert not heard
    state = publisher(bench, topics.BENCH_STATE)
    state.publish(BenchState(stamp=stamp(at), state="paused", tick=round(at * 100), epoch=1))
    for _ in range(LOOKS):
        if heard:
            break
        loop._spin_once(0.01)
        release.begin()
    assert heard == [told]


@pytest.mark.parametrize("follows", [True, False])
def test_in_flight_the_plan_of_tick_0_waits_until_it_is_known_who_follows_it(
    loop: Loop, follows: bool
) -> None:
    node, bench = rclpy.create_node("planner"), rclpy.create_node("plant")
    loop.add(bench)
    state, status = publisher(bench, topics.BENCH_STATE), publisher(bench, topics.CONTROLLER_STATUS)
    release = NodePlanRelease(node, loop, loop.live(node, "planner"), ())
    told: list[str] = []
    for kind, topic in ((Event, topics.EVENTS), (Plan, topics.PLAN)):
        name = kind.__name__
        known = qos(topics.TOPICS[topic])
        bench.create_subscription(kind, topic, lambda _, name=name: told.append(name), known)
    assert release.notify(announcement())
    state.publish(BenchState(stamp=stamp(AT), state="paused", tick=450))
    first = plan(0.0, 0.0, 0.03)
    release.begin_with(first)
    for _ in range(20):
        loop._spin_once(0.01)
        release.begin()
    assert not told
    flown = plan_hash(first) if follows else "another"
    status.publish(ControllerStatus(controller="lqr", ready=True, plan_hash=flown))
    for _ in range(LOOKS):
        if told:
            break
        loop._spin_once(0.01)
        release.begin()
    assert told == ["Plan" if follows else "Event"]


def test_a_newcomer_does_not_hear_the_plan_that_all_have_refused(loop: Loop) -> None:
    node, bench = rclpy.create_node("planner"), rclpy.create_node("plant")
    release = NodePlanRelease(node, loop, loop.live(node, "planner"), ())
    loop.add(bench)
    state, status = publisher(bench, topics.BENCH_STATE), publisher(bench, topics.CONTROLLER_STATUS)
    assert release.notify(announcement())
    first, later = plan(0.0, 0.0, 0.03), plan(6.0, 0.03, 0.05)
    refused = replace(later, start=4.4)

    def until(condition: Any) -> None:
        for _ in range(LOOKS):
            if condition():
                return
            loop._spin_once(0.01)
        raise AssertionError("it never happened")

    release.publish(first, "")
    state.publish(BenchState(stamp=stamp(AT), state="paused", tick=450))
    until(lambda: release.clock.now() == AT)
    taken = release.publish(later, "").hash
    status.publish(ControllerStatus(controller="lqr", ready=True, plan_hash=taken))
    until(lambda: release.responses.of(taken).taken)
    digest = release.publish(refused, "").hash
    what = PlanRejected(digest, controller="lqr", reason="it starts at 4.4 s")
    EventLog(bench).tell(event_of(what, 450, AT, 0, "lqr"))
    until(lambda: release.responses.of(digest).refused)
    until(lambda: node.count_publishers(topics.PLAN) == 1)  # the former one has gone
    heard: list[tuple[str, bool]] = []

    def hear(message: Any) -> None:
        heard.append((message.hash, bool(message.stamp.sec)))

    bench.create_subscription(Plan, topics.PLAN, hear, qos(topics.TOPICS[topics.PLAN]))
    until(lambda: len(heard) >= 2)
    release.publish(plan(20.0, 0.05, 0.04), "")
    until(lambda: len(heard) >= 3)
    assert heard[:2] == [(plan_hash(first), False), (taken, True)]
    assert digest not in {told for told, _ in heard}
