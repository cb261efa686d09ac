"""The verdict on a run or a plan in one sentence, made of its numbers."""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.metrics.goal import goal_error_message, with_unit
from flexslew_lab.metrics.platform.keep_out import cone_violations
from flexslew_plant.counted import count_text

_SAME = 1.05  # ratios of the vibration below this are called equal
_BELOW = "no effort at its limit"
_ROUNDING = 1e-9  # tip deflections below this are rounding [m]


def run_summary(
    metrics: Mapping[str, Any],
    bare: Mapping[str, Any],
    tolerance: float,
    changes: int = 0,
    units: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return what a user should read first of a run, worst news before good ones.

    Args:
        metrics: content of metrics.json.
        bare: content of metrics.json of the run without feedforward; empty without one.
        tolerance: `goal_tolerance` of the trial [-].
        changes: number of changes by an operator; a changed run is compared with nothing.
        units: units of the joints; unknown ones are left out.
    """
    parts = [
        goal_error_message(metrics, tolerance, units),
        cone_violations(metrics),
        f"changed by an operator {_times(changes)}" if changes else "",
        _vibration(metrics, {} if changes else bare)
        if _has_deflection(metrics)
        else _tracking_errors(metrics, units),
        _settling_text(metrics),
        *_limits(metrics),
    ]
    return "; ".join(part for part in parts if part)


def plan_verdict(plan: Plan, limits: Sequence[float]) -> str:
    """Return what a plan is expected to do, and how much of the drives it takes.

    Args:
        plan: with its summary.
        limits: of the drives, one per joint [N m or N].
    """
    summary = plan.summary
    tip = summary.get("predicted_residual_tip_deflection")
    peak = np.abs(plan.effort).max(axis=0, initial=0.0)
    shares = dict(zip(plan.joint_names, (peak / np.asarray(limits)).tolist(), strict=True))
    most = max(shares, key=lambda name: shares[name])
    parts = (
        "the planner has not converged" if summary.get("converged") is False else "",
        "" if tip is None else f"predicted tip deflection after the manoeuvre: {tip:.3g} m",
        f"{plan.duration:.4g} s long" if plan.duration else "a step",
        f"at most {100.0 * shares[most]:.3g} % of the limit of {most}"
        if shares[most]
        else "no feedforward",
        model_difference(summary),
    )
    return "; ".join(part for part in parts if part)


def model_difference(summary: Any) -> str:
    """Return in what the plan's model differs from what it is flown on; empty: in nothing."""
    words = summary.get("believes", "") if isinstance(summary, Mapping) else ""
    return f"planned on a model with {words}" if words else ""


def joints_to_move(metrics: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the joints with a commanded move, in the bench's order; all where none has one.

    Args:
        metrics: content of metrics.json: the overshoot is null for a joint that has no move.
    """
    return _commanded(metrics) or tuple(metrics.get("overshoot") or {})


def _commanded(metrics: Mapping[str, Any]) -> tuple[str, ...]:
    overshoot = metrics.get("overshoot") or {}
    return tuple(name for name, value in overshoot.items() if value is not None)


def _vibration(metrics: Mapping[str, Any], bare: Mapping[str, Any]) -> str:
    left, without = metrics.get("residual_tip_deflection"), bare.get("residual_tip_deflection")
    if left is None:
        peak = _largest(metrics.get("peak_tip_deflection"))
        prefix = "" if peak is None else f"tip deflection up to {peak:.3g} m; "
        return f"{prefix}the manoeuvre was not completed"
    final_errors = metrics.get("final_error") or {}
    if final_errors and all(error is None for error in final_errors.values()):  # it has no goal
        return f"tip deflection up to {left:.3g} m"
    if without is None or max(left, without) < _ROUNDING:
        return f"tip deflection after the manoeuvre: {left:.3g} m"
    return f"{_comparison(left, without)} without feedforward ({left:.3g} m, not {without:.3g} m)"


def _has_deflection(metrics: Mapping[str, Any]) -> bool:
    """Return whether any tip has moved at all: not on a bench without tips, or a rigid one."""
    return metrics.get("residual_tip_deflection") != 0.0 or bool(
        _largest(metrics.get("peak_tip_deflection"))
    )


def _tracking_errors(metrics: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """Return the largest error after the manoeuvre, of joints with a commanded move, or of all."""
    errors = metrics.get("residual_attitude_error") or {}
    known = {name: abs(errors[name]) for name in joints_to_move(metrics) if errors.get(name)}
    if not known:
        return ""
    largest = max(known, key=lambda name: known[name])
    return f"largest error after the manoeuvre: {with_unit(largest, known[largest], units)}"


def _largest(deflection: float | Mapping[str, float] | None) -> float | None:
    """Return the largest deflection where a platform that points has one by appendage."""
    if isinstance(deflection, Mapping):
        return max(deflection.values(), default=None)
    return deflection


def _comparison(left: float, without: float) -> str:
    """Return by how much a run rings less or more than another."""
    if max(left, without) < _SAME * min(left, without):
        return "as much ringing as"
    if left < without:
        return f"{_ratio(without, left)} less ringing than"
    return f"{_ratio(left, without)} more ringing than"


def _ratio(large: float, small: float) -> str:
    return f"{large / small:,.3g} times" if large < 1000.0 * small else "over 1000 times"


def _settling_text(metrics: Mapping[str, Any]) -> str:
    """Return the settling time of the last joint with a commanded move."""
    times, joints = metrics.get("settling_time") or {}, _commanded(metrics)
    if not joints:
        return ""
    late = [name for name in joints if times.get(name) is None]
    if late:
        return f"not settled: {_name_list(late)}"
    begin = metrics.get("manoeuvre_start") or 0.0
    return f"settled at {_seconds(begin + max(times[name] for name in joints))}"


def _limits(metrics: Mapping[str, Any]) -> Iterator[str]:
    """Yield which drives acted, whether at their limits, and the faults of the bench."""
    active = [name for name, peak in (metrics.get("peak_effort") or {}).items() if peak]
    if active:
        yield f"driven by {_name_list(active)}"
    saturated = metrics.get("saturated_time")
    if saturated is not None:
        yield f"efforts at their limit for {_seconds(saturated)}" if saturated else _BELOW
    for key, one, many in (
        ("missed_ticks", "tick without an answer", "ticks without an answer"),
        ("faults", "fault", "faults"),
        ("fallbacks", "fallback", "fallbacks"),
    ):
        if count := metrics.get(key):
            yield count_text(count, one, many)


def _seconds(time: float) -> str:
    return f"{time:.3g} s" if time < 999.5 else f"{time:.0f} s"


def _name_list(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
