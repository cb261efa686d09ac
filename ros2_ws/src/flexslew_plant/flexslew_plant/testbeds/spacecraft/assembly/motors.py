"""Which actuators are motors, where friction acts: those of driven hinges and reaction wheels."""

import numpy as np

from flexslew_plant.testbeds.model import DrivenWheels, Motors
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def motors_of(craft: Spacecraft) -> Motors:
    """Return the motors, each on the rate between what it turns and the platform.

    An effort on a wheel is the torque on the platform, so the wheel spins up against it.
    """
    positions, coordinates = craft.sizes
    others = len(craft.hinged) + len(craft.wheels) + len(craft.gyros) + craft.modes
    hinged = [k for k, a in enumerate(craft.appendages) if a.hinge == at.DRIVEN]
    chosen = [k for k, d in enumerate(craft.drives) if d.what in (at.HINGE, at.WHEEL)]
    drives = [craft.drives[k] for k in chosen]
    turned = np.array(  # among hinges and wheels
        [hinged.index(d.owner) if d.what == at.HINGE else len(hinged) + d.owner for d in drives],
        dtype=np.int64,
    )
    return Motors(
        tuple(d.name for d in drives),
        np.array(chosen, dtype=np.int64),
        positions - others + turned,
        positions + coordinates - others + turned,
        np.array([-1.0 if d.what == at.WHEEL else 1.0 for d in drives]),
    )


def spins_of(craft: Spacecraft, motors: Motors) -> DrivenWheels:
    """Return the wheels.

    Args:
        craft: the spacecraft.
        motors: its motors, see motors_of.
    """
    wheels = motors.sign < 0.0
    owners = [craft.wheels[craft.drives[k].owner] for k in motors.efforts[wheels]]
    return DrivenWheels(
        motors.efforts[wheels],
        motors.rate[wheels],
        np.array([wheel.inertia for wheel in owners]),
        np.array([wheel.largest_speed for wheel in owners]),
    )
