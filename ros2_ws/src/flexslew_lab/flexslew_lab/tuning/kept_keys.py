"""The keys of a controller that stay where a law `linear` takes its place."""

from collections.abc import Mapping
from typing import Any

from flexslew_control.controllers import CONTROLLERS, LINEAR
from flexslew_lab.trial.trial import law_of

_OF_SYSTEM = ("system", "file", "method", "prewarping")
_HANDOVER = "handover_time"


def kept_section(name: str, values: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the keys of a section that a tuned system does not replace.

    Of another law they are those of its axes, where `linear` has the same: allocation, attitude and
    gyroscopic torque.

    Args:
        name: of the controller.
        values: its section.
    """
    law, given = law_of(name, dict(values or {}))
    if law == LINEAR.name:
        return {key: value for key, value in given.items() if key not in _OF_SYSTEM}
    if law not in CONTROLLERS or CONTROLLERS[law].of_testbed != LINEAR.of_testbed:
        return {}
    return {k: v for k, v in given.items() if k in (*LINEAR.of_testbed, _HANDOVER)}
