"""The best candidate of a comparison by each criterion, by how much, and on how many benches."""

from typing import NamedTuple

import numpy as np

from flexslew_lab.comparison.comparison import CandidateFlight, Comparison, Entries
from flexslew_lab.comparison.quantities import ComparisonMetric
from flexslew_lab.report.sections import Table
from flexslew_lab.short_values import short

_EQUAL = 1.05  # ratio below which two candidates are equal [-]
_WORDS = (
    "The least number wins. A flight is repeatable to the last bit, so a difference is no chance; "
    "it counts for more where the winner is also first on the benches with model errors. "
    "Candidates within 5 % of each other are equal."
)


class Winner(NamedTuple):
    """The best candidate by one criterion."""

    criterion: ComparisonMetric
    name: str
    value: float  # on the nominal bench
    second: str
    second_value: float
    first_on: int  # benches on which nobody has less
    benches: int

    @property
    def is_clear(self) -> bool:
        """Whether it is ahead by more than 5 %."""
        return self.second_value > _EQUAL * self.value


def winners(found: Comparison) -> list[Winner]:
    """Return the winner of each criterion by which two candidates or more can be ranked.

    A candidate that lacks a number that others have, such as one that never settles, wins nothing
    where two others or more have all of them.
    """
    ranked, entries = _criteria(found), _ranked(found)
    won = []
    for criterion in ranked:
        values = np.array([[_value(criterion, f) for f in entry.flights] for entry in entries])
        nominal = np.array([_value(criterion, entry.nominal) for entry in entries])
        if np.isfinite(nominal).sum() < 2:
            continue
        first, second = np.argsort(nominal, kind="stable")[:2]
        first_on = int((values[first] <= values.min(axis=0)).sum())
        names = entries[first].name, entries[second].name
        won.append(
            Winner(criterion, names[0], float(nominal[first]), names[1], float(nominal[second]),
                   first_on, values.shape[1])
        )  # fmt: skip
    return won


def verdict(found: Comparison) -> str:
    """Return the winners in one sentence."""
    won = winners(found)
    if not won:
        return f"{len(found.simulated_entries)} of {len(found.entries)} flew: nobody to compare"
    unfinished = len(found.simulated_entries) - len(_ranked(found))
    parts = [
        f"{w.criterion.title}: {w.name}" + ("" if w.is_clear else f" or {w.second}, within 5 %")
        for w in won
    ]
    more = f"; {unfinished} left out that never settled or do not control" if unfinished else ""
    return f"least by {'; '.join(parts)}{more}"


def winner_table(found: Comparison) -> Table:
    """Return the winners with their lead."""
    rows = [
        (
            f"{w.criterion.title} [{w.criterion.unit}]",
            w.name,
            short(w.value, 3),
            w.second,
            short(w.second_value, 3),
            f"{w.second_value / w.value:.3g} times" if w.is_clear else "equal",
            f"{w.first_on} of {w.benches}",
        )
        for w in winners(found)
    ]  # fmt: skip
    columns = ("criterion", "winner", "has", "next", "has", "ahead by", "first on benches")
    return Table("Winners", _WORDS, columns, rows)


def _criteria(found: Comparison) -> list[ComparisonMetric]:
    """Return the criteria by which any candidate has a number."""
    flights = [entry.nominal for entry in found.simulated_entries]
    return [c for c in found.criteria if any(np.isfinite(_value(c, f)) for f in flights)]


def _ranked(found: Comparison) -> Entries:
    """Return the candidates with a number for every criterion; all where fewer than two have."""
    criteria, entries = _criteria(found), found.simulated_entries
    complete = [
        entry for entry in entries if all(np.isfinite(_value(c, entry.nominal)) for c in criteria)
    ]
    return tuple(complete) if len(complete) > 1 else entries


def _value(criterion: ComparisonMetric, flight: CandidateFlight) -> float:
    """Return the number of a flight; infinite where it has none, or the bench was lost.

    Exactly zero is the effort of a candidate that does not control, or a bench without tips: it
    ranks nobody.
    """
    value = None if flight.lost else criterion.of(flight.metrics)
    return float(value) if value else np.inf
