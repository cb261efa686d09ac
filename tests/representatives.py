"""Which parameters of a test the default run takes, and which only `./flexslew test --all`."""

from collections.abc import Collection, Iterable
from itertools import product
from typing import Any

import pytest


def representatives(members: Iterable[Any], *chosen: Any, single: bool = False) -> list[Any]:
    """Return the parameters of a test, of which all but the chosen ones are marked `matrix`.

    Args:
        members: values, or tuples of a value for each argument.
        chosen: those that the default run takes.
        single: whether a tuple is the value of one argument.

    Raises:
        ValueError: if one of the chosen is no member.
    """
    members = list(members)
    if unknown := [value for value in chosen if value not in members]:
        raise ValueError(f"{unknown} are no members of {members}")
    mark = pytest.mark.matrix
    return [value if value in chosen else _marked(value, mark, single) for value in members]


def products(*tables: Collection[Any]) -> list[Any]:
    """Return the full product of tables, of which most is marked `matrix`.

    The default run takes as many combinations as the longest table has members: the first of each
    table, the second of each, and so on, a shorter one from its beginning again.
    """
    lists = [list(table) for table in tables]
    longest = max(map(len, lists))
    covering = [tuple(values[k % len(values)] for values in lists) for k in range(longest)]
    return representatives(product(*lists), *covering)


def seeds(count: int, default: int = 1) -> list[Any]:
    """Return seeds of random cases, of which those beyond the default are marked `campaign`."""
    beyond = [_marked(seed, pytest.mark.campaign) for seed in range(default, count)]
    return [*range(default), *beyond]


def _marked(value: Any, mark: pytest.MarkDecorator, single: bool = False) -> Any:
    several = isinstance(value, tuple) and not single
    return pytest.param(*(value if several else (value,)), marks=mark)
