"""The pointing budget of a trial: its sources, their metrics, the total and its margins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

from flexslew_lab.budget.closed_loop import ErrorAxes, ErrorLoop
from flexslew_lab.budget.contribution import (
    Contribution,
    ErrorBound,
    bound_of,
    half_width,
    sum_parts,
)
from flexslew_lab.budget.parts import INTERPRETATIONS, Interpretation
from flexslew_lab.budget.requirements import Margin, margins_of
from flexslew_lab.budget.windows import KNOWLEDGE, METRICS, Windows
from flexslew_lab.guarantee.model.parameters import Vary
from flexslew_lab.short_values import short
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook


@dataclass(frozen=True)
class BudgetRequest:
    """How a budget is made.

    Args:
        controller: by name; None: the active one when the observation begins.
        window: of MPE, RPE and PDE [s]; None: that of the testbed, or 10 s.
        drift: from a window to that with which PDE compares it [s]; None: the next one.
        level: of confidence [-].
        interpretation: see contribution.
        vary: errors of the model, see flown_sources.model_sources.
        require: largest values by metric, or by metric and axis (`APE`, `RPE.x`), [rad or m] or
            with a unit.
    """

    controller: str | None = None
    window: float | None = None
    drift: float | None = None
    level: float = 0.9973
    interpretation: Interpretation = "mixed"
    vary: Vary = field(default_factory=dict)
    require: Mapping[str, float | str] = field(default_factory=dict)

    def check(self) -> None:
        """Check what does not depend on the trial.

        Raises:
            BadInput: if the level or the interpretation is not allowed.
        """
        half_width(self.level)
        if self.interpretation not in INTERPRETATIONS:
            words = f"one of {', '.join(INTERPRETATIONS)}"
            raise BadInput(words, key="--interpretation", value=self.interpretation)


class BudgetRow(NamedTuple):
    """A source, or the total, at the level of confidence."""

    source: str
    kind: str
    about: str  # how it was found
    bounds: Mapping[str, ErrorBound]  # by metric


@dataclass(frozen=True, repr=False)
class Budget:
    """A pointing budget.

    Args:
        trial: its name.
        controller: that closes the loop.
        loop: of the errors.
        windows: that are observed.
        period: one tick [s].
        request: how it was made.
        contributions: of all sources.
        without: sources that the total does not contain, each with its reason.
        left_out: in words, what the linear loop does not contain.
    """

    trial: str
    controller: str
    loop: ErrorLoop
    windows: Windows
    period: float
    request: BudgetRequest
    contributions: tuple[Contribution, ...]
    without: tuple[str, ...]
    left_out: tuple[str, ...]

    def __repr__(self) -> str:
        """Return one line: the trial, the number of sources, the verdict."""
        return f"<Budget of {self.trial}: {len(self.contributions)} sources; {self.verdict}>"

    def _repr_html_(self) -> str:
        """Return the totals, for notebooks."""
        rows = [
            (metric, *(short(v, 4) for v in bound.value))
            for metric, bound in self.total.bounds.items()
        ]
        names = [f"{n} [{u}]" for n, u in zip(self.axes.names, self.axes.units, strict=True)]
        return in_notebook(repr(self), ("total", *names), rows)

    @property
    def axes(self) -> ErrorAxes:
        """The axes of the errors."""
        return self.loop.axes

    @property
    def metrics(self) -> tuple[str, ...]:
        """The metrics that some source has, in their order."""
        found = {name for one in self.contributions for name in one.parts}
        return tuple(m for m in (*METRICS, *KNOWLEDGE.values()) if m in found)

    @cached_property
    def rows(self) -> tuple[BudgetRow, ...]:
        """The sources at the level of confidence."""
        return tuple(
            BudgetRow(c.name, c.kind, c.about, self._bounds([c])) for c in self.contributions
        )

    @cached_property
    def total(self) -> BudgetRow:
        """All sources together."""
        bounds = self._bounds(self.contributions)
        return BudgetRow("total", "total", "see the rules of summation", bounds)

    def _bounds(self, contributions: Sequence[Contribution]) -> dict[str, ErrorBound]:
        """Return the metrics that some of these sources have, all of these together."""
        width = half_width(self.request.level)
        parts = {m: [c.parts[m] for c in contributions if m in c.parts] for m in self.metrics}
        return {
            metric: bound_of(sum_parts(some), self.request.interpretation, width)
            for metric, some in parts.items()
            if some
        }

    @property
    def margins(self) -> tuple[Margin, ...]:
        """The requirements with their margins."""
        return margins_of(self.request.require, self.total.bounds, self.axes)

    @property
    def met(self) -> bool:
        """Whether every requirement is met and no source is missing from the total."""
        return not self.without and all(one.met for one in self.margins)

    @property
    def verdict(self) -> str:
        """The result in a sentence."""
        words = "; ".join(
            f"{metric} {short(float(bound.value.max()), 3)}" if bound.value.size else metric
            for metric, bound in self.total.bounds.items()
        )
        units = set(self.axes.units)
        unit = f" [{units.pop()}]" if len(units) == 1 else ""
        level = f"{100.0 * self.request.level:g} %, {self.request.interpretation}{unit}: {words}"
        if missed := [one.requirement for one in self.margins if not one.met]:
            level += f"; NOT met: {', '.join(missed)}"
        elif self.margins and not self.without:
            level += "; all requirements met"
        if self.without:
            names = ", ".join(text.partition(":")[0] for text in self.without)
            level += f"; WITHOUT {names}, so no requirement counts as met"
        return level

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        w = self.windows
        return {
            "trial": self.trial,
            "controller": self.controller,
            "axes": dict(zip(self.axes.names, self.axes.units, strict=True)),
            "observed": [w.first * self.period, w.last * self.period],
            "window": w.length * self.period,
            "drift": w.apart * w.length * self.period,
            "level": self.request.level,
            "half_width": half_width(self.request.level),
            "interpretation": self.request.interpretation,
            "sources": [_plain_row(row) for row in self.rows],
            "total": _plain_row(self.total),
            "requirements": [one._asdict() for one in self.margins],
            "met": self.met,
            "without": list(self.without),
            "left_out": list(self.left_out),
            "verdict": self.verdict,
        }


def _plain_row(row: BudgetRow) -> dict[str, Any]:
    bounds = {
        metric: {key: value.tolist() for key, value in bound._asdict().items()}
        for metric, bound in row.bounds.items()
    }
    return {"source": row.source, "kind": row.kind, "about": row.about, "metrics": bounds}
