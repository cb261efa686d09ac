"""The processes of a trial over ROS 2: which nodes, with which parameters."""

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from flexslew_lab.trial.own_code import user_code_names
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import (
    SavedPlan,
    Trial,
    bench_settings,
    law_in_charge,
    law_of,
    trial_text,
)
from flexslew_plant.settings import flat, plain
from flexslew_plant.yaml_data import yaml_text


class NodeProcess(NamedTuple):
    """One process, one node."""

    name: str  # of the node
    package: str
    executable: str
    parameters: dict[str, Any]
    namespace: str = ""  # absolute; empty: none

    @property
    def module(self) -> str:
        """What it runs."""
        return f"{self.package}.ros.{self.executable}_node"

    @property
    def remappings(self) -> tuple[tuple[str, str], ...]:
        """What else gets another name: the clock is one per namespace."""
        return (("/clock", "clock"),) if self.namespace else ()


def node_processes(
    trial: Trial,
    folder: Path,
    record: bool,
    metadata: dict[str, str],
    plan: Path | None = None,
    namespace: str = "",
    autostart: bool = True,
) -> list[NodeProcess]:
    """Return the nodes of a trial in the order of their start, the plant last.

    Args:
        trial: trial to fly.
        folder: folder of the run; the bag goes into its subfolder bag.
        record: start the recorder, too.
        metadata: metadata of the run, for the bag.
        plan: file of the trial's plan, if it is made already.
        namespace: namespace of all nodes; empty: none.
        autostart: fly as soon as all nodes are there; else when an operator starts it.
    """
    listeners = ["recorder"] if record else []
    trust = user_code_names(trial)
    processes = []
    if record:
        parameters = {
            "folder": str(folder / "bag"),
            "metadata": json.dumps({"trial": trial_text(trial), **metadata}),
            "exit_with_plant": True,
        }
        processes.append(NodeProcess("recorder", "flexslew_lab", "recorder", parameters))
    has_plan = trial.plan is not None
    if has_plan or not autostart:  # an operator may need to plan
        parameters = {"exit_with_plant": True, "trust": trust}
        if trial.plan is None:
            pass
        elif plan is not None:
            parameters["file"] = str(plan.resolve())
        elif isinstance(trial.plan, SavedPlan):
            parameters["file"] = str(Path(trial.plan.file).resolve())
        else:
            parameters["plan"] = yaml_text(plain(trial.plan))
        charge = law_in_charge(trial)
        parameters |= {"law": charge.law, "law_settings": yaml_text(dict(charge.settings))}
        processes.append(NodeProcess("planner", "flexslew_control", "planner", parameters))
    for name, values in trial.controllers.items():
        law, law_settings = law_of(name, values or {})
        parameters = {
            "law": law,
            "requires_plan": has_plan,
            "wait_for": listeners,
            "exit_with_plant": True,
            "trust": trust,
            **law_settings,
        }
        processes.append(NodeProcess(name, "flexslew_control", "controller", parameters))
    plant = {
        "bench": plain(bench_settings(trial)),
        "rate_factor": trial.rate_factor,
        "answer_timeout": trial.answer_timeout,
        "controllers": list(trial.controllers),
        "wait_for": listeners,
        "display_rate": trial.display_rate,
        "autostart": autostart,
        "exit_when_done": True,
        "progress": True,
    }
    processes.append(NodeProcess("plant", "flexslew_plant", "plant", plant))
    place = "/" + namespace.strip("/") if namespace.strip("/") else ""
    return [process._replace(namespace=place) for process in processes]


def parameter_file(processes: list[NodeProcess]) -> str:
    """Return the ROS parameter file of these nodes."""
    nodes = {
        f"{process.namespace}/{process.name}" if process.namespace else process.name: {
            "ros__parameters": flat(process.parameters)
        }
        for process in processes
    }
    return yaml_text(nodes)


def main() -> None:
    """Write `parameters.yaml` for a user that starts the nodes of a trial one by one.

    The command line holds a shipped trial or a trial file, and the folder of the run.
    """
    name, place = sys.argv[1:]
    folder = Path(place)
    trial, source = read_trial(name)
    processes = node_processes(trial, folder, True, {"trial_file": source})
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "parameters.yaml").write_text(parameter_file(processes))


if __name__ == "__main__":
    main()
