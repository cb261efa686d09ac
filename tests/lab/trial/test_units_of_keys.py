"""Every key of a trial names a unit that is known, and takes the symbols of data sheets in it."""

import dataclasses
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

import pytest

from flexslew_control.controllers import CONTROLLERS, CommonSettings
from flexslew_lab.trial.trial import Trial
from flexslew_lab.tuning.settings import TuningSettings
from flexslew_plant.keys.settings_fields import describe_section
from flexslew_plant.keys.units import ABOVE, in_si, units_in

_SHARES = ("probability", "dropout", "tolerance", "ratio")  # which are given in per cent


def sections(kind: Any, seen: set[type[Any]]) -> Iterator[type[Any]]:
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        if kind in seen:
            return
        seen.add(kind)
        yield kind
        for inner in get_type_hints(kind, include_extras=True).values():
            yield from sections(inner, seen)
    for inner in get_args(kind):
        yield from sections(inner, seen)


def keys() -> Iterator[tuple[str, str]]:
    seen: set[type[Any]] = set()
    for kind in (
        Trial,
        TuningSettings,
        CommonSettings,
        *(entry.settings for entry in CONTROLLERS.values()),
    ):
        for section in sections(kind, seen):
            for name, description in describe_section(section).items():
                yield f"{section.__name__}.{name}", description.words


@pytest.mark.parametrize(("place", "words"), [pytest.param(p, w, id=p) for p, w in keys()])
def test_the_units_of_a_key_are_read_in_every_spelling(place: str, words: str) -> None:
    for unit in units_in(words):
        if unit == ABOVE:
            continue
        text = unit.removeprefix("1")  # 2.5 /s
        assert in_si(f"2.5 {text}", [unit]) == pytest.approx(2.5), place
        dotted = text.replace(" ", "·").replace("^2", "²")
        assert in_si(f"2.5{dotted}", [unit]) == pytest.approx(2.5), place
    if place.endswith(_SHARES) and "rad" not in units_in(words):
        assert in_si("5 %", units_in(words)) == pytest.approx(0.05), place
