"""The action and the services that robots and simulators have in common, where they are installed.

`control_msgs` and `simulation_interfaces` are not among the wheels: beside a ROS 2 that has them,
or with their packages built into a workspace of one's own, these fly.
"""

from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import ActionClient
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from flexslew_control.plans.tracking import TrackingCode
from flexslew_control.ros import follow_trajectory
from flexslew_lab.replay.resim import resim
from flexslew_plant.graph.topics import FOLLOW_JOINT_TRAJECTORY, PLANNED_TRAJECTORY, TOPICS
from flexslew_plant.ros.messages import seconds_of
from flexslew_plant.ros.offers import qos
from flexslew_plant.ros.plant import simulation_services

from .bystander import PATIENCE, Bystander, beside
from .flight import Flight, slew
from .test_standard_messages import trajectory

pytestmark = pytest.mark.ros

robots = pytest.mark.skipif(not follow_trajectory.INSTALLED, reason="control_msgs is not installed")
simulators = pytest.mark.skipif(
    not simulation_services.INSTALLED, reason="simulation_interfaces is not installed"
)


class Client:
    """Asks for what an action does, of a bench beside it."""

    def __init__(self, bystander: Bystander, kind: Any, name: str) -> None:
        self._beside, self._kind = bystander, kind
        self._client = ActionClient(bystander.node, kind, name)
        self.received: list[Any] = []  # feedback
        assert self._client.wait_for_server(timeout_sec=PATIENCE)

    def planned(self, **fields: Any) -> Any:
        """Return the handle of a goal whose plan has been published."""
        plans: list[Any] = []
        profile = qos(TOPICS[PLANNED_TRAJECTORY])
        self._beside.node.create_subscription(
            JointTrajectory, PLANNED_TRAJECTORY, plans.append, profile
        )
        self._beside.until(lambda: len(plans) == 1)  # the one before
        goal = self.goal(**fields)
        self._beside.until(lambda: len(plans) == 2)
        return goal

    def goal(self, **fields: Any) -> Any:
        """Return the handle of an accepted goal."""
        sent = self._client.send_goal_async(
            self._kind.Goal(**fields), lambda told: self.received.append(told.feedback)
        )
        self._beside.until(sent.done)
        assert sent.result().accepted
        return sent.result()

    def result(self, goal: Any) -> Any:
        """Return what came of a goal."""
        asked = goal.get_result_async()
        self._beside.until(asked.done)
        return asked.result().result

    def close(self) -> None:
        self._client.destroy()


