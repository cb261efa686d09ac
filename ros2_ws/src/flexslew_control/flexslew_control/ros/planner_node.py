"""The `planner` node: plans on request (action `plan_slew`) and what its parameters ask for."""

from time import monotonic
from typing import Any

from flexslew_msgs import action, msg
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle

from flexslew_control.plan import Plan
from flexslew_control.planners import PlanSettings, make_plan
from flexslew_control.ros.plan_message import plan_message
from flexslew_plant import topics
from flexslew_plant.bench.events import Event, Level
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.ros.node import (
    Loop,
    PlantWatch,
    event_message,
    latched,
    new_node,
    run_node,
    settings_of,
)
from flexslew_plant.settings import load_yaml, section, validated

_LOOK = 0.2  # between two looks at the graph [wall s]


@section
class PlannerSettings:
    """The parameters of the node."""

    plan: str = ""  # `plan` section as YAML: planned as soon as the testbed is known; empty: none
    exit_with_plant: bool = False  # end the process when the plant is gone


class _CanceledError(Exception):
    """The client has lost interest."""


class Planner:
    """Publishes plans on `plan`, latched."""

    def __init__(self, loop: Loop) -> None:
        self.node = node = new_node("planner")
        loop.add(node)
        self._settings: PlannerSettings = settings_of(node, PlannerSettings)
        self._time = 0.0
        self._next_look = 0.0
        self._plan = node.create_publisher(msg.Plan, topics.PLAN, latched(1))
        self._events = node.create_publisher(msg.Event, topics.EVENTS, latched(100))
        testbed = node.create_subscription(
            msg.Testbed, topics.TESTBED, self._on_testbed, latched(1)
        )
        self._watch = PlantWatch(loop, testbed, self._settings.exit_with_plant)
        self._server = ActionServer(
            node,
            action.PlanSlew,
            topics.PLAN_SLEW,
            self._execute,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def poll(self) -> float:
        """Look for the plant; return the wall seconds until the next look."""
        now = monotonic()
        if now >= self._next_look:
            self._watch.look()
            self._next_look = now + _LOOK
        return self._next_look - now

    def close(self) -> None:
        """Leave the graph."""
        self._server.destroy()
        self.node.destroy_node()

    def _on_testbed(self, testbed: msg.Testbed) -> None:
        if not self._settings.plan:
            return
        values = load_yaml(self._settings.plan, "parameter plan")
        plan = self._make(values, testbed.period, tuple(testbed.effort_limit), None)
        self._publish(plan)

    def _make(self, values: Any, period: float, limit: tuple[float, ...], progress: Any) -> Plan:
        return make_plan(validated(PlanSettings, values, "plan"), period, limit, progress)

    def _publish(self, plan: Plan) -> None:
        message = plan_message(plan, self._time)
        self._plan.publish(message)
        words = f"{plan.method}: {plan.duration:g} s planned, hash {message.hash[:12]}"
        self._say(Level.INFO, "planned", words, {"hash": message.hash, "method": plan.method})

    def _say(self, level: Level, kind: str, words: str, data: dict[str, Any]) -> None:
        event = Event(0, self._time, 0, level, "planner", kind, words, data)
        self._events.publish(event_message(event))
        self.node.get_logger().info(words)

    def _execute(self, goal: ServerGoalHandle) -> action.PlanSlew.Result:
        result = action.PlanSlew.Result()

        def progress(iteration: Any) -> None:
            if goal.is_cancel_requested:
                raise _CanceledError
            goal.publish_feedback(
                action.PlanSlew.Feedback(
                    iteration=iteration.number,
                    objective=iteration.objective,
                    norm_terminal_error=iteration.norm_terminal_error,
                    norm_input=iteration.norm_input,
                )
            )

        request = goal.request
        try:
            values = load_yaml(request.request, "request")
            plan = self._make(values, request.period, tuple(request.effort_limit), progress)
        except _CanceledError:
            result.error_code, result.message = result.CANCELED, "canceled by the client"
            goal.canceled()
        except (BadInput, PlanFailed) as error:
            bad = isinstance(error, BadInput)
            result.error_code = result.BAD_INPUT if bad else result.FAILED
            result.message = str(error)
            goal.abort()
        else:
            result.plan = plan_message(plan, self._time)
            self._publish(plan)
            goal.succeed()
        return result


def main() -> None:
    """Run the node until it is interrupted."""
    run_node(Planner)


if __name__ == "__main__":
    main()
