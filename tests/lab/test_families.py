"""The families of `import flexslew` as lists, and its public names."""

from importlib import import_module

import pytest

import flexslew as fs
from flexslew_control.controllers import CONTROLLERS
from flexslew_control.planners import PLANNERS
from flexslew_lab.families import Family
from flexslew_plant.testbeds import TESTBEDS


@pytest.mark.parametrize(
    ("family", "table"),
    [(fs.laws, CONTROLLERS), (fs.planners, PLANNERS), (fs.testbeds, TESTBEDS)],
    ids=["laws", "planners", "testbeds"],
)
def test_a_family_lists_each_member_with_its_own_line(family: Family, table: object) -> None:
    found = family()
    assert list(found) == list(table)  # type: ignore[call-overload]
    assert len({*found.values()}) == len(found)
    for name, line in found.items():
        assert 20 < len(line) <= 90, name
        assert line.endswith("."), name
        assert f"{name} " in repr(found)
        assert line in repr(found)
        assert name in found._repr_html_()
    assert repr(family) == repr(found)


def test_a_family_has_the_attributes_of_its_package() -> None:
    assert fs.laws.CONTROLLERS is CONTROLLERS
    with pytest.raises(AttributeError):
        _ = fs.laws.nothing


def test_the_public_names_are_those_of_dir_and_each_is_there() -> None:
    assert {*dir(fs)} == {*fs.__all__, "__version__"}
    homes = {name: module for module, names in fs._HOMES.items() for name in names}
    assert {*homes} == {*fs.__all__}
    for name, module in homes.items():
        assert getattr(fs, name) is getattr(import_module(module), name)
    with pytest.raises(AttributeError, match=r"flexslew has no fli; did you mean fly\?"):
        _ = fs.fli
