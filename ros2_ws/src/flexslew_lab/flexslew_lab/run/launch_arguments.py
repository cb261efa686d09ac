"""The arguments of the launch file, checked without ROS."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from flexslew_lab.named import names_in
from flexslew_lab.trial.sources import DEFAULT
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.graph_names import require_name

ARGUMENTS: dict[str, tuple[str, str]] = {  # default and description
    "trial": (DEFAULT, "trial file, or the name of a shipped one"),
    "out": ("", "folder of the run; empty: a new one below runs/"),
    "rate": ("", "instead of the trial's rate_factor; 0 fast, 1 real time"),
    "namespace": ("", "of all nodes, within that of the group; empty: none"),
    "record": ("true", "with the recorder: true or false"),
    "controllers": ("", "comma-separated, instead of the trial's; a law's name works too"),
    "report": ("true", "write metrics.json and report.html after the run: true or false"),
    "shutdown": ("true", "end the whole launch when the run is over: true or false"),
}


class LaunchValues(NamedTuple):
    """The arguments as they are meant."""

    trial: str
    out: Path | None
    rate: float | None
    namespace: str
    record: bool
    controllers: tuple[str, ...]
    report: bool
    shutdown: bool


def launch_values(given: Mapping[str, str]) -> LaunchValues:
    """Return the arguments of a launch; others belong to the file that includes the launch file.

    Args:
        given: text of every argument.

    Raises:
        BadInput: a value that is not allowed.
    """
    if given["namespace"].strip("/"):
        require_name(given["namespace"].strip("/"), "launch: namespace")
    return LaunchValues(
        given["trial"],
        Path(given["out"]) if given["out"] else None,
        _rate(given["rate"]),
        given["namespace"],
        _truth("record", given["record"]),
        tuple(names_in(given["controllers"])),
        _truth("report", given["report"]),
        _truth("shutdown", given["shutdown"]),
    )


def nested_namespace(group: str, namespace: str) -> str:
    """Return the namespace of nodes that a file includes in a group.

    Args:
        group: what PushRosNamespace has made of it; empty: none.
        namespace: of the nodes; an absolute one counts alone, as everywhere in ROS.
    """
    return namespace if namespace.startswith("/") else f"{group}/{namespace}".rstrip("/")


def _rate(text: str) -> float | None:
    if not text:
        return None
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0.0 <= rate < math.inf:
        raise BadInput(f"launch: rate: {text} is not allowed; 0: as fast as possible, 1: real time")
    return rate


def _truth(name: str, text: str) -> bool:
    if text.lower() not in ("true", "false"):
        raise BadInput("true or false", "launch", name, text)
    return text.lower() == "true"
