"""The plan that a planner is started with."""

from dataclasses import replace
from pathlib import Path

from flexslew_msgs.srv import SetRate

from flexslew_control.plan_file import load_plan, save_plan

from .bystander import beside
from .flight import Flight, fork_server, slew


def test_that_of_a_second_planner_is_not_published(tmp_path: Path) -> None:
    def act(pids: dict[str, int], domain: int) -> None:
        other, log = tmp_path / "other.yaml", tmp_path / "second.log"
        save_plan(replace(load_plan(tmp_path / "plan.yaml"), start=40.0), other)
        words = ["--ros-args", "-r", "__node:=planner", "-p", f"file:={other}"]
        own = {"ROS_DOMAIN_ID": str(domain)}
        with beside(domain) as bystander, log.open("ab") as said:
            fork_server().start("flexslew_control.ros.planner_node", words, own, said.fileno())
            bystander.until(lambda: "another planner" in log.read_text(), log.read_text)
            assert bystander.ask(SetRate, "set_rate", rate_factor=0.0).ok

    flight = Flight(slew(duration=60.0, rate=1.0), tmp_path, 10, act)
    assert flight.outcome.exit_code == 0, flight.log
    assert flight.events.count("planned") == 1, flight.log
