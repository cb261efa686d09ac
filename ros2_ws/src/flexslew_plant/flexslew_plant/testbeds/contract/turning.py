"""Testbeds that planners turn about an axis, by joints or by drives."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds.contract.testbed import Testbed


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
        """Return the testbed with this joint alone, turning about the joint's axis.

        Args:
            joint: a torque on the platform.
            modes: number of modes, those that the turn drives most; None: all.

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
        """Return the motion of all joints in a turn about a body axis."""

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
    """A testbed with a torque that can be shared out among its drives."""

    def drive_map(self) -> DriveMap:
        """Return what its drives do to its turn."""
