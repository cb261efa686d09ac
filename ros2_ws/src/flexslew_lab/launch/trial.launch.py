"""Fly a trial with ros2 launch: `ros2 launch flexslew_lab trial.launch.py trial:=my_trial.yaml`."""

from dataclasses import replace
from typing import Any

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    TimerAction,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexslew_lab.run.launch_arguments import (
    ARGUMENTS,
    LaunchValues,
    launch_values,
    nested_namespace,
)
from flexslew_lab.run.processes import node_processes, parameter_file
from flexslew_lab.run.run_trial import finished
from flexslew_lab.trial.outputs import new_folder
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import build_controllers, trial_text
from flexslew_plant.errors import FlexslewError
from launch import LaunchContext, LaunchDescription

GRACE = 5.0  # for the others to leave by themselves when plant and recorder are gone [s]


def _nodes(context: LaunchContext) -> list[Any]:
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    values = launch_values(given)
    trial, source = read_trial(values.trial)
    if values.rate is not None:
        trial = replace(trial, rate_factor=values.rate)
    if values.controllers:
        selected = {name: trial.controllers.get(name, {}) for name in values.controllers}
        active = trial.active if trial.active in selected else values.controllers[0]
        trial = replace(trial, controllers=selected, active=active)
    build_controllers(trial, source)  # else their nodes end, and the plant waits for them
    folder = new_folder(trial.name, values.out)
    folder.mkdir(parents=True)
    (folder / "trial.yaml").write_text(trial_text(trial))
    namespace = nested_namespace(
        context.launch_configurations.get("ros_namespace", ""), values.namespace
    )
    processes = node_processes(
        trial, folder, values.record, {"trial_file": source}, namespace=namespace
    )
    parameters = folder / "parameters.yaml"
    parameters.write_text(parameter_file(processes))
    nodes = [
        Node(
            package=process.package,
            executable=process.executable,
            name=process.name,
            namespace=process.namespace or None,
            remappings=list(process.remappings),
            parameters=[str(parameters)],
            output="screen",
        )
        for process in processes
    ]

    def finish(_: LaunchContext) -> list[Any]:
        log_actions: list[Any] = []
        try:
            if values.record:
                finished(folder, trial.trust, report=values.report)
        except FlexslewError as error:
            if values.shutdown:
                raise
            log_actions = [LogInfo(msg=f"error: {error}")]  # what else was launched goes on
        if not values.shutdown:
            return log_actions
        return [EmitEvent(event=Shutdown(reason=f"the run is over: {folder}"))]

    recorder, plant = nodes[0], nodes[-1]
    end = TimerAction(period=GRACE, actions=[OpaqueFunction(function=finish)])

    def over(*_: Any) -> list[Any]:
        if values.record and recorder.return_code is None:  # it still writes
            return [RegisterEventHandler(OnProcessExit(target_action=recorder, on_exit=[end]))]
        return [end]

    return [*nodes, RegisterEventHandler(OnProcessExit(target_action=plant, on_exit=over))]


def generate_launch_description() -> LaunchDescription:
    """Return the nodes of the trial that the argument `trial` names."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=words)
                for name, (default, words) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


__all__ = ["LaunchValues", "generate_launch_description"]
