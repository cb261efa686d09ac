"""Requirements on a pointing budget and their margins."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from flexslew_lab.budget.closed_loop import ErrorAxes
from flexslew_lab.budget.contribution import ErrorBound
from flexslew_lab.budget.windows import KNOWLEDGE, METRICS
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import number_in
from flexslew_plant.near_names import spelling_hint

_NAMES = (*METRICS, *KNOWLEDGE.values())


class Margin(NamedTuple):
    """A requirement on an axis.

    Args:
        requirement: metric and axis.
        limit: largest value that is allowed [rad or m].
        value: of the total at the level of confidence [rad or m]; None: it has no such metric.
        margin: limit - value [rad or m].
        share: value / limit [-].
        met: whether the value is known and not above the limit.
    """

    requirement: str
    limit: float
    value: float | None
    margin: float | None
    share: float | None
    met: bool


def requirements_of(assignments: Sequence[str]) -> dict[str, str]:
    """Return `METRIC=limit` or `METRIC.axis=limit` as limits by name.

    Raises:
        BadInput: if there is no `=`, or nothing on a side of it.
    """
    found = {}
    for assignment in assignments:
        name, _, text = (part.strip() for part in assignment.partition("="))
        if not name or not text:
            words = 'give METRIC=limit or METRIC.axis=limit, for example "APE=20 arcsec"'
            raise BadInput(words, "--require", value=assignment)
        found[name] = text
    return found


def margins_of(
    require: Mapping[str, float | str], total: Mapping[str, ErrorBound], axes: ErrorAxes
) -> tuple[Margin, ...]:
    """Return requirements with their margins, axis by axis.

    Args:
        require: limits by name, see BudgetRequest.
        total: by metric.
        axes: of the values.

    Raises:
        BadInput: if a metric, an axis or a limit is not understood.
    """
    found = []
    for name, limit in require.items():
        metric, _, axis = name.partition(".")
        if metric not in _NAMES:
            hint = spelling_hint(metric, _NAMES)
            raise BadInput(f"--require: {name}: no metric; {hint}allowed: {', '.join(_NAMES)}")
        if axis and axis not in axes.names:
            words = f"no axis; allowed: {', '.join(axes.names)}"
            raise BadInput(f"--require: {name}: {words}")
        for k, one in enumerate(axes.names):
            if axis in ("", one):
                given = _limit(name, limit, axes.units[k])
                value = float(total[metric].value[k]) if metric in total else None
                found.append(_margin(f"{metric}.{one}", given, value))
    return tuple(found)


def _limit(name: str, limit: float | str, unit: str) -> float:
    try:
        number: float | str = float(limit)
    except ValueError:
        number = limit
    found = number_in(number, (unit,), f"--require: {name}")
    if not 0.0 < found < float("inf"):
        raise BadInput(f"--require: {name}: give a limit above 0")
    return found


def _margin(name: str, limit: float, value: float | None) -> Margin:
    if value is None:
        return Margin(name, limit, None, None, None, False)
    return Margin(name, limit, value, limit - value, value / limit, value <= limit)
