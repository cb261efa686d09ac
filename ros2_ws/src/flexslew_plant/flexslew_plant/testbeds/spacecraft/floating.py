"""How the platform of a spacecraft floats, read from the layout of its state."""

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.contract.floating import Floating, PlatformMotion, Wrench
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at

_PLACE, _ATTITUDE = slice(0, 3), slice(3, 7)  # of q
_LINEAR, _ANGULAR = slice(0, 3), slice(3, 6)  # of v, and of the forces that work on it


def floating(spacecraft: Spacecraft, model: Model) -> Floating | None:
    """Return how the platform floats; None: its motion is not free."""
    if spacecraft.motion != at.FREE:
        return None
    first_wheel = _ANGULAR.stop + len(spacecraft.hinged)

    def motion(x: Vector) -> PlatformMotion:
        q, v = model.split(x)
        return PlatformMotion(q[_PLACE], q[_ATTITUDE], v[_LINEAR], v[_ANGULAR])

    def wrench(x: Vector, effort: Vector, t: float) -> Wrench:
        forces = model.generalised_forces(x, effort, t)
        torque = forces[_ANGULAR].copy()
        for k, wheel in enumerate(spacecraft.wheels):  # what spins it up pushes back
            torque -= forces[first_wheel + k] * wheel.axis
        return Wrench(forces[_LINEAR], torque)

    return Floating("platform", motion, wrench)
