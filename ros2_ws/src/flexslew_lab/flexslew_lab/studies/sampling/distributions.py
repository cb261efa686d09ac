"""How a varied value is spread: families of distributions, each from a list of numbers in YAML."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint


@dataclass(frozen=True)
class Distribution:
    """A spread of values; see FAMILIES for its families.

    Args:
        family: a key of FAMILIES.
        numbers: its arguments as the file gives them.
    """

    family: str
    numbers: tuple[Any, ...]

    def at(self, unit: Vector) -> NDArray[Any]:
        """Return the values at points of the unit interval, shape (n,): the inverse of the CDF."""
        return FAMILIES[self.family].at(self.numbers, unit)

    def levels(self, count: int) -> NDArray[Any]:
        """Return `count` values for a grid, ends included where there are any; all of a choice."""
        if self.family == "choice":
            return np.array(self.numbers)
        ends = self.family in ("uniform", "loguniform", "triangular")
        unit = np.linspace(0.0, 1.0, count) if ends else (np.arange(count) + 0.5) / count
        return self.at(unit)


class _Family(NamedTuple):
    arguments: str  # as the file gives them
    length: int  # how many; 0: any number
    at: Callable[[Sequence[Any], Vector], NDArray[Any]]
    spread: Callable[[Sequence[Any]], bool]  # whether the arguments make a distribution


def _choice(values: Sequence[Any], unit: Vector) -> NDArray[Any]:
    pick = np.minimum((unit * len(values)).astype(int), len(values) - 1)
    selected: NDArray[Any] = np.array(values)[pick]
    return selected


def _truncated(a: Sequence[float], unit: Vector) -> NDArray[Any]:
    mean, sigma, low, high = a
    frozen = stats.truncnorm((low - mean) / sigma, (high - mean) / sigma, loc=mean, scale=sigma)
    return np.asarray(frozen.ppf(unit))


def _triangular(a: Sequence[float], unit: Vector) -> NDArray[Any]:
    low, mode, high = a
    frozen = stats.triang((mode - low) / (high - low), loc=low, scale=high - low)
    return np.asarray(frozen.ppf(unit))


FAMILIES: dict[str, _Family] = {
    "uniform": _Family(
        "[low, high]",
        2,
        lambda a, u: np.asarray(stats.uniform(a[0], a[1] - a[0]).ppf(u)),
        lambda a: a[0] < a[1],
    ),
    "loguniform": _Family(
        "[low, high], both above 0",
        2,
        lambda a, u: np.asarray(stats.loguniform(a[0], a[1]).ppf(u)),
        lambda a: 0.0 < a[0] < a[1],
    ),
    "normal": _Family(
        "[mean, sigma]",
        2,
        lambda a, u: np.asarray(stats.norm(a[0], a[1]).ppf(u)),
        lambda a: a[1] > 0.0,
    ),
    "truncated_normal": _Family(
        "[mean, sigma, low, high]", 4, _truncated, lambda a: a[1] > 0.0 and a[2] < a[3]
    ),
    "triangular": _Family(
        "[low, mode, high]", 3, _triangular, lambda a: a[0] <= a[1] <= a[2] and a[0] < a[2]
    ),
    "choice": _Family(
        "two or more values", 0, _choice, lambda a: len(set(map(repr, a))) == len(a) > 1
    ),
}


def distribution_of(values: Any, place: str, others: tuple[str, ...] = ()) -> Distribution:
    """Return the distribution of `{family: [numbers]}`.

    Args:
        values: content of the YAML.
        place: file and key, for messages.
        others: keys that are allowed here besides the families.

    Raises:
        BadInput: if the family is unknown, the numbers are wrong, or there is no spread.
    """
    known = (*FAMILIES, *others)
    for key in values if isinstance(values, dict) else ():
        if key not in known:
            hint = spelling_hint(key, known)
            raise BadInput(f"{key}: unknown key; {hint}allowed: {', '.join(known)}", place)
    if not isinstance(values, dict) or len(values) != 1 or next(iter(values)) not in FAMILIES:
        raise BadInput(f"give one of {', '.join(FAMILIES)}", key=place, value=values)
    family, numbers = next(iter(values.items()))
    requested = FAMILIES[family]
    words = f"{place}.{family}: {numbers!r} is not allowed: give {requested.arguments}"
    if not isinstance(numbers, list) or (requested.length and len(numbers) != requested.length):
        raise BadInput(words)
    if family != "choice" and not all(_is_number(number) for number in numbers):
        raise BadInput(words)
    if family == "choice" and not _of_one_kind(numbers):
        raise BadInput(f"{words}, all numbers or all words")
    if not requested.spread(numbers):
        raise BadInput(f"{words}; these have no spread")
    return Distribution(family, tuple(numbers))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)


def _of_one_kind(values: list[Any]) -> bool:
    if all(isinstance(value, bool) for value in values):
        return True
    return all(map(_is_number, values)) or all(isinstance(value, str) for value in values)
