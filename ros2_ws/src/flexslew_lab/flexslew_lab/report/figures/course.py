"""The course of a manoeuvre: joints, tips and efforts over time, as flown and as planned."""

from collections.abc import Sequence

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.report.figures.drawing import (
    REFERENCE,
    TIME,
    appendages_of,
    draw,
    effort_unit,
    efforts_of,
    excluded_joints,
    joints_of,
    marks,
    over,
    span_of,
)
from flexslew_lab.report.panels import (
    DISTURBANCE,
    LINE,
    Entry,
    Group,
    Panel,
    legend,
    style,
)
from flexslew_lab.report.run_data import RunData
from flexslew_plant.arrays import Vector

_FORCED = {"color": DISTURBANCE, "width": 1.3}


def manoeuvre(runs: Sequence[RunData]) -> Group:
    """Return joints with their reference, tips and efforts; several runs over one another."""
    group = Group(
        "The manoeuvre",
        "Joint positions with their reference, tip deflections, and the efforts that the drives "
        "applied, with the plan's feedforward and the drives' limits." + excluded_joints(runs),
        [*_motion(runs), *_efforts(runs)],
        (
            *legend([run.label for run in runs]),
            Entry("reference", LINE, "dot"),
            Entry("feedforward", LINE, "dash"),
            Entry("disturbance", DISTURBANCE),
        ),
        marks(runs),
    )
    return over(group, span_of(runs))


def feedforward_comparison(runs: Sequence[RunData]) -> Group:
    """Return joints and tips of a run with and without feedforward."""
    group = Group(
        "With and without feedforward",
        "The same trial flown by feedback alone: the difference is what the plan is worth.",
        _motion(runs),
        (*legend([run.label for run in runs]), Entry("reference", LINE, "dot")),
        marks(runs[:1]),
    )
    return over(group, span_of(runs))


def plan_profile(plan: Plan, units: Sequence[str], limits: Sequence[float]) -> Group:
    """Return the reference and the feedforward of a plan, joint by joint.

    Args:
        plan: what to draw.
        units: of the joints, rad or m.
        limits: of the drives, one per joint [N m or N].
    """
    time: Vector = np.asarray(plan.start + plan.period * np.arange(plan.ticks + 1), dtype=float)
    panels = []
    for k, (name, unit) in enumerate(zip(plan.joint_names, units, strict=True)):
        panel = Panel(f"{name}, position", unit, x_title=TIME)
        panel.line(time, plan.position[:, k], "reference", style(0))
        panels.append(panel)
        panel = Panel(f"{name}, velocity", f"{unit}/s", x_title=TIME)
        panel.line(time, plan.velocity[:, k], "reference", style(0))
        panels.append(panel)
    for k, (name, unit) in enumerate(zip(plan.joint_names, units, strict=True)):
        effort = plan.effort[:, k]
        peak = float(np.abs(effort).max(initial=0.0))
        panel = _with_limit(f"effort on {name}", effort_unit(unit), peak, limits[k])
        step_style = {"color": style(1)["color"], "shape": "hv"}
        panel.line(time, np.append(effort, effort[-1:]), "feedforward", step_style)
        panels.append(panel)
    words = f"{plan.method}, {plan.duration:g} s from {plan.start:g} s on."
    group = Group("The plan", words, panels, legend(["reference", "feedforward"]))
    return over(group, (float(time[0]), float(time[-1])))


def _motion(runs: Sequence[RunData]) -> list[Panel]:
    """Return one panel per joint, with its reference, and one per appendage."""
    panels = []
    for name, unit in joints_of(runs):
        panel = Panel(name, unit, x_title=TIME)
        available = [(k, run) for k, run in enumerate(runs) if name in run.joint_names]
        for number, run in available:
            at = run.joint_names.index(name)
            draw(panel, run.traces.get("position"), at, run.label, style(number))
        run = available[0][1]
        at = run.joint_names.index(name)
        draw(panel, run.traces.get("reference"), at, "reference", REFERENCE)
        panels.append(panel)
    for name in appendages_of(runs):
        panel = Panel(f"tip deflection of {name}", "m", x_title=TIME)
        for number, run in enumerate(runs):
            if name in run.appendage_names:
                at = run.appendage_names.index(name)
                draw(panel, run.traces.get("tip"), at, run.label, style(number))
        panels.append(panel)
    return panels


def _efforts(runs: Sequence[RunData]) -> list[Panel]:
    """Return one panel per drive, with feedforward, disturbance and limits."""
    panels = []
    actuator_units = dict.fromkeys(pair for run in runs for pair in efforts_of(run))
    joints = {name for run in runs for name in run.joint_names}
    order = {name: k for k, (name, _) in enumerate(joints_of(runs))}
    visible = [pair for pair in actuator_units if pair[0] in order or pair[0] not in joints]
    for name, unit in sorted(visible, key=lambda pair: order.get(pair[0], len(order))):
        available = [(k, run) for k, run in enumerate(runs) if (name, unit) in efforts_of(run)]
        first = available[0][1]
        column = efforts_of(first).index((name, unit))
        testbed = first.overview.testbed
        known = testbed is not None and len(testbed.effort_limit) > column
        limit = float(testbed.effort_limit[column]) if known else np.inf
        efforts = [run.traces["effort"].value[:, efforts_of(run).index((name, unit))]
                   for _, run in available]  # fmt: skip
        peak = max(float(np.nanmax(np.abs(effort), initial=0.0)) for effort in efforts)
        panel = _with_limit(f"effort on {name}", unit, peak, limit)
        for number, run in available:
            index = efforts_of(run).index((name, unit))
            draw(panel, run.traces["effort"], index, run.label, style(number))
        line_style = {"color": LINE, "width": 1.2, "dash": "dash"}
        draw(panel, first.traces.get("feedforward"), column, "feedforward", line_style)
        forced = first.traces.get("disturbance")
        draw(panel, forced, column, "disturbance", _FORCED, nonzero=True)
        panels.append(panel)
    return panels


def _with_limit(title: str, unit: str, peak: float, limit: float) -> Panel:
    """Return a panel of an effort that names its limit, and shows it where efforts come near."""
    if not np.isfinite(limit):
        return Panel(title, unit, x_title=TIME)
    panel = Panel(f"{title}, limit ±{limit:g} {unit}", unit, x_title=TIME)
    if peak > 0.15 * limit:
        panel.limits = (-limit, limit)
        panel.y_range = (-1.06 * max(limit, peak), 1.06 * max(limit, peak))
    return panel
