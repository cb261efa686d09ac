"""Values by name for a notebook: a wrong name is refused with the nearest one."""

from collections.abc import Mapping, Sequence
from typing import NoReturn, TypeVar

from flexslew_plant.near_names import spelling_hint

T = TypeVar("T")


def names_in(given: str | Sequence[str]) -> list[str]:
    """Return names that are given as such, or in one text with commas between them."""
    if not isinstance(given, str):
        return list(given)
    return [name.strip() for name in given.split(",") if name.strip()]


class Named(dict[str, T]):
    """A dictionary whose KeyError names what was meant and what there is.

    Args:
        values: by name.
        word: what a name is, for the error.
    """

    def __init__(self, values: Mapping[str, T], word: str) -> None:
        super().__init__(values)
        self._word = word

    def __missing__(self, name: str) -> NoReturn:
        """Refuse a name.

        Raises:
            KeyError: always; the message lists all.
        """
        quantities = (known.partition(".")[0] for known in self)
        hint = spelling_hint(name, dict.fromkeys((*quantities, *self)))
        raise KeyError(f"{name} is not a {self._word}; {hint}there are {', '.join(self)}")


class BySignal(Named[T]):
    """Values by the name of a signal, `quantity.joint`; called with a quantity, those of it."""

    def __call__(self, quantity: str = "") -> tuple[T, ...]:
        """Return the values of the signals of a quantity, or of the signal of that name.

        Args:
            quantity: as `position` or `effort`; empty: all signals.

        Raises:
            KeyError: if there is no such signal; the message lists all.
        """
        found = [n for n in self if not quantity or n == quantity or n.startswith(f"{quantity}.")]
        return tuple(self[name] for name in found or [quantity])
