"""Which actuators are motors, where friction acts: those of driven hinges and reaction wheels."""

import numpy as np

from flexslew_plant.testbeds.model import Motors, ReactionWheels
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def motors_of(spacecraft: Spacecraft) -> Motors:
    """Return the motors, each on the rate between what it turns and the platform.

    An effort on a wheel is the torque on the platform, so the wheel spins up against it.
    """
    positions, coordinates = spacecraft.sizes
    others = (
        len(spacecraft.hinged) + len(spacecraft.wheels) + len(spacecraft.gyros) + spacecraft.modes
    )
    hinged = [k for k, a in enumerate(spacecraft.appendages) if a.hinge == at.DRIVEN]
    motor_indices = [k for k, d in enumerate(spacecraft.drives) if d.what in (at.HINGE, at.WHEEL)]
    actuator_list = [spacecraft.drives[k] for k in motor_indices]
    order = np.array(  # among hinges and wheels
        [
            hinged.index(d.owner) if d.what == at.HINGE else len(hinged) + d.owner
            for d in actuator_list
        ],
        dtype=np.int64,
    )
    return Motors(
        tuple(d.name for d in actuator_list),
        np.array(motor_indices, dtype=np.int64),
        positions - others + order,
        positions + coordinates - others + order,
        np.array([-1.0 if d.what == at.WHEEL else 1.0 for d in actuator_list]),
    )


def reaction_wheels_of(spacecraft: Spacecraft, motors: Motors) -> ReactionWheels:
    """Return the wheels.

    Args:
        spacecraft: the spacecraft.
        motors: its motors, see motors_of.
    """
    wheels = motors.sign < 0.0
    wheel_list = [spacecraft.wheels[spacecraft.drives[k].owner] for k in motors.efforts[wheels]]
    return ReactionWheels(
        motors.efforts[wheels],
        motors.rate[wheels],
        np.array([wheel.inertia for wheel in wheel_list]),
        np.array([wheel.largest_speed for wheel in wheel_list]),
    )
