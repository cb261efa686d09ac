"""Plain values as the request of a service: rclpy itself does not check what it is given."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.ros.messages import stamp

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


def _field(key: str, of: str, value: Any) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if of == "string" and isinstance(value, str) and "\0" not in value:
        return value
    if of == "boolean" and isinstance(value, bool):
        return value
    if of == "double" and number:
        return float(value)
    if of == _TIME and number and isfinite(value) and 0.0 <= value < _LATEST:
        return stamp(float(value))
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
