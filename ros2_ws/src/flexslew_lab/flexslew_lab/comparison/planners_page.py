"""The page of a comparison: one HTML file with table, curves and plans."""

from typing import Any

import numpy as np

from flexslew_lab.comparison.planners import ComparedPlan, Comparison
from flexslew_lab.report.page import render
from flexslew_lab.report.panels import Group, Mark, Panel, legend, style


def comparison_page(comparison: Comparison) -> str:
    """Return the comparison as HTML that needs nothing else."""
    trial = comparison.trial
    plan = comparison.entries[0].plan
    goal = {} if plan is None else dict(zip(plan.joint_names, plan.position[-1], strict=True))
    units = dict(zip(comparison.joint_names, comparison.joint_units, strict=True))
    return render(
        "compare.html.j2",
        title=f"{trial.name}: every method",
        goal=", ".join(f"{name} {at:.4g} {units[name]}" for name, at in goal.items()),
        testbed=f"{trial.testbed.kind}, {trial.testbed.modes} modes, {trial.active} in charge",
        bound=f"{comparison.lower_bound:.3f}",
        durations=durations(comparison),
        columns=columns(comparison),
        rows=[(entry.name, cells(comparison, entry)) for entry in comparison.flown],
        refused=[(entry.name, entry.refused) for entry in comparison.entries if entry.refused],
        colours=[style(k)["color"] for k in range(len(comparison.flown))],
        groups=[robustness(comparison), cost(comparison), motion(comparison)],
    )


def robustness(comparison: Comparison) -> Group:
    """Return the residual tip deflection against stiffness and payload, method by method."""
    panels = []
    for words, payload, curves in (
        ("error of the stiffness", False, [e.by_stiffness for e in comparison.flown]),
        ("error of the payload", True, [e.by_payload for e in comparison.flown]),
    ):
        panel = Panel(f"{words}, residual tip deflection", "m", log=True, height=260)
        panel.x_title = f"{words} [%]"
        for number, (entry, flights) in enumerate(zip(comparison.flown, curves, strict=True)):
            if len(flights) > 1:
                x = np.array([100.0 * (f.payload if payload else f.error) for f in flights])
                y = np.array([f.residual_tip for f in flights])
                panel.line(x, y, entry.name, style(number), mode="lines+markers")
                _widen(panel, y)
        panels.append(panel)
    return Group(
        "Robustness",
        "Residual tip deflection when the bench differs from the planner's model.",
        [panel for panel in panels if panel.traces],
        legend([entry.name for entry in comparison.flown]),
    )


def cost(comparison: Comparison) -> Group:
    """Return the worst residual against the duration, with the rigid-body lower bound."""
    panel = Panel("worst residual tip deflection", "m", log=True, height=280)
    panel.x_title = "duration [s]"
    longest = 1.0
    for number, entry in enumerate(comparison.flown):
        if entry.plan is None or entry.plan.duration <= 0.0:
            continue
        x, y = np.array([entry.plan.duration]), np.array([entry.worst_residual])
        look = {"size": 12, "color": style(number)["color"], "symbol": number}
        panel.line(x, y, entry.name, {}, mode="markers", marker=look)
        _widen(panel, y)
        longest = max(longest, entry.plan.duration)
    panel.x_range = (0.0, 1.06 * longest)
    limit, marks = comparison.limit, []
    if comparison.lower_bound > 0.0:
        at = comparison.lower_bound
        marks.append(Mark("rigid-body lower bound", at, at, "#000"))
    if limit is None:
        x, y = comparison.best_found
        shape = "hv"  # it does for more time, too
        name, words = "best found, not a bound", "The line is the best that was found: no bound."
    else:
        x, y = limit.duration, limit.residual
        shape = "vh"  # a bound for some time is one for less
        name, words = "convex optimum, a bound", "No efforts on 60 pieces can be below the line."
        if limit.least_time is not None:
            at = limit.least_time
            marks.append(Mark("least time to rest, nominal", at, at, "#777"))
    if x.size > 1:
        panel.line(x, y, name, {"color": "#777", "dash": "dot", "shape": shape})
        _widen(panel, y)
    return Group(
        "Cost in time",
        f"The worst residual over all errors of the stiffness against the duration. {words}",
        [panel],
        legend([entry.name for entry in comparison.flown]),
        tuple(marks),
    )


