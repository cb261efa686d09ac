"""The page of a tuning: goal by goal, met or not, and the curves of each over frequency."""

from collections.abc import Iterator

import numpy as np

from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Section, Table, Text, page_of_sections
from flexslew_lab.short_values import in_columns
from flexslew_lab.tuning.closed_loop import ClosedLoop
from flexslew_lab.tuning.norms import h_infinity, stability
from flexslew_lab.tuning.tuned import TunedController
from flexslew_plant.arrays import Vector

GOAL_COLUMNS = ("goal", "before", "after", "met", "worst model", "at [rad/s]")
_POINTS = 400
_DECADES = 4.0  # of the curves, below the highest frequency
_LEAST = 1e-4  # smallest number that is drawn
_HIGHEST = 1e2  # of the frequencies of a continuous loop [rad/s]


def tuning_page(tuned: TunedController, more: list[Section] | None = None) -> str:
    """Return a tuning as HTML that needs nothing else.

    Args:
        tuned: the best controller.
        more: further sections, before the curves.
    """
    settings = tuned.problem.settings
    sections: list[Section] = [
        Table(
            "Goals",
            "Each goal as a number that is at most one where the goal is met, on the model where "
            "it is largest, with the first controller and with the tuned one.",
            GOAL_COLUMNS,
            [list(row) for row in goal_rows(tuned)],
        ),
        Table(
            "Models",
            "The loop of the running law with each plant.",
            ("model", "stable", "disk margin at the efforts"),
            [[name, "yes" if stable else "NO", f"{tuned.margins[name]:.4g}"]
             for name, stable in tuned.stable.items()],
        ),
        _starts(tuned),
        _parameters(tuned),
        *(more or []),
        *_curves(tuned),
    ]  # fmt: skip
    description = f"controller {settings.controller} of {settings.trial}"
    words = tuned.verdict
    return page_of_sections("tuning", settings.tuning, description, sections, words)


def goal_rows(tuned: TunedController) -> list[tuple[str, ...]]:
    """Return a row for each goal, see GOAL_COLUMNS."""
    rows = (
        (
            goal.label + ("" if goal.hard else " (soft)"), goal.before, goal.value,
            "yes" if goal.met else "NO", goal.model,
            goal.frequency if np.isfinite(goal.frequency) else "-",
        )
        for goal in tuned.goals
    )  # fmt: skip
    return [tuple(row) for row in in_columns(rows)]


def _starts(tuned: TunedController) -> Table:
    rows = in_columns(
        (str(one.number), one.hard, one.soft, one.growth, str(one.evaluations))
        for one in tuned.starts
    )
    words = "Largest number of the hard and of the soft goals, and the largest growth rate."
    columns = ("start", "hard", "soft", "growth [1/s]", "evaluations")
    return Table("Starts", words, columns, [list(row) for row in rows])


def _parameters(tuned: TunedController) -> Section:
    structure, x = tuned.problem.structure, np.array(tuned.best.parameters)
    section = structure.section(x)
    if "system" in section:
        parts = [f"{key} = {value}" for key, value in section["system"].items()]
        return Text("Controller", "; ".join(parts))
    before = structure.section(structure.start)
    rows = [[key, str(before[key]), str(value)] for key, value in section.items()]
    return Table("Controller", "", ("key", "before", "after"), rows)


def _curves(tuned: TunedController) -> Iterator[Section]:
    problem, x = tuned.problem, np.array(tuned.best.parameters)
    k = np.real(problem.structure.matrix(x))
    for g, goal in enumerate(problem.goals):
        panel = Panel("number of the goal", "-", log=True, x_title="frequency [rad/s]",
                      x_log=True, height=240, limits=(1.0,))  # fmt: skip
        largest, first = 1.0, True
        for m, label in enumerate(problem.models):
            part, plant = problem.parts[m][g][0]
            loop = plant.closed(k)
            if part.norm is not h_infinity or stability(loop).value >= 0.0:
                continue
            w = _frequencies(loop)
            size = part.scale * np.linalg.norm(loop.at(w), 2, axis=(1, 2))
            largest, first = max(largest, float(size.max())), False
            panel.line(w, np.maximum(size, _LEAST), label, style(m))
        if not first:
            panel.y_range = (1e-2, largest)
            met = "met" if tuned.goals[g].met else "NOT met"
            words = f"The goal is {met}: {tuned.goals[g].words}. Met: no curve exceeds 1."
            yield Group(
                f"{g + 1}. {goal.label}", words, [panel], legend(list(problem.models)),
                key=f"goal-{g + 1}",
            )  # fmt: skip


def _frequencies(loop: ClosedLoop) -> Vector:
    top = np.pi / loop.period if loop.period else _HIGHEST
    grid = np.geomspace(top * 10.0**-_DECADES, top * (1.0 - 1e-9), _POINTS)
    poles = np.linalg.eigvals(loop.parts[0])
    near = abs(np.angle(poles)) / loop.period if loop.period else abs(poles.imag)
    peak = h_infinity(loop).frequency
    return np.unique(np.concatenate((grid, near[(near > grid[0]) & (near < top)],
                                     [peak] if grid[0] < peak < top else [])))  # fmt: skip
