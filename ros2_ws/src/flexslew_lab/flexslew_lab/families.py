"""The families of the bench as lists for a notebook: laws, planners and testbeds by name."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from inspect import getdoc
from typing import Any

from flexslew_plant.notebook_table import as_text, in_notebook


class Listing(Mapping[str, str]):
    """What there is of one kind: a line of words by name."""

    def __init__(self, word: str, lines: Mapping[str, str]) -> None:
        self._word, self._lines = word, lines

    def __getitem__(self, name: str) -> str:
        """Return the line of a name."""
        return self._lines[name]

    def __iter__(self) -> Iterator[str]:
        """Return the names."""
        return iter(self._lines)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._lines)

    def __repr__(self) -> str:
        """Return the table of names and lines."""
        return as_text((self._word, "about"), self._lines.items())

    def _repr_html_(self) -> str:
        return in_notebook("", (self._word, "about"), self._lines.items())


class Family:
    """The members of a family when called; its other attributes are those of its package."""

    def __init__(self, package: str, table: str, word: str) -> None:
        self._package, self._table, self._word = package, table, word

    def __call__(self) -> Listing:
        """Return the members by the name that trials use, each with one line."""
        table = getattr(import_module(self._package), self._table)
        lines = {
            name: (getdoc(entry.settings) or "").partition("\n")[0] for name, entry in table.items()
        }
        return Listing(self._word, lines)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the package, such as the table of its entries.

        Raises:
            AttributeError: if there is no such attribute.
        """
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(import_module(self._package), name)

    def __repr__(self) -> str:
        """Return the table of the members."""
        return repr(self())

    def _repr_html_(self) -> str:
        return self()._repr_html_()


laws = Family("flexslew_control.controllers", "CONTROLLERS", "law")
planners = Family("flexslew_control.planners", "PLANNERS", "planner")
testbeds = Family("flexslew_plant.testbeds", "TESTBEDS", "testbed")
