"""Where the axes of a free platform look in the sky, and the cones that they must keep out of."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.contract import Cone, Sky
from flexslew_plant.testbeds.instruments import StarTrackerSettings, SunSensorSettings
from flexslew_plant.testbeds.spacecraft.assembly.bodies import unit_direction
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.settings import AnySensor, KeepOut, Triple

MAIN = "z axis"  # that a goal turns `to` a direction
_SAME_DIRECTION = 1e-9  # of two unit vectors


def sky_of(
    spacecraft: Spacecraft,
    sensors: Mapping[str, AnySensor],
    keep_out: Mapping[str, KeepOut],
    sun: Triple | None,
) -> Sky | None:
    """Return where the axes of a craft look, and the cones; None: its platform is not free.

    Args:
        spacecraft: the spacecraft.
        sensors: sensors of its section.
        keep_out: cones of its section.
        sun: direction to the Sun if the orbit gives it, else None.

    Raises:
        BadInput: by key, a direction is none, that to the Sun is missing, or the platform is not
            free.
    """
    if spacecraft.motion != at.FREE:
        if keep_out:
            words = "only a free platform can point; use motion: free"
            raise BadInput(f"testbed.keep_out: {words}")
        return None
    boresights = {MAIN: np.array([0.0, 0.0, 1.0])}
    for name, sensor in sensors.items():
        if isinstance(sensor, StarTrackerSettings | SunSensorSettings):
            key = f"testbed.sensors.{name}.boresight"
            boresights[name] = unit_direction(sensor.boresight, key)
    cones = []
    for name, settings in keep_out.items():
        key = f"testbed.keep_out.{name}"
        cone_direction = settings.direction or sun
        if cone_direction is None:
            raise BadInput(f"{key}.direction: is required where there is no orbit")
        boresight = unit_direction(settings.boresight, f"{key}.boresight")
        axis = unit_direction(cone_direction, f"{key}.direction")
        cones.append(Cone(name, boresight, axis, settings.half_angle))
        if all(np.abs(other - boresight).max() > _SAME_DIRECTION for other in boresights.values()):
            boresights[f"boresight of {name}"] = boresight
    return Sky(boresights, tuple(cones))
