"""Tables of what a family offers: each file ends in an entry, the family's `__init__` imports it.

The import is the line by which a new file joins the family; the table follows from it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, Protocol, TypeVar


class TableEntry(Protocol):
    """The interface of a member of a family to the rest of the bench."""

    @property
    def name(self) -> str:
        """The name in trial files."""


E = TypeVar("E", bound=TableEntry)


def table(names: Mapping[str, object], kind: type[E]) -> dict[str, E]:
    """Return the entries among the names of a module, by the name that trial files use.

    They stand in the order of their imports.

    Args:
        names: of the family's `__init__`, as globals() gives them.
        kind: of the family's entries.

    Raises:
        ValueError: two entries have one name.
    """
    found: dict[str, E] = {}
    for entry in tuple(names.values()):
        if isinstance(entry, kind) and found.setdefault(entry.name, entry) is not entry:
            raise ValueError(f"{entry.name} stands in the table twice")
    return found


def union(sections: Iterable[type[Any]]) -> Any:
    """Return the union of sections, for pydantic."""
    first, *others = sections
    combined: Any = first
    for section in others:
        combined = combined | section
    return combined


def default_of(section: type[Any], key: str) -> str:
    """Return the default of a key that names its section, as `kind` or `method`."""
    return next(str(item.default) for item in fields(section) if item.name == key)
