"""The trial of a log that names none, from nodes that were started one by one."""

from typing import Any

from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_plant.yaml_data import yaml_text

_OF_PLANT = ("rate_factor", "answer_timeout", "display_rate")  # next to those of the bench
_FAULTS_BEFORE = "faults_enabled"  # how logs of before name allow_faults


def trial_from_messages(testbed: Any, statuses: dict[str, Any], end: float, source: str) -> str:
    """Return the trial that testbed and statuses of a log describe, as YAML; "" where they do not.

    The plan is no part of this trial: the log gives each plan and the tick at which it was taken.

    Args:
        testbed: flexslew_msgs/Testbed, or None.
        statuses: the last flexslew_msgs/ControllerStatus of each controller.
        end: of the log [s], for a run without an end of its own.
        source: the log, for an error.
    """
    if testbed is None or not statuses:
        return ""
    given = logged_yaml(testbed.settings, f"{source}: /testbed")
    bench = dict(given.get("bench", given))
    if _FAULTS_BEFORE in bench:
        bench["allow_faults"] = bench.pop(_FAULTS_BEFORE)
    bench["duration"] = bench.get("duration") or end + testbed.period
    controllers = {name: {"law": status.law} for name, status in statuses.items()}
    plant = {key: given[key] for key in _OF_PLANT if key in given}
    return yaml_text({"name": "unnamed", **bench, **plant, "controllers": controllers})