def durations(comparison: Comparison) -> str:
    """Return in words which rows fly at another duration than the first, and the least times."""
    words = []
    if comparison.other_durations and comparison.flown[0].plan is not None:
        own = comparison.flown[0].plan.duration
        words.append(f"NOT AT {own:g} s: {', '.join(comparison.other_durations)}.")
    limit = comparison.limit
    if limit is not None and limit.least_time is not None:
        words.append(
            f"The nominal bench comes to rest in {limit.least_time:.3f} s at least, a rigid body "
            f"in {comparison.lower_bound:.3f} s."
        )
    return " ".join(words)


def motion(comparison: Comparison) -> Group:
    """Return joints, tip deflection and efforts of the nominal flights over time."""
    named = list(zip(comparison.joint_names, comparison.joint_units, strict=True))
    panels = [Panel(name, unit) for name, unit in named]
    panels += [Panel("largest tip deflection", "m")]
    panels += [Panel(f"effort on {name}", "N" if unit == "m" else "N m") for name, unit in named]
    for number, entry in enumerate(comparison.flown):
        flight = entry.nominal
        curves = [*flight.position.T, flight.tip, *flight.applied.T]
        for panel, values in zip(panels, curves, strict=True):
            panel.line(flight.time, values, entry.name, {**style(number), "width": 1.4})
            panel.x_title = "time [s]"
            panel.x_range = (float(flight.time[0]), float(flight.time[-1]))
    names = legend([entry.name for entry in comparison.flown])
    return Group("The flights", "On the nominal bench.", panels, names)


def columns(comparison: Comparison) -> list[str]:
    """Return what the columns of the table hold, with units."""
    linear = all(unit == "m" for unit in comparison.joint_units)
    torque, joint = ("N", "m") if linear else ("N m", "rad")
    named = list(zip(comparison.joint_names, comparison.joint_units, strict=True))
    swings = [f"peak {name} [{unit}]" for name, unit in named]
    swings += [f"overshoot {name} [%]" for name, _ in named]
    efforts = [f"peak effort on {name} [{torque}]" for name in comparison.joint_names]
    errors = []
    for entry in comparison.flown[:1]:
        errors += [f"tip, stiffness {f.error:+.0%} [m]" for f in entry.by_stiffness]
        errors += [f"tip, payload {f.payload:+.0%} [m]" for f in entry.by_payload if f.payload]
    head = ["duration [s]", "over bound", "settled [s]", f"joint error [{joint}]"]
    return [*head, *errors, *swings, *efforts, f"effort [({torque})² s]"]


def cells(comparison: Comparison, entry: ComparedPlan) -> list[str]:
    """Return the numbers of a method, one for each column."""
    assert entry.plan is not None
    nominal = entry.nominal
    duration = entry.plan.duration
    over = f"{duration / comparison.lower_bound:.2f}" if comparison.lower_bound > 0.0 else "-"
    head = [f"{duration:.3f}", over] if duration > 0.0 else ["step", "-"]
    return [
        *head,
        f"{nominal.settling_time:.2f}",
        f"{nominal.residual_joint:.2e}",
        *(f"{flight.residual_tip:.4f}" for flight in entry.by_stiffness),
        *(f"{flight.residual_tip:.4f}" for flight in entry.by_payload if flight.payload),
        *(f"{peak:.3f}" for peak in nominal.peak_position),
        *(f"{100.0 * over:.1f}" if np.isfinite(over) else "-" for over in nominal.overshoot),
        *(f"{peak:.4g}" for peak in nominal.peak_effort),
        f"{nominal.effort:.4g}",
    ]


def short_table(comparison: Comparison) -> tuple[list[str], list[list[Any]]]:
    """Return the columns and rows of a table that fits into a terminal of 80 characters."""
    swings = [f"{name} over [%]" for name in comparison.joint_names]
    head = ["method", "time [s]", "settled [s]", "tip [m]", "worst tip [m]", *swings]
    rows: list[list[Any]] = []
    for entry in comparison.flown:
        assert entry.plan is not None
        nominal = entry.nominal
        rows.append(
            [
                entry.name,
                f"{entry.plan.duration:.2f}" if entry.plan.duration > 0.0 else "step",
                f"{nominal.settling_time:.1f}",
                f"{nominal.residual_tip:.4f}",
                f"{entry.worst_residual:.4f}",
                *(f"{100 * o:.1f}" if np.isfinite(o) else "-" for o in nominal.overshoot),
            ]
        )
    return head, rows


def _widen(panel: Panel, values: Any) -> None:
    """Let the panel show these values, all positive."""
    positive = values[values > 0.0]
    if positive.size:
        low, high = panel.y_range or (np.inf, 0.0)
        panel.y_range = (min(low, float(positive.min())), max(high, float(positive.max())))
