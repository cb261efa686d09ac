"""What an operator can ask of a running bench, through the services and the action."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from flexslew_msgs import action, msg, srv
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.action import ActionClient, get_action_server_names_and_types_by_node
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from std_srvs.srv import Trigger

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.ros.operator import connected
from flexslew_lab.run.domain import RunningBench, default_bench, locked_domain
from flexslew_plant.graph.policies import NODE_SERVICES, NODE_TOPICS, ROLES
from flexslew_plant.graph.topics import EVENTS, PLAN, RECORDER_STATUS, TOPICS
from flexslew_plant.refusal import NO_TESTBED
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.offers import qos
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.identified import FreeMode, IdentifiedTestbed
from flexslew_plant.yaml_data import load_yaml, yaml_text
from tests.present import present

# not received by those who talk past DDS, or without a goal of follow_joint_trajectory or plan_slew
NOT_ALWAYS = {"/measurement", "/effort_command", "/joint_states", "/appendage_states"}
WAIT = 200.0  # on a busy machine, which may have to compile first
PATIENT = f"""
from flexslew_lab.cli import main, operate
from flexslew_lab.ros import operator
operator.PATIENCE = operate._FALLBACK_TIMEOUT = {WAIT}
main.main()
"""  # a command that waits as long for the bench


class Seen(NamedTuple):
    """What the graph says of a node, by name."""

    published: set[str]
    subscribed: set[str]
    served: set[str]


class LateBag(NamedTuple):
    """The bag of a recorder that came late and was interrupted before the end."""

    bag: Path
    roles: dict[str, str]  # by node
    graph: dict[str, Seen]  # while it recorded


class Operator:
    """A node that asks, beside the processes of the bench."""

    def __init__(self, commands: list[list[str]]) -> None:
        self.node = rclpy.create_node("operator")
        self.events: list[msg.Event] = []
        self.truth: msg.PlantState | None = None
        self.node.create_subscription(msg.Event, "events", self.events.append, qos(TOPICS[EVENTS]))
        self.node.create_subscription(msg.PlantState, "truth", self._see, 10)

        latched = qos(TOPICS[PLAN])  # will never be served: the bench starts all the same
        self.node.create_subscription(msg.Measurement, "measurement", lambda _: None, latched)
        self.children = [
            subprocess.Popen([sys.executable, "-m", module, "--ros-args", *rest])
            for module, *rest in commands
        ]

    def _see(self, truth: msg.PlantState) -> None:
        self.truth = truth

    def call(self, kind: Any, name: str, **request: Any) -> Any:
        return self._result(self.ask(kind, name, **request))

    def ask(self, kind: Any, name: str, **request: Any) -> Future:
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(timeout_sec=WAIT), name
        return client.call_async(kind.Request(**request))

    def _result(self, future: Future) -> Any:
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=WAIT)
        assert future.done()
        return future.result()

    def until(self, condition: Callable[[], object]) -> None:
        end = monotonic() + WAIT
        while not condition():
            assert monotonic() < end, "it never happened"
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def count_tick(self, tick: int, epoch: int = 0) -> bool:
        """Return whether a later tick has been seen, of this epoch or a later one."""
        return self.truth is not None and self.truth.epoch >= epoch and self.truth.tick > tick

    def controllers(self) -> Any:
        return self.call(srv.ListControllers, "list_controllers").controllers

    def plan(
        self, request: str, name: str = "plan_slew"
    ) -> tuple[action.PlanSlew.Result, list[action.PlanSlew.Feedback]]:
        client = ActionClient(self.node, action.PlanSlew, name)
        assert client.wait_for_server(timeout_sec=WAIT)
        heard: list[action.PlanSlew.Feedback] = []
        goal = action.PlanSlew.Goal(request=request)  # the planner knows period and limits
        sent = client.send_goal_async(goal, feedback_callback=lambda f: heard.append(f.feedback))
        handle = self._result(sent)
        result = self._result(handle.get_result_async()).result
        client.destroy()
        return result, heard


class Parameters:
    """The ROS parameters of a node, as another one sees them."""

    def __init__(self, operator: Operator, node: str) -> None:
        self._operator, self._node = operator, node

    def describe(self, *names: str) -> dict[str, ParameterDescriptor]:
        service = f"/{self._node}/describe_parameters"
        reply = self._operator.call(DescribeParameters, service, names=names)
        return {d.name: d for d in reply.descriptors}

    def set(self, name: str, value: Any) -> tuple[bool, str]:
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        service = f"/{self._node}/set_parameters"
        reply = self._operator.call(SetParameters, service, parameters=parameters)
        return reply.results[0].successful, reply.results[0].reason

    def get(self, name: str) -> Any:
        reply = self._operator.call(GetParameters, f"/{self._node}/get_parameters", names=[name])
        return parameter_value_to_python(reply.values[0])


@pytest.fixture(scope="module")
def operator() -> Iterator[Operator]:
    with locked_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        plant = ["-p", "rate_factor:=2.0", "-p", "bench.max_missed:=1000"]
        commands = [
            ["flexslew_control.ros.controller_node", "-r", "__node:=second"],
            ["flexslew_control.ros.controller_node"],
            ["flexslew_control.ros.planner_node"],
            ["flexslew_plant.ros.plant_node", *plant],
        ]
        rclpy.init()
        at_work = Operator(commands)
        try:
            at_work.until(lambda: [c.ready for c in at_work.controllers()] == [True, True])
            at_work.until(lambda: at_work.plan("{")[0].message != str(NO_TESTBED))
            yield at_work
        finally:
            rclpy.shutdown()
            for child in reversed(at_work.children):
                child.terminate()
            for child in at_work.children:
                child.wait(WAIT)
            del os.environ["ROS_DOMAIN_ID"]


@pytest.mark.slow
def test_controllers_are_listed_with_who_is_in_charge(operator: Operator) -> None:
    operator.until(lambda: operator.count_tick(5))

    reply = operator.call(srv.ListControllers, "list_controllers")
    assert reply.active == "pd_feedforward"
    assert [(c.controller, c.ready) for c in reply.controllers] == [
        ("pd_feedforward", True),
        ("second", True),
    ]
    assert all("computed" in c.settings for c in reply.controllers)


def test_a_switch_to_a_stranger_is_refused_and_changes_nothing(operator: Operator) -> None:
    reply = operator.call(srv.SwitchController, "switch_controller", controller="nobody")
    assert not reply.ok
    assert "pd_feedforward, second" in reply.message
    assert operator.call(srv.ListControllers, "list_controllers").active == "pd_feedforward"


def test_a_switch_takes_effect_at_the_tick_that_was_asked_for(operator: Operator) -> None:
    assert operator.call(Trigger, "pause").success
    due = operator.call(srv.Step, "step", ticks=1).tick + 20
    switched = operator.ask(
        srv.SwitchController, "switch_controller", controller="second", at=stamp(due * 0.01)
    )
    operator.until(lambda: any(e.kind == "switch_requested" for e in operator.events))
    assert operator.call(Trigger, "start").success
    reply = operator._result(switched)
    assert reply.ok, reply.message
    assert len(reply.effort_step) == 2
    operator.until(lambda: any(e.kind == "switched" for e in operator.events))
    event = next(e for e in operator.events if e.kind == "switched")
    late = [
        e for e in operator.events if e.kind == "missed" and e.tick >= due and "second" in e.data
    ]
    assert event.tick == reply.tick == due + len(late)  # its first answer; a busy machine misses


def test_pause_step_start_and_reset(operator: Operator) -> None:
    assert operator.call(Trigger, "pause").success
    assert not operator.call(Trigger, "pause").success
    seen = operator.call(srv.Step, "step", ticks=7)
    assert seen.ok
    operator.until(lambda: present(operator.truth).tick == seen.tick)
    again = operator.call(srv.Step, "step", ticks=1)
    assert again.tick == seen.tick + 1
    operator.until(lambda: present(operator.truth).tick == again.tick)
    assert operator.call(Trigger, "reset").success
    assert operator.call(Trigger, "start").success
    operator.until(lambda: operator.count_tick(3, epoch=1))


@pytest.mark.slow
def test_the_planner_reports_every_iteration_and_publishes_the_plan(operator: Operator) -> None:
    request = "{method: optimized_feedforward, model: {modes: 1}, goal: {base_yaw: 0.2}"
    refused, _ = operator.plan(request + "}")  # from 0 s on
    assert refused.error_code == refused.BAD_INPUT
    assert refused.message.startswith("the plan starts at 0 s, the bench is at ")
    result, heard = operator.plan(request + ", start: 6000}")
    assert result.error_code == result.DONE, result.message
    taken, planned = result.message.split("; ")[:2]
    assert taken == "taken by pd_feedforward, second"
    assert planned.startswith("planned for pd_feedforward (")
    assert [f.iteration for f in heard] == list(range(1, len(heard) + 1))
    assert heard[-1].norm_terminal_error < 1e-6
    assert len(result.plan.hash) == 64
    assert operator.node.count_publishers("plan") == 1


@pytest.mark.slow
def test_the_planner_takes_an_identified_model_while_the_bench_is_paused(
    operator: Operator,
) -> None:
    found = IdentifiedTestbed(
        joints=("base_yaw", "hub_pitch"),
        joint_units=("rad", "rad"),
        inertia=((4000.0, 0.0), (0.0, 4000.0)),
        free_modes=(FreeMode(frequency=0.5, joints=(0.001, 0.0)),),
        appendages=(),
        effort_limit=(150.0, 150.0),
    )
    strange = replace(found, joints=("yaw", "hub_pitch"))

    def believe(text: str) -> tuple[bool, str]:
        return Parameters(operator, "planner").set("model", text)

    def believes(request: str) -> str:
        result, _ = operator.plan(f"{{method: reference_only, {request}}}", "draft_plan")
        assert result.error_code == result.DONE, result.message
        return str(load_yaml(result.plan.summary, "the plan")["believes"])

    goal = "goal: {base_yaw: 0.1}, duration: 5, start: 7000.0"
    text = yaml_text({"source": "a run", "model": plain(found)})
    operator.until(lambda: not believe(text)[0])  # the planner has heard that ticks pass
    assert "pause it" in believe(text)[1]
    assert operator.call(Trigger, "pause").success
    operator.until(lambda: believe(text)[0])
    assert "kind identified instead of csa" in believes(goal)
    assert "identified" not in believes(f"{goal}, model: {{modes: 1}}")  # its own word goes first
    refused, why = believe(yaml_text({"model": plain(strange)}))
    assert not refused
    assert "is of yaw, hub_pitch; on the bench are base_yaw, hub_pitch" in why
    assert "`flexslew identify` writes one" in believe("modes: []")[1]
    assert "kind identified" in believes(goal)
    assert believe("") == (True, "")
    assert "identified" not in believes(goal)
    assert operator.call(srv.Operate, "decide_plan", action="refuse", who="ann").ok
    assert operator.call(Trigger, "start").success


def test_a_draft_is_followed_by_nobody_until_it_is_adopted(operator: Operator) -> None:
    plans: list[msg.Plan] = []
    operator.node.create_subscription(msg.Plan, "plan", plans.append, qos(TOPICS[PLAN]))

    def draft(start: float) -> msg.Plan:
        request = (
            f"{{method: reference_only, goal: {{base_yaw: 0.1}}, duration: 5, start: {start}}}"
        )
        result, _ = operator.plan(request, "draft_plan")
        assert result.error_code == result.DONE, result.message
        return result.plan

    def decide(action: str) -> tuple[bool, str]:
        reply = operator.call(srv.Operate, "decide_plan", action=action, who="ann")
        return reply.ok, reply.message

    assert decide("adopt") == (False, "there is no draft to decide on; make one with draft_plan")
    first, second = draft(7000.0), draft(8000.0)
    assert decide("fly")[1] == "action: 'fly' is not allowed: adopt, refuse"
    assert decide(f"adopt {first.hash}")[1].startswith(f"the draft is {second.hash[:12]} now")
    assert decide(f"refuse {second.hash}")[0]
    assert not decide("adopt")[0]
    third = draft(9000.0)
    reply = operator.call(srv.Operate, "decide_plan", action=f"adopt {third.hash}", who="ann")
    assert (reply.ok, reply.tick) == (True, 900_000), reply.message
    operator.until(lambda: plans and plans[-1].hash == third.hash)
    assert not {first.hash, second.hash} & {plan.hash for plan in plans}
    operator.call(Trigger, "start")
    operator.until(lambda: operator.count_tick(100))
    soon = present(operator.truth).tick + 400
    draft(soon * 0.01)
    late = soon + 100  # the planner hears of the time now and then, and on a busy machine later
    operator.until(lambda: operator.count_tick(late))
    assert decide("adopt")[1].startswith(f"the plan starts at {soon * 0.01:g} s, the bench is at")
    assert decide("refuse")[0]

    def told() -> list[tuple[str, str]]:
        events = [e for e in operator.events if e.source == "planner"][-7:]
        return [(e.kind, json.loads(e.data)["who"]) for e in events]

    drafted, refused = ("plan_drafted", "unnamed"), ("plan_refused", "ann")
    requested = [drafted, drafted, refused, drafted, ("planned", "ann"), drafted, refused]
    operator.until(lambda: told() == requested)


def test_a_bad_request_gets_a_code_and_one_line_and_no_plan(operator: Operator) -> None:
    result, _ = operator.plan("{method: optimized_feedforward, duratoin: 25, start: 8000}")
    assert result.error_code == result.BAD_INPUT
    assert "duratoin" in result.message
    assert "duration" in result.message
    result, _ = operator.plan("{method: optimized_feedforward, goal: {base_yaw: 3.0}, start: 8000}")
    assert result.error_code == result.FAILED
    assert "150" in result.message
    assert not result.plan.hash


def test_parameters_tell_the_truth_and_change_in_flight_where_they_can(operator: Operator) -> None:
    plant = Parameters(operator, "plant")
    words = plant.describe("autostart", "rate_factor", "bench.max_missed")
    assert words["autostart"].description == "start when all are there; else the service does"
    assert words["autostart"].read_only
    assert words["rate_factor"].additional_constraints == "0 or more"
    assert not words["rate_factor"].floating_point_range  # ROS has none without both ends
    assert not words["rate_factor"].read_only
    assert words["bench.max_missed"].additional_constraints.startswith("1 or more; ")
    assert plant.set("rate_factor", 3.0) == (True, "")
    assert plant.get("rate_factor") == 3.0
    assert operator.call(srv.SetRate, "set_rate", rate_factor=2.0).ok
    assert plant.get("rate_factor") == 2.0
    ok, reason = plant.set("autostart", False)
    assert not ok
    assert "read-only" in reason
    ok, reason = plant.set("rate_faktor", 1.0)
    assert not ok
    assert "unknown parameter rate_faktor" in reason
    assert not plant.set("rate_factor", -1.0)[0]
    ok, reason = plant.set("display_rate", -1.0)
    assert not ok
    assert "display_rate: -1" in reason


def test_gains_change_as_parameters_and_by_service_alike(operator: Operator) -> None:
    second = Parameters(operator, "second")
    assert second.describe("kp")["kp"].description
    assert not second.describe("kp")["kp"].read_only
    before = len([e for e in operator.events if e.kind == "tuned"])
    assert second.set("kp", [500.0, 500.0]) == (True, "")
    done = operator.call(srv.Tune, "second/tune", settings="{kd: [900.0, 900.0]}", who="ann")
    assert done.ok, done.message
    assert list(second.get("kd")) == [900.0, 900.0]
    typed = [Parameter("kd", value=[910.0, 910.0]).to_parameter_msg()]
    done = operator.call(srv.Tune, "second/tune", values=typed, who="bob")
    assert done.ok, done.message
    assert list(second.get("kd")) == [910.0, 910.0]
    both = operator.call(srv.Tune, "second/tune", settings="{kd: [1.0, 1.0]}", values=typed)
    assert not both.ok
    assert "give settings or values, not both" in both.message
    bad = operator.call(srv.Tune, "second/tune", settings="{kd: [-1.0, 0.0]}")
    assert not bad.ok
    assert "kd" in bad.message
    assert not second.set("kp", [1.0, 2.0, 3.0])[0]
    assert list(second.get("kp")) == [500.0, 500.0]
    operator.call(Trigger, "start")
    operator.until(lambda: len([e for e in operator.events if e.kind == "tuned"]) == before + 3)
    tuned = [json.loads(e.data) for e in operator.events if e.kind == "tuned"][-3:]
    assert [t["who"] for t in tuned] == ["a ROS parameter", "ann", "bob"]


def test_a_switch_in_a_pause_is_answered_by_the_timeout_and_dropped_by_a_reset(
    operator: Operator,
) -> None:
    operator.call(Trigger, "pause")
    later = operator.call(
        srv.SwitchController, "switch_controller", controller="second", timeout=0.1
    )
    assert (later.ok, later.scheduled) == (False, True), later.message
    assert later.active == "pd_feedforward"
    assert operator.call(Trigger, "reset").success
    operator.until(lambda: any(e.kind == "switch_dropped" for e in operator.events))
    now = operator.call(srv.SwitchController, "switch_controller", controller="pd_feedforward")
    assert not now.ok
    assert "already in charge" in now.message


@pytest.mark.slow
def test_planning_is_cancelled_in_any_method_and_bad_goals_have_words(operator: Operator) -> None:
    client = ActionClient(operator.node, action.PlanSlew, "plan_slew")
    assert client.wait_for_server(timeout_sec=WAIT)
    plans: list[msg.Plan] = []
    operator.node.create_subscription(msg.Plan, "plan", plans.append, qos(TOPICS[PLAN]))
    newest = operator.plan("{method: none, start: 9500}")[0].plan
    operator.until(lambda: plans and plans[-1].hash == newest.hash)
    known = len(plans)
    long = "goal: {base_yaw: 1.0}, functions: 200, basis: hat, duration: 600.0"
    for request in (  # half a minute of a processor each
        "{method: time_optimal, goal: {base_yaw: 1.0, hub_pitch: 0.5}}",
        f"{{method: optimized_feedforward, {long}}}",
    ):
        goal = action.PlanSlew.Goal(request=request, period=0.01, effort_limit=[150.0, 150.0])
        handle = operator._result(client.send_goal_async(goal))
        done = handle.get_result_async()
        assert operator.call(srv.ListControllers, "list_controllers").controllers
        assert Parameters(operator, "planner").get("exit_with_plant") is False
        if not done.done():
            operator._result(handle.cancel_goal_async())
        result = operator._result(done).result
        assert result.error_code == result.CANCELED, result.message
        assert not result.plan.hash
    for wrong in (
        {"effort_limit": [float("nan")] * 2}, {"period": -1.0}, {"period": float("inf")},
        {"request": "{method: optimized_feedforward, goal: {base_yaw: 0.1}, duration: 1.0e9}"},
        {"request": "{method: optimized_feedforward, goal: {elbow: 0.1}}"}, {"request": "{"},
    ):  # fmt: skip
        values = {"period": 0.01, "effort_limit": [150.0, 150.0], "request": "{method: none}"}
        goal = action.PlanSlew.Goal(**(values | wrong))
        handle = operator._result(client.send_goal_async(goal))
        result = operator._result(handle.get_result_async()).result
        assert result.error_code != result.DONE, wrong
        assert result.message, wrong
        assert "nan N m" not in result.message
    assert len(plans) == known
    client.destroy()


def absolute(names: Iterable[str], node: str) -> set[str]:
    return {
        f"/{node}/{n[2:]}" if n.startswith("~/") else n if n.startswith("/") else f"/{n}"
        for n in names
    }


def found(ask: Callable[[str, str], list[tuple[str, list[str]]]], node: str) -> set[str]:
    return {name for name, _ in ask(node, "/") if "/_action/" not in name}


@pytest.fixture(scope="module")
def late_bag(operator: Operator, tmp_path_factory: pytest.TempPathFactory) -> LateBag:
    bag = tmp_path_factory.mktemp("late") / "bag"
    operator.call(Trigger, "start")
    operator.until(lambda: operator.count_tick(5))
    before = present(operator.truth).epoch
    assert operator.call(Trigger, "reset").success
    operator.call(Trigger, "start")
    operator.until(lambda: operator.count_tick(50, before + 1))
    module = "flexslew_lab.ros.recorder_node"
    command = [sys.executable, "-m", module, "--ros-args", "-p", f"folder:={bag}"]
    recorder = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    operator.until(lambda: any(e.kind == "recording" for e in operator.events))
    roles = {
        "plant": "plant", "second": "controller", "planner": "planner",
        "recorder": "recorder", "_recorder": "listener",
    }  # fmt: skip
    graph: dict[str, Seen] = {}

    def discovered() -> bool:  # a topic of theirs may be heard before their names are
        names = {*operator.node.get_node_names()}
        if names >= {*roles}:
            graph.update({name: seen_of(operator.node, name) for name in roles})
        return bool(graph) and all(
            graph[name].published >= absolute(ROLES[role].publish, name)
            and graph[name].subscribed | NOT_ALWAYS >= absolute(ROLES[role].subscribe, name)
            and graph[name].served >= absolute(ROLES[role].reply, name)
            for name, role in roles.items()
        )

    operator.until(discovered)
    # whoever is on the graph may still take DDS three seconds to be matched with
    kept: list[msg.RecorderStatus] = []
    said = qos(TOPICS[RECORDER_STATUS])
    operator.node.create_subscription(msg.RecorderStatus, "recorder_status", kept.append, said)
    operator.until(lambda: kept and kept[-1].tick > kept[0].tick + 100)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(WAIT) == 130
    return LateBag(bag, roles, graph)


def seen_of(node: Node, name: str) -> Seen:
    return Seen(
        found(node.get_publisher_names_and_types_by_node, name),
        found(node.get_subscriber_names_and_types_by_node, name) - {"/parameter_events"},
        found(node.get_service_names_and_types_by_node, name),
    )


@pytest.mark.slow
def test_the_policies_name_what_is_on_the_graph_and_no_more(
    operator: Operator, late_bag: LateBag
) -> None:
    _, roles, graph = late_bag
    for name, role in roles.items():
        rights = ROLES[role]
        said, heard, served = graph[name]
        own = NODE_TOPICS[1:] if role == "listener" else NODE_TOPICS
        assert said == absolute((*rights.publish, *own), name)
        allowed = absolute(rights.subscribe, name)
        assert allowed - NOT_ALWAYS <= heard <= allowed
        assert served <= absolute((*rights.reply, *NODE_SERVICES), name)
        assert served >= absolute(rights.reply, name)
    for name in "plant", "planner":
        servers = get_action_server_names_and_types_by_node(operator.node, name, "/")
        assert {action for action, _ in servers} == absolute(ROLES[name].execute, name)


@pytest.mark.slow
def test_a_late_recorder_that_is_interrupted_says_how_many_ticks_are_missing(
    operator: Operator, late_bag: LateBag
) -> None:
    bag, _, _ = late_bag
    wrong = {finding.what: finding.detail for finding in check_log(bag) if not finding.ok}
    ticks = BagReader(bag).columns("/truth", {"tick"})["tick"]
    first, last = int(ticks.min()), int(ticks.max())
    assert first > 50
    assert last > first + 50
    start = wrong["start of the ticks"]
    assert re.fullmatch(rf"{first} ticks missing: epoch \d begins at tick {first}", start)
    end = wrong["end of the ticks"]
    earlier = r"\d+ ticks missing: epoch \d was flown to tick \d+.*; "
    assert re.fullmatch(rf"{earlier}the plant's final event.* run on from tick {last}", end)


def test_diagnostics_say_how_the_bench_fares(operator: Operator) -> None:
    heard: list[DiagnosticArray] = []
    operator.node.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
    operator.call(Trigger, "start")
    operator.until(lambda: len(heard) >= 2)
    statuses = {status.name: status for status in heard[-1].status}
    assert {*statuses} >= {"/flexslew: bench", "/flexslew: pd_feedforward", "/flexslew: second"}
    values = {pair.key: pair.value for pair in statuses["/flexslew: bench"].values}
    assert {*values} == {"tick", "ticks per second", "missed", "brake latched"}
    assert float(values["ticks per second"]) > 0.0
    lag = {pair.key: pair.value for pair in statuses["/flexslew: second"].values}
    assert int(lag["ticks behind"]) < 1000


@pytest.mark.slow
def test_a_second_plant_leaves_with_words_and_a_second_controller_steps_back(
    operator: Operator,
) -> None:
    plant = subprocess.Popen(
        [sys.executable, "-m", "flexslew_plant.ros.plant_node", "--ros-args", "-r", "__node:=two"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    rival = subprocess.Popen(
        [sys.executable, "-m", "flexslew_control.ros.controller_node"], stderr=subprocess.PIPE
    )
    try:
        operator.until(lambda: any(e.kind == "rival" for e in operator.events))
        _, said = plant.communicate(timeout=WAIT)
        assert plant.returncode == 2
        assert "another plant called plant is on the graph already" in said
        told, errors = bytearray(), present(rival.stderr)
        os.set_blocking(errors.fileno(), False)

        def silent() -> bool:
            told.extend(errors.read() or b"")
            return b"this one is silent" in told

        operator.until(silent)
        reply = operator.call(srv.ListControllers, "list_controllers")
        assert [c.controller for c in reply.controllers] == ["pd_feedforward", "second"]
    finally:
        rival.terminate()
        rival.wait(WAIT)


def test_a_dead_controller_is_not_ready_and_no_switch_to_it_is_taken(operator: Operator) -> None:
    operator.until(lambda: [c.ready for c in operator.controllers()] == [True, True])
    assert operator.call(srv.SetRate, "set_rate", rate_factor=2.0).ok  # unpaced it waits
    operator.call(Trigger, "start")
    before = len(operator.events)
    operator.children[0].kill()

    def silent() -> bool:
        told = [json.loads(e.data) for e in operator.events[before:] if e.kind == "not_ready"]
        return ("second", "no_heartbeat") in {(t["controller"], t["cause"]) for t in told}

    operator.until(silent)
    reply = operator.call(srv.SwitchController, "switch_controller", controller="second")
    assert reply.message == "second is not ready: its heartbeat is lost"
    assert (reply.ok, reply.active) == (False, "pd_feedforward")


def test_the_command_line_operates_the_bench(
    operator: Operator, monkeypatch: pytest.MonkeyPatch, call: Callable[..., tuple[Any, str]]
) -> None:
    for patience in ("ros.operator.PATIENCE", "cli.operate._FALLBACK_TIMEOUT"):
        monkeypatch.setattr(f"flexslew_lab.{patience}", WAIT)
    rclpy.shutdown()  # a command is a process of its own
    try:
        call("start")
        assert call("pause")[0] == 0
        code, words = call("pause")
        here = f"(a bench, ROS_DOMAIN_ID {os.environ['ROS_DOMAIN_ID']})"
        assert (code, words) == (1, f"not running but paused {here}")
        assert call("step", "3")[0] == 0
        code, words = call("controllers", "--json")
        assert code == 0
        assert {c["controller"] for c in json.loads(words)["controllers"]} >= {"second"}
        assert call("inject", "{kind: command_lost}")[0] == 1  # faults are off
        assert "nobody" in call("switch", "nobody")[1]
        assert call("brake")[0] == 0
        assert call("brake", "--release")[0] == 0
        known = default_bench()._replace(known=True)  # so that it is waited for
        with locked_domain() as empty, monkeypatch.context() as hasty:
            benches = [RunningBench(empty, "gone", known=False), known]  # none of other users
            monkeypatch.setattr("flexslew_lab.cli.operate.running_benches", lambda: benches)
            hasty.setattr("flexslew_lab.cli.operate._FALLBACK_TIMEOUT", 0.2)
            code, words = call("brake", "--all")
            assert code == 1
            assert "(gone, ROS_DOMAIN_ID" in words
            assert words.endswith(here)
            assert call("brake", "--all", "--release")[0] == 1
        assert call("brake", "--release")[0] == 1  # it has been released
        assert call("reset")[0] == 0
        assert asked_by_the_command_line() <= absolute(ROLES["operator"].request, "operator")
    finally:
        rclpy.init()


@pytest.mark.slow
def test_a_command_of_its_own_process_says_everything_and_leaves_its_exit_code(
    operator: Operator,
) -> None:
    def run(*words: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-c", PATIENT, *words]
        return subprocess.run(command, capture_output=True, text=True, timeout=WAIT, check=False)

    listed = run("controllers", "--json")
    assert listed.returncode == 0
    assert {c["controller"] for c in json.loads(listed.stdout)["controllers"]} >= {"second"}
    refused = run("switch", "nobody")
    assert refused.returncode == 1
    assert "nobody" in refused.stdout + refused.stderr
    assert run("switch").returncode == 2  # to whom?
    assert "Traceback" not in listed.stderr + refused.stderr


def asked_by_the_command_line() -> set[str]:
    """Return the services that its connection calls, as the graph shows them."""
    with connected(int(os.environ["ROS_DOMAIN_ID"]), patience=WAIT) as bench:
        bench.act("pause")
        bench.step(1)
        bench.inject("{kind: command_lost}", 0.0)
        bench.controllers()
        bench.switch("nobody", 0.0, False, 1.0)
        node = bench.nodes[0]
        said, heard, served = seen_of(node, "operator")
        rights = ROLES["operator"]
        assert said <= {*NODE_TOPICS}
        assert served <= absolute(NODE_SERVICES, "operator")
        assert heard <= absolute(rights.subscribe, "operator")
        asked = found(node.get_client_names_and_types_by_node, "operator")
        assert len(asked) == 5
        return asked
