"""Units in terms of the base units of SI, as a model description defines them."""

import re

from flexslew_plant.errors import BadInput

# exponents by the name of the base unit
_KNOWN: dict[str, dict[str, int]] = {
    "": {},
    "-": {},
    "1": {},
    "rad": {"rad": 1},
    "s": {"s": 1},
    "m": {"m": 1},
    "kg": {"kg": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "A": {"A": 1},
    "K": {"K": 1},
    "Hz": {"s": -1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
}


def base_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of SI's base units in a unit: `N m s/rad`, `rad/s^2`, `1/m`.

    Raises:
        BadInput: a factor of it is unknown.
    """
    above, _, below = unit.partition("/")
    found: dict[str, int] = {}
    for text, sign in ((above, 1), (below.strip("()"), -1)):
        for factor in text.split():
            name, _, power = factor.partition("^")
            if name not in _KNOWN or (power and not re.fullmatch(r"-?\d+", power)):
                known = ", ".join(name for name in _KNOWN if name.isalpha())
                raise BadInput(f"the unit {unit!r} has the factor {factor!r}; known: {known}")
            for base, exponent in _KNOWN[name].items():
                found[base] = found.get(base, 0) + sign * exponent * int(power or 1)
    return {base: exponent for base, exponent in found.items() if exponent}
