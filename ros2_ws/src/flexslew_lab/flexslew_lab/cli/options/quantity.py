"""Numbers with a unit as options of commands: `--at "2 min"`, `--mass "12 lb"`."""

from collections.abc import Callable

import typer

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import number_in


def quantity(unit: str) -> Callable[[str | float], float]:
    """Return the parser of an option that takes a number, or a quantity of the kind of a unit.

    Args:
        unit: in which the number is returned; a number without a unit is in it.
    """

    def number(value: str | float) -> float:
        try:
            return number_in(value, (unit,), "")
        except BadInput as error:
            raise typer.BadParameter(f"{value!r} is not allowed: {error.refusal.why}") from None

    return number


def numbers_in(text: str, units: tuple[str, ...], key: str) -> tuple[float, ...]:
    """Return numbers, or quantities in one of these units, with commas between, in SI.

    Raises:
        BadInput: one is neither; with the key.
    """
    return tuple(number_in(part.strip(), units, key) for part in text.split(","))
