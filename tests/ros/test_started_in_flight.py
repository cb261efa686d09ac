"""A controller that is killed with a plan that is flown or ahead, and started again."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from flexslew_msgs.srv import SetRate
from rclpy.duration import Duration
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_plant.graph.topics import (
    CONTROLLER_STATUS,
    JOINT_TRAJECTORY,
    PLANNED_TRAJECTORY,
    TOPICS,
)
from flexslew_plant.ros.offers import qos, subscription

from .bystander import beside
from .flight import Flight, again, slew
from .one_by_one import CONTROLLER, PLANNER


@pytest.mark.slow
def test_it_flies_what_the_others_fly_before_a_reset_and_after_it(tmp_path: Path) -> None:
    def act(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bystander:
            assert bystander.ask(Trigger, "pause").success
            heard: list[Any] = []
            profile = qos(TOPICS[PLANNED_TRAJECTORY])
            node = bystander.node
            node.create_subscription(JointTrajectory, PLANNED_TRAJECTORY, heard.append, profile)
            ours = node.create_publisher(JointTrajectory, JOINT_TRAJECTORY, 10)
            bystander.until(lambda: bool(heard) and ours.get_subscription_count() == 1)
            there = JointTrajectoryPoint(positions=[0.4, 0.3])
            there.time_from_start = Duration(seconds=4).to_msg()
            later = JointTrajectory(joint_names=["base_yaw", "hub_pitch"], points=[there])
            later.header.stamp.sec = 7
            ours.publish(later)
            bystander.until(lambda: len(heard) == 2)
            os.kill(pids["pd_feedforward"], signal.SIGKILL)
            again("pd_feedforward", CONTROLLER, tmp_path, domain)
            bystander.until(lambda: bool(bystander.ask(Trigger, "start").success))
            bystander.pass_by(40)
            assert bystander.ask(Trigger, "reset").success
            bystander.until(lambda: bool(bystander.ask(Trigger, "start").success))
            assert bystander.ask(SetRate, "set_rate", rate_factor=0.0).ok

    trial = slew(duration=12.0, rate=1.0, extra="max_missed: 100000", patience=0.5)
    flight = Flight(trial, tmp_path, 10, act)
    bag = BagReader(flight.bag)
    began = [event.data["fresh"] for event in bag.overview.events if event.kind == "began"]
    assert began.count(True) == 1, flight.log  # and anew, where it heard the plans after questions
    flown = bag.columns("/controller_state", {"tick", "epoch", "reference_position"})
    at = dict(
        zip(
            zip(flown["epoch"], flown["tick"], strict=True),
            flown["reference_position"],
            strict=True,
        )
    )
    shared = [tick for epoch, tick in at if epoch == 0]  # the newcomer's are among them
    for tick in shared:
        assert at[0, tick].tolist() == pytest.approx(at[1, tick].tolist()), tick
    last = flown["reference_position"][-1]
    assert flown["epoch"][-1] == 1
    assert last.tolist() == pytest.approx([0.1, 0.05])
    assert resim(flight.bag).identical


@pytest.mark.ros
def test_who_is_in_charge_before_it_hears_the_plan_that_is_flown_joins_it(tmp_path: Path) -> None:
    """The planner is away, as it seems where the message is on its way."""
    statuses: dict[str, Any] = {}

    def act(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bystander:
            assert bystander.ask(Trigger, "pause").success
            subscription(
                bystander.node,
                CONTROLLER_STATUS,
                lambda status: statuses.update({status.controller: status}),
            )
            for name in ("planner", "pd_feedforward"):
                os.kill(pids[name], signal.SIGKILL)
            at_once = ("-p", "requires_plan:=false")
            again("pd_feedforward", CONTROLLER, tmp_path, domain, *at_once)
            bystander.until(lambda: bool(bystander.ask(Trigger, "start").success))
            bystander.until(lambda: "pd_feedforward" in statuses)
            # asked, in charge, and without a plan
            bystander.until(lambda: not statuses["pd_feedforward"].plan_hash)
            bystander.until(lambda: statuses["pd_feedforward"].last_tick > 0)
            bystander.pass_by(40)
            again("planner", PLANNER, tmp_path, domain)
            followed = statuses["lqr"].plan_hash
            bystander.until(lambda: statuses["pd_feedforward"].plan_hash == followed)
            bystander.pass_by(20)
            bystander.until(lambda: statuses["pd_feedforward"].ready)
            assert bystander.ask(SetRate, "set_rate", rate_factor=0.0).ok

    extra = "max_missed: 100000"
    trial = slew(duration=60.0, rate=1.0, more=", lqr: {}", extra=extra, patience=0.5)
    flight = Flight(trial, tmp_path, 10, act)
    assert "t = 60.00 s: 6000 ticks" in flight.log
    assert "plan_refused" not in flight.events
    flown = BagReader(flight.bag).columns("/controller_state", {"tick", "reference_position"})
    assert flown["reference_position"][-1].tolist() == pytest.approx([0.1, 0.05])
    found = resim(flight.bag)
    assert found.identical, found.first_difference
