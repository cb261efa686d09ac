"""What every testbed provides, and what some provide besides."""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.scene import Scene


class Testbed(Protocol):
    """A `testbed` section: everything that the rest of the bench needs to know of a spacecraft.

    An implementation is a settings section (flexslew_plant.settings.section) with these fields
    and methods; `initial` holds a position for every joint, under the joint's name.
    """

    operating_point: ClassVar[dict[str, float]]  # where laws linearise by default [rad or m]
    typical_goal: ClassVar[dict[str, float]]  # of a slew that names none [rad or m]
    simplified: ClassVar[dict[str, Any]]  # keys changed in what a planner or a law believes

    @property
    def kind(self) -> str:
        """Name in TESTBEDS, or where the class of the user's own stands."""

    @property
    def modes(self) -> int:
        """How many modal coordinates."""

    @property
    def initial(self) -> Any:
        """Where the joints rest at the start."""

    @property
    def effort_limit(self) -> tuple[float, ...]:
        """Largest effort of each actuator [N m or N]."""

    def model(self) -> Model:
        """Return the equations of motion."""

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> Self:
        """Return the testbed with another stiffness and payload, as factors [-].

        Raises:
            BadInput: it carries no payload.
        """

    def scene(self) -> Scene:
        """Return how it is drawn."""


@runtime_checkable
class ManyModels(Protocol):
    """A testbed with models that are made many at once for studies, thousands a second."""

    @classmethod
    def many_models(cls, testbeds: Sequence[Any]) -> list[Model]:
        """Return the model of each of many testbeds of this kind."""


@runtime_checkable
class StartsMoving(Protocol):
    """A testbed that may move at the start."""

    def initial_rates(self) -> Vector:
        """Return v of joints and modes at the start, shape (n,)."""


class UnitSizes(NamedTuple):
    """What one unit of each quantity of a section is, for weights that are given in its units."""

    coordinates: Vector  # of v's integrals, modes as their source scales them, (n,)
    efforts: Vector  # (actuators,)
    energy: float  # [J]


@runtime_checkable
class OwnUnits(Protocol):
    """A testbed with a section that is not in SI; any other one is in SI."""

    def unit_sizes(self) -> UnitSizes:
        """Return the units of the section in SI."""


def unit_sizes(testbed: Testbed) -> UnitSizes:
    """Return the units in which weights on a testbed's coordinates and efforts are given."""
    if isinstance(testbed, OwnUnits):
        return testbed.unit_sizes()
    model = testbed.model()
    return UnitSizes(np.ones(model.coordinates), np.ones(model.efforts), 1.0)


@runtime_checkable
class ScalableInertia(Protocol):
    """A testbed with a carrier, on which its appendages hang, that can be heavier than given."""

    def heavier(self, factor: float) -> "Testbed":
        """Return it with mass and inertia of the carrier times a factor [-]."""


@runtime_checkable
class Symbolic(Protocol):
    """A testbed that gives its energies in symbols, for planners by collocation."""

    def energies(self, symbols: Any, q: Any, v: Any) -> tuple[Any, Any, Any]:
        """Return kinetic energy, potential energy and Rayleigh's dissipation function [J, J, W].

        Args:
            symbols: CasADi, or any module with its cos, sin and dot.
            q, v: the coordinates and their rates, in its symbols.
        """


def require_no_payload(kind: str, payload: float) -> None:
    """Check that the requested payload of a testbed that carries none is a factor of 1 [-].

    Raises:
        BadInput: if another payload is requested.
    """
    if payload != 1.0:
        raise BadInput(f"{kind} carries none", key="payload", value=payload)
