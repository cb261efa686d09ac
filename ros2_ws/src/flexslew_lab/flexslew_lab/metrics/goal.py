"""Whether a run has reached the goal of its manoeuvre, in words for a person."""

from collections.abc import Mapping
from typing import Any


def goal_error_message(
    metrics: Mapping[str, Any], tolerance: float, units: Mapping[str, str]
) -> str:
    """Return by how much a run has missed its goal; empty where it has not, or had none.

    Args:
        metrics: content of metrics.json.
        tolerance: `goal_tolerance` of the trial [-].
        units: of the joints, as far as they are known.
    """
    error = metrics.get("goal_error")
    if error is None or error <= tolerance:
        return ""
    final_errors = metrics.get("final_error") or {}
    each = ", ".join(with_unit(name, value, units) for name, value in final_errors.items() if value)
    return (
        f"goal missed by {100.0 * error:.3g} % of the commanded move "
        f"(goal_tolerance {100.0 * tolerance:g} %); final error: {each}"
    )


def with_unit(joint: str, value: float, units: Mapping[str, str]) -> str:
    """Return the name of a joint, a value in three digits, and its unit where that is known."""
    return f"{joint} {value:.3g} {units.get(joint, '')}".rstrip()
