"""The services of a bench, and plain values as their requests: rclpy does not check them.

Only messages are imported here: a command that operates a bench starts in a moment.
"""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from builtin_interfaces.msg import Time
from flexslew_msgs import srv

from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

SERVICES: dict[str, Any] = {  # that answer ok and a message
    topics.OPERATE: srv.Operate,
    topics.STEP: srv.Step,
    topics.SET_RATE: srv.SetRate,
    topics.NOTE: srv.Note,
    topics.SWITCH_CONTROLLER: srv.SwitchController,
    topics.INJECT_FAULT: srv.InjectFault,
    topics.END_FAULT: srv.EndFault,
    topics.DECIDE_PLAN: srv.Operate,
    topics.RETARGET: srv.Retarget,
}
_LATEST = 1e9  # of a simulated time [s]
_TIME = "builtin_interfaces/Time"


def request_of(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return the request of a service with these fields; the others keep their defaults.

    Args:
        kind: the class of the request, or of an action's goal.
        values: by field; a time in seconds.

    Raises:
        BadInput: an unknown field, or a value that is not of its type.
    """
    known = kind.get_fields_and_field_types()
    fields = {}
    for key, value in values.items():
        if key not in known:
            raise BadInput(f"{key!r:.40}: unknown; allowed: {', '.join(known)}")
        fields[key] = _field(key, known[key], value)
    return kind(**fields)


def is_accepted(response: Any) -> bool:
    """Return whether a service has granted a request, or will at its time."""
    return bool(response.ok or getattr(response, "scheduled", False))


def _field(key: str, of: str, value: Any) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if of == "string" and isinstance(value, str) and "\0" not in value:
        return value
    if of == "boolean" and isinstance(value, bool):
        return value
    if of == "double" and number:
        return float(value)
    if of == _TIME and number and isfinite(value) and 0.0 <= value < _LATEST:
        seconds, nanoseconds = divmod(round(value * 1e9), 10**9)
        return Time(sec=seconds, nanosec=nanoseconds)
    if (
        of.startswith("uint")
        and number
        and isfinite(value)
        and value == int(value)
        and 0 <= value < 2 ** int(of[4:])
    ):
        return int(value)
    if of == "sequence<double>" and isinstance(value, list):
        return [_field(f"{key}.{k}", "double", one) for k, one in enumerate(value)]
    allowed = "a time in seconds, at least 0, below 1e9" if of == _TIME else f"of type {of}"
    raise BadInput(allowed, key=key, value=value)
