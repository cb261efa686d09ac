"""Fly a trial with ros2 launch: `ros2 launch flexslew_lab trial.launch.py trial:=my_trial.yaml`."""

from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
    TimerAction,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexslew_lab.trial.outputs import new_folder
from flexslew_lab.trial.processes import node_processes, parameter_file
from flexslew_lab.trial.sources import DEFAULT, read_trial
from flexslew_lab.trial.trial import trial_text
from launch import LaunchContext, LaunchDescription

GRACE = 5.0  # for the others to leave by themselves when the plant is gone [s]


def _nodes(context: LaunchContext) -> list[Node]:
    name = LaunchConfiguration("trial").perform(context)
    out = LaunchConfiguration("out").perform(context)
    trial, source = read_trial(name)
    folder = new_folder(trial.name, Path(out) if out else None)
    folder.mkdir(parents=True)
    (folder / "trial.yaml").write_text(trial_text(trial))
    processes = node_processes(trial, folder, record=True, metadata={"trial_file": source})
    parameters = folder / "parameters.yaml"
    parameters.write_text(parameter_file(processes))
    nodes = [
        Node(
            package=process.package,
            executable=process.executable,
            name=process.name,
            parameters=[str(parameters)],
            output="screen",
        )
        for process in processes
    ]
    end = TimerAction(period=GRACE, actions=[EmitEvent(event=Shutdown(reason="the run is over"))])
    plant = nodes[-1]
    return [*nodes, RegisterEventHandler(OnProcessExit(target_action=plant, on_exit=[end]))]


def generate_launch_description() -> LaunchDescription:
    """Return the nodes of the trial that the argument `trial` names."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "trial",
                default_value=DEFAULT,
                description="trial file, or the name of a shipped one",
            ),
            DeclareLaunchArgument("out", default_value="", description="folder of the run"),
            OpaqueFunction(function=_nodes),
        ]
    )
