"""The one contract of every spacecraft on the bench."""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np

from flexslew_plant.arrays import Matrix, Tensor, Vector
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
    """A testbed whose models are made many at once, as studies want them: thousands a second."""

    @classmethod
    def many_models(cls, testbeds: Sequence[Any]) -> list[Model]:
        """Return the model of each of many testbeds of this kind."""


@runtime_checkable
class StartsMoving(Protocol):
    """A testbed that may move at the start."""

    def initial_rates(self) -> Vector:
        """Return v of joints and modes at the start, shape (n,)."""


class ShapedMotion(NamedTuple):
    """Joints that follow a shaped command, on a grid, and how they drive the modes."""

    position: Matrix  # (times, joints) [rad or m]
    velocity: Matrix  # (times, joints) [rad/s or m/s]
    # w of M_qq q'' + C q' + K q = -coupling^T w, its mean over each interval, (times - 1, joints)
    drive: Matrix


@runtime_checkable
class Shaped(Protocol):
    """A testbed that says how its joints must move for their drive to be shaped."""

    def shaped_motion(
        self, path: Vector, rate: Vector, first: Vector, last: Vector, h: float
    ) -> ShapedMotion:
        """Return the motion whose drive of the modes is linear in the derivatives of the path.

        Args:
            path, rate: a shaped command from 0 to 1 and its derivative, shape (times,) [-, 1/s].
            first, last: joints at its ends, shape (joints,) [rad or m].
            h: interval of the grid [s].

        Raises:
            BadInput: there is no such motion between these ends.
        """


class UnitSizes(NamedTuple):
    """What one unit of each quantity of a section is, for weights that are given in its units."""

    coordinates: Vector  # of v's integrals, modes as their source scales them, (n,)
    efforts: Vector  # (actuators,)
    energy: float  # [J]


@runtime_checkable
class OwnUnits(Protocol):
    """A testbed whose section is not in SI; any other one counts in SI."""

    def unit_sizes(self) -> UnitSizes:
        """Return the units of the section in SI."""


def unit_sizes(testbed: Testbed) -> UnitSizes:
    """Return the units in which weights on a testbed's coordinates and efforts are given."""
    if isinstance(testbed, OwnUnits):
        return testbed.unit_sizes()
    model = testbed.model()
    return UnitSizes(np.ones(model.coordinates), np.ones(model.efforts), 1.0)


class HingeTurn(NamedTuple):
    """A prescribed turn of an appendage."""

    appendage: str
    begin: float  # [s]
    end: float  # [s]
    to: float  # angle from the hinge's rest [rad]


@runtime_checkable
class Retargetable(Protocol):
    """A testbed with appendages that turn in a prescribed way."""

    def hinge_turns(self) -> tuple[HingeTurn, ...]:
        """Return all turns, in the order of their begin."""

    def retargeted(self, requested: dict[str, Any], at: float) -> dict[str, Any]:
        """Return the keys of the section that give an appendage a new target (see varied).

        Args:
            requested: `appendage`, and the keys of a motion of its hinge but for `at`.
            at: when it begins to turn [s].

        Raises:
            BadInput: no such appendage, or its hinge does not turn in a prescribed way.
        """


@runtime_checkable
class ScalableInertia(Protocol):
    """A testbed whose carrier, on which its appendages hang, can be heavier than it says."""

    def heavier(self, factor: float) -> "Testbed":
        """Return it with mass and inertia of the carrier times a factor [-]."""


class RigidTurn(NamedTuple):
    """The efforts that turn a rigid spacecraft about one axis, u = a rate' + b rate^2."""

    inertia: float  # about the axis [kg m^2]
    tangential: Vector  # a, (joints,)
    centrifugal: Vector  # b, (joints,)
    carried: Vector  # what the joints on the platform read of it, (joints,) [1, or m/rad]


@runtime_checkable
class Turning(Protocol):
    """A testbed with many joints that planners turn about one of them."""

    def turning(self, joint: str, modes: int | None = None) -> "Testbed":
        """Return the testbed with this joint alone, about whose axis it turns.

        Args:
            joint: a torque on the platform.
            modes: how many, those that the turn drives most; None: all.

        Raises:
            BadInput: the joint does not turn the platform.
        """

    def rigid_turn(self, joint: str) -> RigidTurn:
        """Return what all joints must do for the turn (Sung and Joo, (44) to (46))."""


@runtime_checkable
class ThreeAxes(Turning, Protocol):
    """A testbed that planners turn about any axis."""

    def turning_about(self, axis: Vector, limit: float, modes: int | None = None) -> "Testbed":
        """Return the testbed with one joint, `turn`, about a body axis.

        Args:
            axis: unit vector in body axes, shape (3,).
            limit: of the torque about it [N m].
            modes: how many, those that the turn drives most; None: all.
        """

    def rigid_turn_about(self, axis: Vector) -> RigidTurn:
        """Return what all joints must do for a turn about a body axis; see Turning.rigid_turn."""

    def rigid(self) -> "Testbed":
        """Return the testbed without modes, its sensors besides those of the joints left out."""


class DriveMap(NamedTuple):
    """What each joint's effort does to the turn of a free platform.

    Args:
        torque: about the centre of mass, of a unit effort, in body axes, shape (3, joints).
        one_way: which joints push in their positive direction alone, in order.
        wheels: which are reaction wheels, in order.
        inertia: of these wheels, shape (wheels,) [kg m^2].
        gyros: which are control moment gyros, in order; their torque is that of gimbals at zero.
        gimbals: axes and rotors of these at angle zero, in body axes, shape (gyros, 2, 3).
        momentum: of their rotors, shape (gyros,) [N m s].
    """

    torque: Matrix
    one_way: tuple[int, ...]
    wheels: tuple[int, ...]
    inertia: Vector
    gyros: tuple[int, ...]
    gimbals: Tensor
    momentum: Vector


@runtime_checkable
class Wheeled(Protocol):
    """A testbed that planners may count with as if wheels turned it."""

    def wheeled(self) -> Any:
        """Return it with wheels instead of control moment gyros; itself where it has none."""


@runtime_checkable
class TurnedByDrives(Protocol):
    """A testbed whose torque can be shared out among its drives."""

    def drive_map(self) -> DriveMap:
        """Return what its drives do to its turn."""


@runtime_checkable
class Symbolic(Protocol):
    """A testbed that gives its energies in symbols, for planners by collocation."""

    def energies(self, symbols: Any, q: Any, v: Any) -> tuple[Any, Any, Any]:
        """Return kinetic energy, potential energy and Rayleigh's dissipation function [J, J, W].

        Args:
            symbols: CasADi, or any module with its cos, sin and dot.
            q, v: the coordinates and their rates, in its symbols.
        """


def shaped_motion(
    testbed: Testbed, path: Vector, rate: Vector, first: Vector, last: Vector, h: float
) -> ShapedMotion:
    """Return how the joints follow a shaped command; see Shaped.

    Unless the testbed says otherwise every joint follows the command itself, which drives the
    modes by its second derivative.
    """
    if isinstance(testbed, Shaped):
        return testbed.shaped_motion(path, rate, first, last, h)
    span = last - first
    return ShapedMotion(
        first + np.outer(path, span), np.outer(rate, span), np.outer(np.diff(rate) / h, span)
    )


def refuse_payload(kind: str, payload: float) -> None:
    """Check that a testbed that carries no payload is asked for none: a factor of 1 [-].

    Raises:
        BadInput: another payload is asked for.
    """
    if payload != 1.0:
        raise BadInput(f"{kind} carries none", key="payload", value=payload)
