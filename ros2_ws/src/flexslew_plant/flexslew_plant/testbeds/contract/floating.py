"""The motion of a platform that floats freely, without its generalised state."""

from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

from flexslew_plant.arrays import Vector


class PlatformMotion(NamedTuple):
    """Pose of the body frame in inertial space, and its velocities along body axes."""

    place: Vector  # of its origin, (3,) [m]
    attitude: Vector  # unit quaternion x y z w, (4,)
    velocity: Vector  # of its origin, (3,) [m/s]
    rate: Vector  # angular, (3,) [rad/s]


class Wrench(NamedTuple):
    """A force and its moment about the origin of the body frame, along body axes."""

    force: Vector  # (3,) [N]
    torque: Vector  # (3,) [N m]


class Floating(NamedTuple):
    """A platform that floats freely.

    Args:
        frame: its name in the scene.
        motion: from the state x = [q, v].
        wrench: of what the actuators do to the spacecraft, from x, the efforts and the time [s];
            a wheel pushes from outside, a driven hinge from within.
    """

    frame: str
    motion: Callable[[Vector], PlatformMotion]
    wrench: Callable[[Vector, Vector, float], Wrench]


@runtime_checkable
class CanFloat(Protocol):
    """A testbed with a platform that may float freely."""

    def floating(self) -> Floating | None:
        """Return how it floats; None: it is held, or turns about a pivot."""
