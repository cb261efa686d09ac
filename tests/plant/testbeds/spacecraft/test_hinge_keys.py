"""Keys of a hinge that its kind has no use for are refused, never passed over."""

from typing import Any

import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed

KEYS: dict[str, Any] = {
    "spring": 2.0,
    "damper": 0.1,
    "limit": 5.0,
    "range": [-1.0, 1.0],
    "motion": {"to": 0.5, "duration": 10.0},
}
HAS = {
    "fixed": {"range"},
    "prescribed": {"range", "motion"},
    "driven": {"spring", "damper", "limit"},
    "passive": {"spring", "damper"},
}


@pytest.mark.parametrize("kind", [*HAS, None])
@pytest.mark.parametrize("key", KEYS)
def test_a_key_acts_or_is_refused_by_its_name(kind: str | None, key: str) -> None:
    hinge = {"kind": kind, key: KEYS[key]}
    mass = {"mass": 10.0, "inertia": {"xx": 1.0, "yy": 1.0, "zz": 1.0}}
    section = {"kind": "spacecraft", "platform": mass,
               "appendages": {"boom": {"hinge": hinge, "body": mass}}}  # fmt: skip
    meant = kind or ("prescribed" if key == "motion" else "fixed")
    if key in HAS[meant]:
        assert read_testbed(section, "here").model().coordinates >= 6
    else:
        with pytest.raises(
            BadInput, match=f"appendages.boom.hinge.{key}: a {meant} hinge has none"
        ):
            read_testbed(section, "here")
