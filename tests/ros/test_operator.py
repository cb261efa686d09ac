"""What an operator can ask of a running bench, through the services and the action."""

import json
import os
import subprocess
import sys

import pytest
import rclpy
from flexslew_msgs import action, msg, srv
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from flexslew_lab.cli.main import main
from flexslew_lab.trial.domain import own_domain
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.offers import qos
from flexslew_plant.topics import EVENTS, TOPICS

WAIT = 30.0


class Operator:
    def __init__(self):
        self.node = rclpy.create_node("operator")
        self.events = []
        self.truth = None
        self.node.create_subscription(msg.Event, "events", self.events.append, qos(TOPICS[EVENTS]))
        self.node.create_subscription(msg.PlantState, "truth", self._see, 10)

    def _see(self, truth):
        self.truth = truth

    def call(self, kind, name, **request):
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(timeout_sec=WAIT), name
        future = client.call_async(kind.Request(**request))
        return self._result(future)

    def _result(self, future):
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=WAIT)
        assert future.done()
        return future.result()

    def until(self, condition):
        for _ in range(int(WAIT / 0.05)):
            if condition():
                return
            rclpy.spin_once(self.node, timeout_sec=0.05)
        raise AssertionError("it never happened")

    def plan(self, request):
        client = ActionClient(self.node, action.PlanSlew, "plan_slew")
        assert client.wait_for_server(timeout_sec=WAIT)
        heard = []
        goal = action.PlanSlew.Goal(request=request, period=0.01, effort_limit=[150.0, 150.0])
        sent = client.send_goal_async(goal, feedback_callback=lambda f: heard.append(f.feedback))
        handle = self._result(sent)
        result = self._result(handle.get_result_async()).result
        client.destroy()
        return result, heard


@pytest.fixture(scope="module")
def operator():
    with own_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        plant = ["-p", "rate_factor:=2.0", "-p", "bench.max_missed:=1000"]
        commands = [
            ["flexslew_control.ros.controller_node", "-r", "__node:=second"],
            ["flexslew_control.ros.controller_node"],
            ["flexslew_control.ros.planner_node"],
            ["flexslew_plant.ros.plant_node", *plant],
        ]
        children = [
            subprocess.Popen([sys.executable, "-m", module, "--ros-args", *rest])
            for module, *rest in commands
        ]
        rclpy.init()
        try:
            yield Operator()
        finally:
            rclpy.shutdown()
            for child in reversed(children):
                child.terminate()
            for child in children:
                child.wait(WAIT)
            del os.environ["ROS_DOMAIN_ID"]


def test_controllers_are_listed_with_who_is_in_charge(operator):
    operator.until(lambda: operator.truth is not None and operator.truth.tick > 5)
    reply = operator.call(srv.ListControllers, "list_controllers")
    assert reply.active == "pd_feedforward"
    assert [(c.controller, c.ready) for c in reply.controllers] == [
        ("pd_feedforward", True),
        ("second", True),
    ]
    assert all("computed" in c.settings for c in reply.controllers)


def test_a_switch_to_a_stranger_is_refused_and_changes_nothing(operator):
    reply = operator.call(srv.SwitchController, "switch_controller", controller="nobody")
    assert not reply.ok
    assert "pd_feedforward, second" in reply.message
    assert operator.call(srv.ListControllers, "list_controllers").active == "pd_feedforward"


def test_a_switch_takes_effect_at_the_tick_that_was_asked_for(operator):
    at = (operator.truth.tick + 800) * 0.01  # what was heard of the truth may lag behind it
    reply = operator.call(
        srv.SwitchController, "switch_controller", controller="second", at=stamp(at)
    )
    assert reply.ok, reply.message
    assert len(reply.effort_step) == 2
    operator.until(lambda: any(e.kind == "switched" for e in operator.events))
    event = next(e for e in operator.events if e.kind == "switched")
    assert event.tick == reply.tick == round(at / 0.01)


def test_pause_step_start_and_reset(operator):
    assert operator.call(Trigger, "pause").success
    assert not operator.call(Trigger, "pause").success
    seen = operator.call(srv.Step, "step", ticks=7)
    assert seen.ok
    operator.until(lambda: operator.truth.tick == seen.tick)
    again = operator.call(srv.Step, "step", ticks=1)
    assert again.tick == seen.tick + 1
    operator.until(lambda: operator.truth.tick == again.tick)
    assert operator.call(Trigger, "reset").success
    assert operator.call(Trigger, "start").success
    operator.until(lambda: operator.truth.epoch == 1 and operator.truth.tick > 3)


def test_the_planner_reports_every_iteration_and_publishes_the_plan(operator):
    request = "{method: optimized_feedforward, model: {modes: 1}, goal: {base_yaw: 0.2}}"
    result, heard = operator.plan(request)
    assert result.error_code == result.DONE
    assert [f.iteration for f in heard] == list(range(1, len(heard) + 1))
    assert heard[-1].norm_terminal_error < 1e-6
    assert len(result.plan.hash) == 64
    assert operator.node.count_publishers("plan") == 1


def test_a_bad_request_gets_a_code_and_one_line_and_no_plan(operator):
    result, _ = operator.plan("{method: optimized_feedforward, duratoin: 25}")
    assert result.error_code == result.BAD_INPUT
    assert "duratoin" in result.message
    assert "duration" in result.message
    result, _ = operator.plan("{method: optimized_feedforward, goal: {base_yaw: 3.0}}")
    assert result.error_code == result.FAILED
    assert "150" in result.message
    assert not result.plan.hash


def test_the_command_line_operates_the_bench(operator, monkeypatch, capsys):
    def call(*words):
        monkeypatch.setattr(sys, "argv", ["flexslew", *words])
        with pytest.raises(SystemExit) as end:
            main()
        said = capsys.readouterr()
        return end.value.code, (said.out + said.err).strip()

    rclpy.shutdown()  # a command is a process of its own
    try:
        call("start")
        assert call("pause")[0] == 0
        code, words = call("pause")
        assert (code, words) == (1, "not running but paused")
        assert call("step", "3")[0] == 0
        code, words = call("controllers", "--json")
        assert code == 0
        assert {c["controller"] for c in json.loads(words)["controllers"]} >= {"second"}
        assert call("inject", "{kind: command_lost}")[0] == 1  # faults are off
        assert "nobody" in call("switch", "nobody")[1]
        assert call("brake")[0] == 0
        assert call("brake", "--release")[0] == 0
        assert call("reset")[0] == 0
    finally:
        rclpy.init()