def flown(folder: Path, act: Callable[[Bystander], None], duration: float = 16.0) -> Flight:
    def listen(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bystander:
            assert bystander.ask(Trigger, "pause").success
            act(bystander)

    return Flight(slew(duration=duration, rate=2.0), folder, 10, listen)


@robots
def test_a_robot_is_moved_along_a_trajectory(tmp_path: Path) -> None:
    from control_msgs.action import FollowJointTrajectory
    from control_msgs.msg import JointTolerance

    found: dict[str, Any] = {}
    rest = {"velocities": [0.0, 0.0]}
    path = trajectory(
        ["hub_pitch", "base_yaw"],
        8.0,
        {"at": 2.0, "positions": [0.07, 0.15], "velocities": [0.01, 0.03]},
        {"at": 4.0, "positions": [0.1, 0.2], **rest},
    )

    def act(bystander: Bystander) -> None:
        client = Client(bystander, FollowJointTrajectory, FOLLOW_JOINT_TRAJECTORY)

        def asked(name: str, trajectory_: Any = path, **more: Any) -> Any:
            goal = client.goal(trajectory=trajectory_, **more)
            found[name] = client.result(goal)
            return goal

        asked("strange", trajectory(["elbow"], 8.0, {"at": 1.0, "positions": [0.1]}))
        odd = trajectory(["hub_pitch"], 8.0, {"at": 1.0, "positions": [0.1, 0.2]})
        asked("odd", odd)
        unmeasured = [JointTolerance(name="hub_pitch", acceleration=1.0)]
        asked("unmeasured", path_tolerance=unmeasured)
        for name, limit in ("negative", -2.0), ("no_number", nan):
            asked(name, path_tolerance=[JointTolerance(name="hub_pitch", position=limit)])
        dropped = client.goal(trajectory=path)  # planning takes seconds at first
        bystander.until(dropped.cancel_goal_async().done)
        found["dropped"] = client.result(dropped)
        goal = client.planned(
            trajectory=path,
            path_tolerance=[JointTolerance(name="hub_pitch", position=0.2)],
            goal_tolerance=[JointTolerance(name="base_yaw", position=0.2)],
        )
        assert bystander.ask(Trigger, "start").success
        bystander.until(lambda: len(client.received) > 3)
        canceled = goal.cancel_goal_async()
        bystander.until(canceled.done)
        found["canceling"] = len(canceled.result().goals_canceling)
        found["flown"] = client.result(goal)
        found["feedback"] = list(client.received)
        tight = [JointTolerance(name="base_yaw", position=1e-9)]
        later = trajectory(
            ["hub_pitch", "base_yaw"], 13.0, {"at": 1.0, "positions": [0.1, 0.25], **rest}
        )
        asked("late", trajectory(list(path.joint_names), 8.0, {"at": 1.0, "positions": [0.1, 0.2]}))
        asked("tight", later, path_tolerance=tight)
        client.close()

    flight = flown(tmp_path, act)
    assert flight.outcome.exit_code == 0, flight.log
    codes = {
        name: TrackingCode(r.error_code).name
        for name, r in found.items()
        if hasattr(r, "error_code")
    }
    assert codes == {
        "strange": "INVALID_JOINTS",
        "odd": "INVALID_GOAL",
        "unmeasured": "INVALID_GOAL",
        "negative": "INVALID_GOAL",
        "no_number": "INVALID_GOAL",
        "dropped": "INVALID_GOAL",
        "flown": "SUCCESSFUL",
        "late": "OLD_HEADER_TIMESTAMP",
        "tight": "PATH_TOLERANCE_VIOLATED",
    }, found
    assert found["dropped"].error_string == "canceled by the client"
    assert found["canceling"] == 0  # a published plan is flown
    feedback = found["feedback"][-1]
    assert list(feedback.joint_names) == ["hub_pitch", "base_yaw"]
    for told in found["feedback"]:
        after = max(seconds_of(told.header.stamp) - 8.0, 0.0)
        assert seconds_of(told.actual.time_from_start) == pytest.approx(after)
        assert getattr(told, "index", int(after >= 4.0)) == int(after >= 4.0)
    for k in range(2):
        point = {field: getattr(feedback, field) for field in ("desired", "actual", "error")}
        off = point["desired"].positions[k] - point["actual"].positions[k]
        assert point["error"].positions[k] == off
    assert resim(flight.bag).identical


@robots
def test_a_trajectory_that_another_one_replaces_ends(tmp_path: Path) -> None:
    from control_msgs.action import FollowJointTrajectory
    from control_msgs.msg import JointTolerance

    told: list[Any] = []
    heard: list[Any] = []

    def act(bystander: Bystander) -> None:
        client = Client(bystander, FollowJointTrajectory, FOLLOW_JOINT_TRAJECTORY)
        there = {"positions": [0.2], "velocities": [0.0]}
        path = trajectory(["base_yaw"], 6.0, {"at": 1.0, **there}, {"at": 6.0, **there})
        first = client.planned(trajectory=path)
        back = trajectory(["base_yaw"], 8.5, {"at": 4.0, "positions": [0.1], "velocities": [0.0]})
        stays = JointTolerance(name="hub_pitch", position=1e-9)
        second = client.planned(trajectory=back, path_tolerance=[stays])
        assert bystander.ask(Trigger, "start").success
        told.extend(client.result(goal) for goal in (first, second))
        heard.extend(list(feedback.joint_names) for feedback in client.received)
        client.close()

    flight = flown(tmp_path, act, 10.0)
    assert flight.outcome.exit_code in (0, 1), flight.log
    codes = [TrackingCode(result.error_code).name for result in told]
    assert codes == ["INVALID_GOAL", "PATH_TOLERANCE_VIOLATED"], told
    assert told[0].error_string == "another plan has replaced this one"
    assert "hub_pitch" in told[1].error_string  # which the trajectory does not name
    assert ["base_yaw", "hub_pitch"] in heard


@robots
@pytest.mark.parametrize("end", ["reset", "over"])
def test_a_trajectory_that_the_run_leaves_behind_ends(tmp_path: Path, end: str) -> None:
    from control_msgs.action import FollowJointTrajectory

    told = []

    def act(bystander: Bystander) -> None:
        client = Client(bystander, FollowJointTrajectory, FOLLOW_JOINT_TRAJECTORY)
        rest = {"velocities": [0.0, 0.0]}
        last = {"at": 4.0, "positions": [0.1, 0.2], **rest}
        goal = client.planned(trajectory=trajectory(["hub_pitch", "base_yaw"], 8.0, last))
        assert bystander.ask(Trigger, "start").success
        bystander.until(lambda: bool(client.received))  # it is under way
        if end == "reset":
            assert bystander.ask(Trigger, "reset").success
        told.append(client.result(goal))
        if end == "reset":
            assert bystander.ask(Trigger, "start").success
        client.close()

    flight = flown(tmp_path, act, 16.0 if end == "reset" else 9.0)
    assert flight.outcome.exit_code in (0, 1), flight.log
    words = {"reset": "the bench was reset", "over": "the run is over at 9 s"}[end]
    assert words in told[0].error_string
    assert told[0].error_code == TrackingCode.GOAL_TOLERANCE_VIOLATED


@simulators
def test_a_simulator_is_stepped_paused_and_reset(tmp_path: Path) -> None:
    from simulation_interfaces import action, msg, srv

    said: dict[str, Any] = {}
    states = msg.SimulationState

    def act(bystander: Bystander) -> None:
        def state() -> int:
            return int(bystander.ask(srv.GetSimulationState, "get_simulation_state").state.state)

        def to(wanted: int) -> Any:
            asked = states(state=wanted)
            answer = bystander.ask(srv.SetSimulationState, "set_simulation_state", state=asked)
            return answer.result

        features = bystander.ask(srv.GetSimulatorFeatures, "get_simulator_features").features
        said["steps"] = msg.SimulatorFeatures.STEP_SIMULATION_ACTION in features.features
        tick = bystander.tick
        stepped = bystander.ask(srv.StepSimulation, "step_simulation", steps=7)
        assert stepped.result.result == msg.Result.RESULT_OK, stepped
        bystander.until(lambda: bystander.tick >= tick + 7)
        said["paused"] = state()
        said["again"] = to(states.STATE_PAUSED).result
        client = Client(bystander, action.SimulateSteps, "simulate_steps")
        goal = client.goal(steps=50)
        assert client.result(goal).result.result == msg.Result.RESULT_OK
        bystander.until(lambda: bystander.tick >= tick + 57)
        bystander.until(lambda: client.received[-1].remaining_steps == 0)
        said["feedback"] = [(t.completed_steps, t.remaining_steps) for t in client.received]
        goal = client.goal(steps=100_000)
        bystander.until(lambda: bystander.tick > tick + 60)
        canceled = goal.cancel_goal_async()
        bystander.until(canceled.done)
        said["canceled"] = client.result(goal).result.error_message
        said["rests"] = state()
        tick, goal = bystander.tick, client.goal(steps=100_000)
        bystander.until(lambda: bystander.tick > tick + 10)
        assert bystander.ask(Trigger, "start").success  # what is left of the steps is forgotten
        said["forgotten"] = client.result(goal).result.error_message
        said["flies_on"] = state()
        assert bystander.ask(Trigger, "pause").success
        assert to(states.STATE_PLAYING).result == msg.Result.RESULT_OK
        said["playing"] = state()
        refused = bystander.ask(srv.StepSimulation, "step_simulation", steps=1)
        said["refused"] = refused.result.error_message
        part = bystander.ask(srv.ResetSimulation, "reset_simulation", scope=1)
        said["part"] = part.result.result
        said["quitting"] = to(states.STATE_QUITTING).result
        whole = bystander.ask(srv.ResetSimulation, "reset_simulation")
        assert whole.result.result == msg.Result.RESULT_OK
        said["stopped"] = state()
        assert to(states.STATE_PLAYING).result == msg.Result.RESULT_OK
        client.close()

    flight = flown(tmp_path, act, 6.0)
    assert flight.outcome.exit_code in (0, 1), flight.log
    unsupported = msg.Result.RESULT_FEATURE_UNSUPPORTED
    for name in "canceled", "forgotten":
        assert said.pop(name).endswith("of 100000 ticks were flown")
    assert all(done + left == 50 for done, left in said.pop("feedback"))
    assert "not paused but running" in said.pop("refused")
    assert said == {
        "steps": True,
        "paused": states.STATE_PAUSED,
        "again": srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE,
        "rests": states.STATE_PAUSED,
        "flies_on": states.STATE_PLAYING,
        "playing": states.STATE_PLAYING,
        "part": unsupported,
        "quitting": unsupported,
        "stopped": states.STATE_STOPPED,
    }
    assert resim(flight.bag).identical
