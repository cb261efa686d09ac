"""Unit systems in which a spacecraft may be written; everything inside is SI."""

from typing import Literal, NamedTuple, TypeAlias

UnitSystem: TypeAlias = Literal["si", "slug_ft_lb"]


class Units(NamedTuple):
    """A system of units with the second as its time."""

    length: float  # [m]
    mass: float  # [kg]

    @property
    def force(self) -> float:
        """[N]."""
        return self.mass * self.length

    @property
    def torque(self) -> float:
        """[N m], which is the unit of energy too."""
        return self.mass * self.length**2


FOOT, SLUG = 0.3048, 14.593902937206364  # [m, kg]

UNITS: dict[UnitSystem, Units] = {
    "si": Units(1.0, 1.0),
    "slug_ft_lb": Units(FOOT, SLUG),
}

# what a factor in a mass or a length hints at
_MASSES = {"slug": SLUG, "lb": 0.45359237, "t": 1000.0, "g": 1e-3}
_LENGTHS = {"ft": FOOT, "in": 0.0254, "mm": 1e-3, "cm": 1e-2}


def hint(ratio: float, of: Literal["mass", "length"]) -> str:
    """Return which unit explains that a sum is `ratio` times too small, or an empty text."""
    for name, size in (_MASSES if of == "mass" else _LENGTHS).items():
        for factor, text in ((size, f"in {name}"), (1.0 / size, f"not in {name}")):
            if abs(ratio / factor - 1.0) < 0.01:
                return f"; the factor {ratio:.5g} says that it is {text}"
    return ""
