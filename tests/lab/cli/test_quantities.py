"""Options whose meaning names a unit take quantities of its kind, and refuse others."""

import re
from collections.abc import Iterator

import pytest
import typer
from typer.core import TyperGroup, TyperOption

from flexslew_lab.cli.main import app
from flexslew_lab.cli.options.quantity import numbers_in, quantity
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import in_si, names_of

_UNIT = re.compile(r"\[(s|Hz|kg|m|rad|rad/s)\]")


def options() -> Iterator[tuple[str, TyperOption, str]]:
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    for name, command in group.commands.items():
        for parameter in command.params:
            words = parameter.help if isinstance(parameter, TyperOption) else None
            unit = _UNIT.search(words or "")
            if isinstance(parameter, TyperOption) and unit and "low,high" not in str(words):
                yield f"{name} {parameter.name}", parameter, unit[1]


@pytest.mark.parametrize(
    ("parameter", "unit"),
    [pytest.param(option, unit, id=place) for place, option, unit in options()],
)
def test_an_option_with_a_unit_takes_every_symbol_of_its_kind(
    parameter: TyperOption, unit: str
) -> None:
    context = typer.Context(typer.main.get_command(app))
    for symbol in names_of(unit):
        text = f"1.5 {symbol}"
        assert parameter.process_value(context, text) == in_si(text, [unit])
    with pytest.raises(typer.BadParameter, match="'1 A' is not allowed: give a number in"):
        parameter.process_value(context, "1 A")


def test_numbers_of_an_option_are_read_with_and_without_a_unit() -> None:
    assert quantity("s")("2 min") == 120.0
    assert quantity("s")(3.0) == 3.0
    assert numbers_in("0.5 Hz, 9", ("rad/s",), "--band") == pytest.approx((3.14159265358979, 9.0))
    with pytest.raises(BadInput, match=r"--band: '2 kg' is not allowed: give a number in rad/s"):
        numbers_in("2 kg,9", ("rad/s",), "--band")
