"""Gyros, star trackers, Sun sensors, tachometers and resolvers of a spacecraft."""

from typing import TypeAlias

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.instruments import (
    BodyState,
    Gyro,
    GyroSettings,
    Instrument,
    Resolver,
    ResolverSettings,
    StarTracker,
    StarTrackerSettings,
    SunSensor,
    SunSensorSettings,
    Tachometer,
    TachometerSettings,
)
from flexslew_plant.testbeds.spacecraft.assembly.bodies import unit_direction
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.settings import Triple

InstrumentSettings: TypeAlias = (
    GyroSettings | StarTrackerSettings | SunSensorSettings | TachometerSettings | ResolverSettings
)

_ATTITUDE = slice(3, 7)  # of the quaternion in a free platform's q
_RATE = slice(3, 6)  # of the body rate in its v


def instrument_of(
    spacecraft: Spacecraft,
    name: str,
    settings: InstrumentSettings,
    first: int,
    sun: Triple | None,
) -> Instrument:
    """Return an instrument on the platform.

    Args:
        spacecraft: the spacecraft that carries it.
        name: name of its section.
        settings: its section.
        first: its first channel.
        sun: direction to the Sun if the orbit gives it, else None.

    Raises:
        BadInput: the platform is not free, a direction is none, a span ends before it begins, or
            the direction to the Sun is missing.
    """
    key = f"testbed.sensors.{name}"
    if spacecraft.motion != at.FREE:
        raise BadInput(f"{key}: only a free platform has an attitude; use motion: free")
    if isinstance(settings, GyroSettings):
        return Gyro(name, first, settings)
    if isinstance(settings, TachometerSettings):
        if not spacecraft.wheels:
            raise BadInput(f"{key}: the platform has no wheels; give `wheels`")
        return Tachometer(name, first, tuple(w.name for w in spacecraft.wheels), settings)
    if isinstance(settings, ResolverSettings):
        if not spacecraft.gyros:
            raise BadInput(f"{key}: the platform has no gimbals; give `control_moment_gyros`")
        return Resolver(name, first, tuple(g.name for g in spacecraft.gyros), settings)
    unit_direction(settings.boresight, f"{key}.boresight")
    if isinstance(settings, StarTrackerSettings):
        for i, (start, end) in enumerate(settings.blind):
            if end <= start:
                raise BadInput("the later time last", f"{key}.blind.{i}", value=[start, end])
        return StarTracker(name, first, settings)
    sun_direction = settings.sun or sun
    if sun_direction is None:
        raise BadInput(f"{key}.sun: is required where there is no orbit")
    return SunSensor(name, first, settings, unit_direction(sun_direction, f"{key}.sun"))


def body_of(spacecraft: Spacecraft, x: Vector) -> BodyState:
    """Return how a free platform stands and turns."""
    v = x[spacecraft.sizes[0] :]
    end = v.size - spacecraft.modes
    first = end - len(spacecraft.gyros)
    return BodyState(
        x[_ATTITUDE], v[_RATE], v[first - len(spacecraft.wheels) : first], v[first:end]
    )
