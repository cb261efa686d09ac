"""The page of a budget: its tables for a review, and bars by source."""

from flexslew_lab.budget.budget import Budget
from flexslew_lab.budget.prove import ProvedBudget
from flexslew_lab.budget.tables import (
    MARGIN_COLUMNS,
    PROVED_COLUMNS,
    budget_columns,
    budget_rows,
    margin_rows,
    proved_rows,
)
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Section, Table, Text, page_of_sections

_MEANING = {
    "mixed": "the share of all times of all members of the ensemble",
    "temporal": "the share of the time in a member whose constants are at that level",
    "ensemble": "the share of members, at the worst time of all",
}


def budget_page(budget: Budget, proof: ProvedBudget | None = None) -> str:
    """Return a budget as HTML that needs nothing else.

    Args:
        budget: of a trial.
        proof: its flights, or None.
    """
    w, request = budget.windows, budget.request
    length = w.length * budget.period
    description = (
        f"{budget.controller}, from {w.first * budget.period:g} s to {w.last * budget.period:g} s; "
        f"{100.0 * request.level:g} % is {_MEANING[request.interpretation]}; windows of "
        f"{length:g} s, drift over {w.apart * length:g} s"
    )
    sections: list[Section] = [
        Text("Without", "; ".join(budget.without), "bad"),
        Table(
            "Requirements", "Limit less value of the total.", MARGIN_COLUMNS, margin_rows(budget)
        ),
        *_proved(proof),
        Table(
            "Budget",
            "Errors of one run add with their signs, variances of independent sources add: so the "
            "total is not the sum of the rows.",
            budget_columns(budget),
            budget_rows(budget),
        ),
        bars(budget),
        Table(
            "Sources",
            "How each was found.",
            ("source", "kind", "found by"),
            [(row.source, row.kind, row.about) for row in budget.rows],
        ),
        Table("Left out", "", ("part of the bench",), [(words,) for words in budget.left_out]),
    ]
    return page_of_sections("budget", f"{budget.trial}: pointing budget", description, sections,
                            budget.verdict)  # fmt: skip


def _proved(proof: ProvedBudget | None) -> list[Section]:
    if proof is None:
        return []
    words = (
        f"{proof.members} flights of the bench, root mean squares. Inside: share of points that "
        "the total bounds."
    )
    return [Table("Flown", words, PROVED_COLUMNS, proved_rows(proof))]


def bars(budget: Budget) -> Group:
    """Return bars of the values by source, a panel for each metric."""
    panels, units = [], dict.fromkeys(budget.axes.units)
    for metric in budget.metrics:
        rows = [row for row in (*budget.rows, budget.total) if metric in row.bounds]
        largest = max((float(row.bounds[metric].value.max()) for row in rows), default=0.0)
        panel = Panel(metric, " or ".join(units), height=300, y_range=(0.0, 1.05 * largest or 1.0))
        names = [row.source for row in rows]
        for k, axis in enumerate(budget.axes.names):
            values = [float(row.bounds[metric].value[k]) for row in rows]
            colour = {"color": style(k)["color"]}
            panel.traces.append(
                {"type": "bar", "x": names, "y": values, "name": axis, "marker": colour}
            )
        panels.append(panel)
    words = "Values at the level of confidence, by axis."
    return Group("By source", words, panels, legend(budget.axes.names), side_by_side=True)
